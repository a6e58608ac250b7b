//! Importance classes: how precisely each Gaussian deserves to be coded.
//!
//! A colour error `e` of one Gaussian changes the squared error of the rendered views by
//! `e^2 * sum((alpha T)^2)` over its pixels. That sum varies over six orders of magnitude
//! within a scene, so one quantisation step for all Gaussians wastes most of its bits.
//! Each Gaussian gets a class `c`; attributes are transformed with weight `4^c`, which makes
//! the effective step of a Gaussian finer by `2^c`. Squared error suggests one class per factor
//! of four in importance; measured, a smaller slope with a floor is better, because steps far
//! above the mean one leave the range in which errors stay small (a log-scale off by 1.5
//! makes a Gaussian twenty times as large). Classes are coded once, in a section of
//! their own, and every attribute section depends only on geometry and classes.

use crate::attributes::group::{Coding, Transform, UNITS};
use crate::error::Result;
use crate::options::Entropy;
use gpcc_lite::Leaf;
use gpcc_lite::attribute::Rows;
use gs_model::Scene;
use rayon::prelude::*;
use std::borrow::Cow;

/// Number of classes; weights run from 1 to `4^(CLASSES - 1)`.
pub const CLASSES: u8 = 12;
/// The class of the mean importance of a scene. The sum of weights stays near `N 4^5`, inside
/// what the fixed-point transform accepts for 60 M Gaussians.
pub const MEAN_CLASS: u8 = 5;

/// RAHT weight of a class, `4^class`.
#[must_use]
pub fn weight(class: u8) -> u32 {
    1 << (2 * u32::from(class.min(CLASSES - 1)))
}

/// Importance without cameras: alpha times the root of the area of the two largest axes.
///
/// A rasterizer's sum of squared blending weights over the training views is better where
/// cameras are known: this guess does not know what is hidden or far. Hence the square roots:
/// `alpha^2` times the area itself, right where everything is seen alike, measures worse than
/// no weights at all (`fox`, equal error: guess squared 1.12, no weights 1.04, this 1.00; from
/// cameras 0.84).
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

/// Classes per factor of four in importance. On `fox` at equal rendered error the streams of
/// slopes 0, 0.5, 0.7, 1 are 1.00, 0.87, 0.86, 0.91 in size.
const SLOPE: f64 = 0.7;
/// Lowest class, relative to [`MEAN_CLASS`]: steps are at most `2^3` times the mean one.
const FLOOR: f64 = 3.0;

/// Real-valued classes from importances (any unit; negative and NaN count as 0), relative to
/// the mean importance of the scene.
#[must_use]
pub fn log_classes(importance: &[f32]) -> Vec<f64> {
    let clean = |v: f32| if v.is_finite() && v > 0.0 { f64::from(v) } else { 0.0 };
    let sum: f64 = importance.iter().map(|&v| clean(v)).sum();
    let mean = sum / importance.len().max(1) as f64;
    importance
        .par_iter()
        .map(|&v| {
            let v = clean(v);
            let lowest = f64::from(MEAN_CLASS) - FLOOR;
            if v == 0.0 || mean == 0.0 {
                return lowest;
            }
            let class = f64::from(MEAN_CLASS) + 0.5 * SLOPE * libm::log2(v / mean);
            class.clamp(lowest, f64::from(CLASSES - 1))
        })
        .collect()
}

/// Quantiser step of the classes: coarse, since the exact class matters little, and what is
/// saved here is saved for every Gaussian.
const CLASS_STEP: f64 = 1.0;
const CLASS_LAMBDA: u8 = 18;

/// Codes classes through unweighted RAHT; returns the stream and the classes a decoder will
/// read from it, which are the ones the attributes must be coded with.
///
/// # Errors
/// [`crate::Error::Coding`] if the leaves are not a valid pruned octree.
pub fn encode(
    log_classes: &[f64],
    leaves: &[Leaf],
    j_high: u8,
    entropy: Entropy,
) -> Result<(Vec<u8>, Vec<u8>)> {
    let transform = Transform::new(leaves, j_high, None)?;
    encode_by(&transform, Cow::Borrowed(log_classes), entropy)
}

/// As [`encode`], by the transform of the leaves without weights.
pub(crate) fn encode_by(
    transform: &Transform,
    log_classes: Cow<'_, [f64]>,
    entropy: Entropy,
) -> Result<(Vec<u8>, Vec<u8>)> {
    let coding = Coding { entropy, lambda: CLASS_LAMBDA, period: u8::MAX };
    let (payload, _) =
        transform.encode(&[CLASS_STEP], coding, move |i, row| row.fill(log_classes[i]))?;
    let classes = decode_by(transform, &payload, &mut Rows::default())?;
    Ok((payload, classes))
}

/// Decodes the classes of [`encode`].
///
/// # Errors
/// [`crate::Error::Coding`] or [`crate::Error::Corrupt`] for a damaged payload.
pub fn decode(payload: &[u8], leaves: &[Leaf], j_high: u8) -> Result<Vec<u8>> {
    decode_by(&Transform::new(leaves, j_high, None)?, payload, &mut Rows::default())
}

/// As [`decode`], by the transform of the leaves without weights and in the memory of `rows`.
pub(crate) fn decode_by(transform: &Transform, payload: &[u8], rows: &mut Rows) -> Result<Vec<u8>> {
    transform.decode_rows(payload, 1, rows)?;
    let mut values = vec![0.0; rows.leaves()];
    rows.copy(0, &mut values);
    Ok(values.iter().map(|&v| class_of(f64::from(v) * (1.0 / UNITS))).collect())
}

/// The class of a decoded value. Adding a half and truncating: exact in f64.
fn class_of(value: f64) -> u8 {
    (value + 0.5).clamp(0.0, f64::from(CLASSES - 1)) as u8
}

#[cfg(test)]
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
    fn a_factor_of_four_is_one_slope() {
        let c = log_classes(&[1.0, 4.0, 16.0]);
        assert!((c[1] - c[0] - SLOPE).abs() < 1e-9 && (c[2] - c[1] - SLOPE).abs() < 1e-9);
    }

    #[test]
    fn decoder_reads_the_classes_the_encoder_used() {
        let leaves: Vec<Leaf> = (0..500u64).map(|i| Leaf { morton: i * i, depth: 7 }).collect();
        let values: Vec<f64> = (0..500).map(|i| f64::from(i * 37 % 110) / 10.0).collect();
        for entropy in [Entropy::Range, Entropy::Rlgr] {
            let (payload, classes) = encode(&values, &leaves, 7, entropy).unwrap();
            assert_eq!(decode(&payload, &leaves, 7).unwrap(), classes);
            let worst = classes.iter().zip(&values).map(|(&c, v)| (f64::from(c) - v).abs());
            assert!(worst.fold(0.0, f64::max) <= 3.0);
        }
    }
}
