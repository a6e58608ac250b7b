//! [`ReadReport`]: what a PLY file held.

use std::path::Path;

use super::columns::Columns;
use super::header::{Element, Format, Header};
use crate::error::Result;
use crate::options::ReadOptions;
use crate::scene::Scene;
use crate::validate::InvalidReport;

/// What a PLY file held.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ReadReport {
    /// How its rows are stored.
    pub format: Format,
    /// Highest SH degree, from the number of `f_rest` properties.
    pub sh_degree: u8,
    /// Gaussians in the file.
    pub gaussians_in_file: usize,
    /// Gaussians in the scene that was returned.
    pub gaussians: usize,
    /// Invalid Gaussians that were left out; indices are those of the file.
    pub dropped: InvalidReport,
    /// Infinite opacity logits that were replaced.
    pub clamped_opacities: usize,
    /// Properties of `vertex` that are not part of the Inria layout, in file order; ignored.
    pub unknown_properties: Vec<String>,
    /// How a model that is not in the Inria layout was read, in words: see [`super`].
    pub notes: Vec<&'static str>,
    /// Which of `nx`, `ny` and `nz` the file has, in file order; ignored.
    pub normal_properties: Vec<String>,
    /// Gaussians in the file whose normal is not zero (-0 included). The Inria trainer writes zero
    /// normals, and so does [`super::write()`].
    pub nonzero_normals: usize,
    /// Other elements than `vertex` and their row counts, in file order; skipped.
    pub skipped_elements: Vec<(String, u64)>,
    /// `comment` and `obj_info` lines.
    pub comments: Vec<String>,
    /// Length of the file, bytes.
    pub file_bytes: usize,
    /// Bytes after the last row that the header declares; ignored. (In ASCII files, white space
    /// at the end does not count.)
    pub trailing_bytes: usize,
}

impl ReadReport {
    /// The properties of `vertex` whose values are lost when the scene is written again: those that
    /// are not part of the Inria layout, and the normals if one of them is not zero.
    #[must_use]
    pub fn properties_not_kept(&self) -> Vec<&str> {
        let normals = if self.nonzero_normals > 0 { &self.normal_properties[..] } else { &[] };
        self.unknown_properties.iter().chain(normals).map(String::as_str).collect()
    }
}

/// What a file holds beside the header and the Gaussians.
pub(super) struct Extent<'a> {
    pub(super) vertex: &'a Element,
    pub(super) skipped_elements: Vec<(String, u64)>,
    pub(super) file_bytes: usize,
    pub(super) trailing_bytes: usize,
}

/// Applies the options to a scene just read, and reports.
pub(super) fn finish(
    file: &Path,
    mut scene: Scene,
    options: &ReadOptions,
    header: &Header,
    columns: Columns,
    extent: Extent,
) -> Result<(Scene, ReadReport)> {
    let gaussians_in_file = scene.len();
    let (clamped_opacities, dropped) = options.apply(&mut scene, file)?;
    let report = ReadReport {
        format: header.format,
        sh_degree: columns.sh_degree,
        gaussians_in_file,
        gaussians: scene.len(),
        dropped,
        clamped_opacities,
        unknown_properties: columns.unknown,
        notes: columns.variants.notes(),
        normal_properties: columns
            .normals
            .iter()
            .map(|&p| extent.vertex.properties[p].name.clone())
            .collect(),
        nonzero_normals: columns.rows_with_normal.into_inner(),
        skipped_elements: extent.skipped_elements,
        comments: header.comments.clone(),
        file_bytes: extent.file_bytes,
        trailing_bytes: extent.trailing_bytes,
    };
    Ok((scene, report))
}
