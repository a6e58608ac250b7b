//! Gaussians so far away that the octree would be too coarse for all others, and what is coarse all the same.

use crate::encoded::CoarseCells;
use crate::error::Result;
use crate::lossless::layout;
use crate::strategy::{BITS_AT_50, depth_of};
use crate::survey::Survey;
use gpcc_lite::Cube;
use gpcc_lite::morton::MAX_DEPTH;
use gs_model::Scene;
use voxel::{Trim, Trimmed};

/// Cells this many times smaller than the median Gaussian's largest axis are needed at least. An outlier costs the
/// octree about three bits a level, less than its floats, so outliers are split off only where the greatest
/// depth does not suffice for these: see [`split_outliers`].
const CELLS_PER_AXIS: f64 = 8.0;
/// Cells of this part of the median Gaussian's largest axis are worth a warning. Two rooms 1e4 units apart, with 0.07,
/// lose 1 dB at quality 75; 1e5 units apart, with 0.7, 15 dB.
const COARSE: f64 = 0.2;
/// The same for the small Gaussians of a scene whose median one is large: a tenth of all are below one cell.
const COARSE_FOR_SMALL: f64 = 1.0;

/// The outliers that make the octree too coarse for all others, and the cube without them; `None` if
/// there are none.
///
/// Where cells an eighth as wide as the median Gaussian lie deeper than an octree's 21 levels,
/// [`voxel::trim`] weighs what a smaller cube gives the inliers against the floats of the
/// outliers.
///
/// # Errors
/// [`crate::Error::Voxel`] if the median log-scale is not finite.
pub(crate) fn split_outliers(scene: &Scene, survey: &Survey) -> Result<Option<Trimmed>> {
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

/// See [`crate::Encoded::coarse_cells`]; of the Gaussians that are no outliers.
pub(crate) fn coarse_cells(survey: &Survey) -> Option<CoarseCells> {
    let cell = survey.cube().side * libm::exp2(-f64::from(MAX_DEPTH));
    let of = |log_scale: Option<f64>| Some(cell / libm::exp(log_scale?));
    if let Some(cells) = of(survey.median_log_scale()).filter(|&cells| cells > COARSE) {
        return Some(CoarseCells { cells, of_small: false });
    }
    let cells = of(survey.small_log_scale()).filter(|&cells| cells > COARSE_FOR_SMALL)?;
    Some(CoarseCells { cells, of_small: true })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two copies of a scene, a distance apart.
    fn pair(distance: f32) -> Scene {
        let one = testing::trained_like(2000, 0, &mut testing::Rng::seeded(5));
        let mut both = one.clone();
        both.append(&one);
        both.means[2000..].iter_mut().for_each(|p| p[0] += distance);
        both
    }

    #[test]
    fn two_parts_far_apart_got_coarse_without_a_word() {
        let median = libm::exp(Survey::of(&pair(1.0)).unwrap().median_log_scale().unwrap());
        for (cells, wanted) in [(0.01, false), (0.15, false), (0.3, true), (3.0, true)] {
            let both = pair((cells * median * libm::exp2(21.0)) as f32);
            let told = coarse_cells(&Survey::of(&both).unwrap());
            assert_eq!(told.is_some(), wanted, "{cells}");
            let right = |t: CoarseCells| (t.cells / cells - 1.0).abs() < 0.1 && !t.of_small;
            assert!(told.is_none_or(right), "{told:?}, not {cells}");
        }
        assert_eq!(coarse_cells(&Survey::new(0)), None);
    }

    #[test]
    fn a_two_centimetre_part_of_a_large_scene_became_one_gaussian_without_a_word() {
        let mut both = pair(0.0);
        // The second half is as large as all others, the first a millionth of that.
        for i in 0..2000 {
            both.means[i] = both.means[i].map(|x| 1e-6 * x);
            both.log_scales[i] = both.log_scales[i].map(|l| l - 13.8);
        }
        both.append(&pair(0.0).select(&(0..100).collect::<Vec<_>>()));
        let told = coarse_cells(&Survey::of(&both).unwrap()).expect("a warning");
        assert!(told.of_small && told.cells > 1.0, "{told:?}");
    }
}
