//! How many leaves a quality asks for: the parameters of the rate-distortion strategy.

use super::options::{ImportanceFrom, QUALITY_PER_OCTAVE};
use crate::error::Result;
use crate::head::Steps;
use gpcc_lite::Cube;
use gpcc_lite::morton::MAX_DEPTH;
use voxel::{Importance, RateDistortion};

/// Finest leaf depth the default strategy considers; leaves that deep are rare, and what an
/// unbounded scene needs for its nearest Gaussians.
const J_HIGH: u8 = 17;
/// Where far parts make the cube large, the octree is so deep that this many of its finest leaves fit
/// along the largest axis of a median Gaussian (at most `MAX_DEPTH`): small Gaussians need far finer ones
/// than the median. With 8, a room below a sky 1000 units away lost 2 dB.
const LEAVES_PER_AXIS: f64 = 64.0;
/// Lagrangian weight at quality 50, in the units of [`RateDistortion::lambda`]. It follows the
/// square of the attribute steps, so that positions and attributes stay in balance.
const LAMBDA_AT_50: f64 = 3e-3;
/// The same for guessed importances.
const LAMBDA_AT_50_GUESSED: f64 = 4e-3;
/// Exponent on importance for the choice of leaves (measured; 1 merges too eagerly where little
/// is seen, 0.5 too little).
const EXPONENT: f64 = 0.8;
/// Distortion of leaving a Gaussian out per unit of importance.
const DROP: f64 = 5.0;
/// Attribute bits per Gaussian at quality 50, and how they grow per quality point.
pub(crate) const BITS_AT_50: f64 = 60.0;
const BITS_PER_POINT: f64 = 1.2;

/// The voxelization of a quality of 0 to 100. `importance` is that of each Gaussian.
///
/// # Errors
/// [`crate::Error::Option`] if `quality` is out of range.
pub(crate) fn rate_distortion(
    quality: f32,
    importance: &[f32],
    from: ImportanceFrom,
) -> Result<RateDistortion> {
    Steps::of_quality(quality)?;
    let (lambda, exponent, drop) = match from {
        ImportanceFrom::Guess => (LAMBDA_AT_50_GUESSED, 1.0, None),
        _ => (LAMBDA_AT_50, EXPONENT, Some(DROP)),
    };
    let above = f64::from(quality) - 50.0;
    let mut options =
        RateDistortion::new(lambda * libm::exp2(-2.0 * above / f64::from(QUALITY_PER_OCTAVE)));
    options.j_high = J_HIGH;
    options.cost.gaussian = (BITS_AT_50 + BITS_PER_POINT * above).max(10.0);
    options.drop = drop;
    let given = importance.iter().map(|&v| {
        let v = if v.is_finite() { f64::from(v).max(0.0) } else { 0.0 };
        libm::pow(v, exponent) as f32
    });
    options.importance = Importance::Given(given.collect());
    Ok(options)
}

/// The finest depth of leaves: at least that at which [`LEAVES_PER_AXIS`] cells fit along the median Gaussian's
/// largest axis.
pub(crate) fn j_high(median: Option<f64>, cube: &Cube) -> u8 {
    let needed = median.map_or(0.0, |m| depth_of(LEAVES_PER_AXIS, m, cube));
    J_HIGH.max(needed.ceil().clamp(0.0, f64::from(MAX_DEPTH)) as u8)
}

/// Depth at which this many cells fit along a largest axis, without a greatest depth and without rounding.
pub(crate) fn depth_of(cells: f64, log_scale: f64, cube: &Cube) -> f64 {
    libm::log2(cube.side * cells) - log_scale * std::f64::consts::LOG2_E
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoder::survey::Survey;

    #[test]
    fn a_far_sky_leaves_small_gaussians_their_depth() {
        // The cube is so large that a cell at depth 18 is an eighth of the median Gaussian.
        let scene = testing::trained_like(2000, 0, &mut testing::Rng::seeded(5));
        let median = Survey::of(&scene).unwrap().median_log_scale();
        let cube =
            Cube { origin: [0.0; 3], side: libm::exp(median.unwrap()) / 8.0 * libm::exp2(18.0) };
        assert_eq!(j_high(median, &cube), 21);
    }
}
