//! [`Report`]: what a model file held, whatever its format.

use std::path::Path;

use crate::error::Result;
use crate::options::ReadOptions;
use crate::ply;
use crate::scene::Scene;
use crate::validate::InvalidReport;

/// The format of a model file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// PLY in the Inria layout: see [`crate::ply`].
    Ply(ply::Format),
    /// PlayCanvas' `compressed.ply`: see [`crate::ply::compressed`].
    CompressedPly,
    /// SPZ: see [`crate::spz`].
    Spz {
        /// 2 to 4.
        version: u32,
    },
    /// `.ksplat`: see [`crate::ksplat`].
    Ksplat,
    /// SOG, version 2: see `crate::sog`, under the feature `sog`.
    Sog,
    /// glTF with splats: see [`crate::gltf`].
    Gltf,
    /// `.splat`: see [`crate::splat`].
    Splat,
}

/// What a model file held.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Report {
    /// The format.
    pub format: Format,
    /// Gaussians in the file.
    pub gaussians_in_file: usize,
    /// Invalid Gaussians that were left out; indices are those of the file.
    pub dropped: InvalidReport,
    /// Infinite opacity logits that were replaced.
    pub clamped_opacities: usize,
    /// What is reported of PLY files only.
    pub ply: Option<ply::ReadReport>,
}

/// Applies the options to a scene just decoded, and reports.
pub(crate) fn finish(
    file: &Path,
    mut scene: Scene,
    format: Format,
    options: &ReadOptions,
) -> Result<(Scene, Report)> {
    let gaussians_in_file = scene.len();
    let (clamped_opacities, dropped) = options.apply(&mut scene, file)?;
    Ok((scene, Report { format, gaussians_in_file, dropped, clamped_opacities, ply: None }))
}
