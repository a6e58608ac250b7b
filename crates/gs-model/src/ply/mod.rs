//! 3DGS models in PLY files: the layout of the Inria reference implementation.
//!
//! One `vertex` per Gaussian: mean `x y z`, `f_dc_0..2` (SH degree 0), `f_rest_*` (the higher
//! SH coefficients, **channel-major**: all of red, then green, then blue), `opacity` (a logit),
//! `scale_0..2` (natural logarithms), `rot_0..3` (quaternion, w first). The reader takes ASCII
//! and both binary formats, properties in any order and of any scalar type, with or without
//! normals, and skips what it does not know, naming it in the [`ReadReport`].

mod ascii;
mod binary;
mod columns;
mod header;
mod stream;
mod write;

use std::path::Path;

pub use header::{Format, MAX_HEADER_BYTES};
pub use write::{header, row_bytes, rows, write, write_rows_to, write_to};

use crate::error::{Error, Result};
use crate::fs;
pub use crate::options::{CLAMPED_OPACITY_LOGIT, Invalid, ReadOptions};
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

/// Reads a 3DGS model, with the default [`ReadOptions`].
///
/// # Errors
/// [`Error::Io`] if the file cannot be read, a `Ply*` error if it is not a 3DGS model or not
/// whole, [`Error::InvalidGaussian`] if a Gaussian is invalid.
pub fn read(path: impl AsRef<Path>) -> Result<(Scene, ReadReport)> {
    read_with(path, &ReadOptions::default())
}

/// Reads a 3DGS model.
///
/// Memory: the scene, and the file too if it is not plain (ASCII, lists, other elements before the
/// Gaussians); a header that promises more rows than the file holds is an
/// error before anything is allocated for them.
///
/// # Errors
/// As [`read`]; with [`Invalid::Drop`] no invalid Gaussian is an error.
pub fn read_with(path: impl AsRef<Path>, options: &ReadOptions) -> Result<(Scene, ReadReport)> {
    let path = path.as_ref();
    match stream::read(path, options)? {
        Some(read) => Ok(read),
        None => read_named(path, &fs::read(path)?, options),
    }
}

/// Reads a 3DGS model from the bytes of a PLY file, with the default [`ReadOptions`].
///
/// # Errors
/// As [`read`]; the file in the errors is `<bytes>`.
pub fn read_bytes(bytes: &[u8]) -> Result<(Scene, ReadReport)> {
    read_bytes_with(bytes, &ReadOptions::default())
}

/// Reads a 3DGS model from the bytes of a PLY file.
///
/// # Errors
/// As [`read_with`]; the file in the errors is `<bytes>`.
pub fn read_bytes_with(bytes: &[u8], options: &ReadOptions) -> Result<(Scene, ReadReport)> {
    read_named(Path::new("<bytes>"), bytes, options)
}

pub(crate) fn read_named(
    file: &Path,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<(Scene, ReadReport)> {
    let header = header::parse(file, bytes)?;
    let Some(vertex_at) = header.elements.iter().position(|e| e.name == "vertex") else {
        return Err(Error::PlyNoVertex { file: file.into() });
    };
    let vertex = &header.elements[vertex_at];
    let (before, after) = (&header.elements[..vertex_at], &header.elements[vertex_at + 1..]);
    let columns = columns::Columns::of(file, vertex)?;

    let (scene, trailing_bytes) = match header.format {
        Format::Ascii => {
            let mut lines = ascii::Lines::new(file, bytes, &header);
            before.iter().try_for_each(|e| lines.skip(e))?;
            let scene = lines.vertices(vertex, &columns)?;
            after.iter().try_for_each(|e| lines.skip(e))?;
            (scene, lines.trailing())
        }
        Format::BinaryLittleEndian | Format::BinaryBigEndian => {
            let body =
                binary::Body { file, bytes, big_endian: header.format == Format::BinaryBigEndian };
            let at = before.iter().try_fold(header.len, |at, e| body.skip(e, at))?;
            let (scene, at) = body.vertices(vertex, &columns, at)?;
            let end = after.iter().try_fold(at, |at, e| body.skip(e, at))?;
            (scene, bytes.len() - end)
        }
    };

    let skipped = before.iter().chain(after).map(|e| (e.name.clone(), e.count)).collect();
    let lengths = [bytes.len(), trailing_bytes];
    finish(file, scene, options, &header, columns, skipped, lengths)
}

/// Applies the options to a scene just read, and reports. `lengths`: of the file, and of what
/// follows its last row, bytes.
fn finish(
    file: &Path,
    mut scene: Scene,
    options: &ReadOptions,
    header: &header::Header,
    columns: columns::Columns,
    skipped_elements: Vec<(String, u64)>,
    lengths: [usize; 2],
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
        skipped_elements,
        comments: header.comments.clone(),
        file_bytes: lengths[0],
        trailing_bytes: lengths[1],
    };
    Ok((scene, report))
}
