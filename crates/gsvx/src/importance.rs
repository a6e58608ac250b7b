//! Importance classes: how precisely each Gaussian deserves to be coded.
//!
//! A colour error `e` of one Gaussian changes the squared error of the rendered views by
//! `e^2 * sum((alpha T)^2)` over its pixels. That sum varies over six orders of magnitude
//! within a scene, so a common quantisation step spends most bits on errors that nobody sees.
//! Each Gaussian gets a class `c`; attributes are transformed with weight `4^c`, which makes
//! the effective step of a Gaussian finer by `2^c`. Squared error suggests one class per factor
//! of four in importance; measured, a smaller slope with a floor is better, because steps far
//! above the mean one leave the range in which errors stay small (a log-scale off by 1.5
//! makes a Gaussian 4.5 times as wide). Classes are coded in the base layer of each chunk,
//! before all attributes.

#[cfg(feature = "encode")]
use gs_model::Scene;
#[cfg(feature = "encode")]
use rayon::prelude::*;

/// Number of classes; weights run from 1 to `4^(CLASSES - 1)`.
pub(crate) const CLASSES: u8 = 12;
/// The class of the mean importance of a scene.
pub const MEAN_CLASS: u8 = 5;

/// RAHT weight of a class, `4^class`.
pub(crate) fn weight(class: u8) -> u32 {
    1 << (2 * u32::from(class.min(CLASSES - 1)))
}

/// Importance without cameras: alpha times the root of the area of the two largest axes.
///
/// A rasterizer's sum of squared blending weights over the training views is better where
/// cameras are known: this guess does not know what is hidden or far. Hence the square roots:
/// `alpha^2` times the area itself, right where everything is seen alike, measures worse than
/// no weights at all (`fox`, equal error: guess squared 1.12, no weights 1.04, this 1.00; from
/// cameras 0.84).
#[cfg(feature = "encode")]
#[must_use]
pub fn without_cameras(scene: &Scene) -> Vec<f32> {
    scene
        .opacity_logits
        .par_iter()
        .zip(&scene.log_scales)
        .map(|(&logit, ls)| {
            let thin = ls.iter().copied().fold(f32::INFINITY, f32::min);
            let log_area = f64::from(ls[0]) + f64::from(ls[1]) + f64::from(ls[2]) - f64::from(thin);
            let log_alpha = crate::attributes::opacity::log_alpha_of_logit(logit);
            libm::exp((log_alpha + 0.5 * log_area).clamp(-80.0, 80.0)) as f32
        })
        .collect()
}

/// Importance of a Gaussian that no camera sees, beside one that cameras see: its precision is that of
/// 30 quality points less. Such a scene is coarse and still makes a picture.
#[cfg(feature = "encode")]
const UNSEEN: f64 = 1.0 / 16.0;

/// Importances from cameras for an encoder that keeps what no camera sees: at least a sixteenth of
/// [`without_cameras`], in the unit of `seen`. Where nothing is seen at all, it is
/// [`without_cameras`].
///
/// `seen` is the rasterizer's sum of squared blending weights, one per Gaussian; what is not a positive
/// number counts as not seen.
#[cfg(feature = "encode")]
#[must_use]
pub fn with_unseen(scene: &Scene, seen: &[f32]) -> Vec<f32> {
    let guess = without_cameras(scene);
    let clean = |v: f32| if v.is_finite() && v > 0.0 { f64::from(v) } else { 0.0 };
    let pairs = || seen.iter().map(|&s| clean(s)).zip(guess.iter().map(|&g| f64::from(g)));
    let mut sums = [0.0; 2];
    for (s, g) in pairs().filter(|&(s, _)| s > 0.0) {
        sums = [sums[0] + s, sums[1] + g];
    }
    let unit = if sums[1] > 0.0 { UNSEEN * sums[0] / sums[1] } else { 1.0 };
    pairs().map(|(s, g)| s.max(unit * g) as f32).collect()
}

/// Classes per factor of four in importance. On `fox` at equal rendered error the streams of
/// slopes 0, 0.5, 0.7, 1 are 1.00, 0.87, 0.86, 0.91 in size.
#[cfg(feature = "encode")]
const SLOPE: f64 = 0.7;
/// Lowest class, relative to [`MEAN_CLASS`]: steps are at most `2^3` times the mean one.
#[cfg(feature = "encode")]
const FLOOR: f64 = 3.0;

/// Real-valued classes from importances (any unit; negative and NaN count as 0), relative to
/// the mean importance of the scene.
#[cfg(feature = "encode")]
pub(crate) fn log_classes(importance: &[f32]) -> Vec<f32> {
    let clean = |v: f32| if v.is_finite() && v > 0.0 { f64::from(v) } else { 0.0 };
    let sum: f64 = importance.iter().map(|&v| clean(v)).sum();
    let mean = sum / importance.len().max(1) as f64;
    importance
        .par_iter()
        .map(|&v| {
            let v = clean(v);
            let lowest = f64::from(MEAN_CLASS) - FLOOR;
            if v == 0.0 || mean == 0.0 {
                return lowest as f32;
            }
            let class = f64::from(MEAN_CLASS) + 0.5 * SLOPE * libm::log2(v / mean);
            class.clamp(lowest, f64::from(CLASSES - 1)) as f32
        })
        .collect()
}

/// The class of a decoded value.
pub(crate) fn class_of(value: f32) -> u8 {
    (value + 0.5).clamp(0.0, f32::from(CLASSES - 1)) as u8
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    fn rounded(importance: &[f32]) -> Vec<u8> {
        log_classes(importance).iter().map(|v| v.round() as u8).collect()
    }

    #[test]
    fn equal_importance_gives_the_mean_class() {
        assert_eq!(rounded(&[3.0; 5]), vec![MEAN_CLASS; 5]);
    }

    #[test]
    fn broken_importances_get_the_lowest_class() {
        let c = rounded(&[f32::NAN, -1.0, 0.0, f32::INFINITY, 1.0]);
        let lowest = MEAN_CLASS - FLOOR as u8;
        assert_eq!(&c[..4], &[lowest; 4]);
        assert!(c[4] > lowest);
        assert_eq!(rounded(&[]), Vec::<u8>::new());
    }

    #[test]
    fn cameras_of_another_scene_deleted_the_model() {
        let scene = testing::trained_like(500, 0, &mut testing::Rng::seeded(3));
        let guess = without_cameras(&scene);
        let mut seen = vec![0.0; 500];
        assert_eq!(with_unseen(&scene, &seen), guess);
        seen[7] = 3.0;
        seen[8] = f32::NAN;
        let filled = with_unseen(&scene, &seen);
        assert_eq!(filled[7], 3.0);
        let unit = 3.0 / 16.0 / guess[7];
        for i in (0..500).filter(|&i| i != 7) {
            assert!((filled[i] / (unit * guess[i]) - 1.0).abs() < 1e-5, "{i}");
        }
    }

    #[test]
    fn a_factor_of_four_is_one_slope() {
        let c = log_classes(&[1.0, 4.0, 16.0]);
        assert!(
            (c[1] - c[0] - SLOPE as f32).abs() < 1e-6 && (c[2] - c[1] - SLOPE as f32).abs() < 1e-6
        );
    }
}
