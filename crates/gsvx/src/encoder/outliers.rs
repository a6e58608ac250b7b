//! Gaussians so far away that the octree would be too coarse for all others.

use super::strategy::{BITS_AT_50, depth_of};
use super::survey::Survey;
use crate::error::Result;
use crate::lossless::layout;
use gpcc_lite::Cube;
use gpcc_lite::morton::MAX_DEPTH;
use gs_model::Scene;
use voxel::{Trim, TrimOutcome};

/// Cells this many times smaller than the median Gaussian's largest axis are needed at least. An outlier costs the
/// octree about three bits a level, less than its floats, so outliers are split off only where the greatest
/// depth does not suffice for these: see [`split_outliers`].
const CELLS_PER_AXIS: f64 = 8.0;

/// The outliers that make the octree too coarse for all others, and the cube without them; `None` if
/// there are none.
///
/// Where cells an eighth as wide as the median Gaussian lie deeper than an octree's 21 levels,
/// [`voxel::trim`] weighs what a smaller cube gives the inliers against the floats of the
/// outliers.
///
/// # Errors
/// [`crate::Error::Voxel`] if the median log-scale is not finite.
pub(crate) fn split_outliers(scene: &Scene, survey: &Survey) -> Result<Option<TrimOutcome>> {
    let Some(median) = survey.median_log_scale() else { return Ok(None) };
    let cell = libm::exp(median) / CELLS_PER_AXIS;
    // Before that no trimmed cube pays. Most scenes end here.
    if suffices(median, &survey.cube()) || cell <= 0.0 {
        return Ok(None);
    }
    let exact = 32.0 * layout::columns(scene.sh_degree) as f64;
    let weighed = Trim { bits_per_outlier: exact - BITS_AT_50, ..Trim::new(cell) };
    let trimmed = voxel::trim(&scene.means, &weighed)?;
    Ok((!trimmed.outliers.is_empty()).then_some(trimmed))
}

/// Whether an octree's 21 levels suffice for all: no Gaussian is an outlier then.
pub(crate) fn suffices(median: f64, cube: &Cube) -> bool {
    depth_of(CELLS_PER_AXIS, median, cube) <= f64::from(MAX_DEPTH)
}
