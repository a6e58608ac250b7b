//! Normalised covariances: shape and orientation of a Gaussian, without its size.
//!
//! Following Compressed 3DGS (Niedermayr et al. 2024), the scale factor is gamma = |s| (the
//! Euclidean norm of the three scales) and the normalised covariance is R diag(s / gamma)² Rᵀ,
//! whose trace is 1. A [`Covariance`] holds it in factored form, quaternion and log(s / gamma),
//! because the six entries as f32 lose any axis thinner than a three-thousandth of the longest.

use gs_model::math::{axes_product, eigen_of, quaternion, rotation};

use crate::canonical::canonicalise;
use crate::error::{Error, Result};

/// Smallest normalised log-scale: thinner axes are raised to exp(-16) = 1.1e-7 of the scale
/// factor, far less than a render can show.
pub const MIN_LOG_SCALE: f32 = -16.0;

/// A covariance of trace 1: unit quaternion and log-scales with sum(exp(2 log_scale)) = 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Covariance {
    pub(crate) quaternion: [f32; 4],
    pub(crate) log_scales: [f32; 3],
}

/// A covariance as a point in six dimensions; see [`Covariance::feature`].
pub(crate) type Feature = [f32; 6];

impl Covariance {
    /// Splits a Gaussian's covariance into the normalised covariance, with the smallest rotation
    /// angle, and log(gamma). The Gaussian's log-scales are, up to rounding and order, the
    /// normalised ones plus log(gamma).
    ///
    /// `quaternion` is (w, x, y, z) of any length; one without length counts as the identity.
    ///
    /// # Errors
    /// [`Error::BadLogScale`] if a log-scale is NaN or infinite, or beyond ±1e4.
    pub fn split(quaternion: [f32; 4], log_scales: [f32; 3]) -> Result<(Self, f32)> {
        for value in log_scales {
            if value.is_nan() || value.abs() > 1e4 {
                return Err(Error::BadLogScale { value });
            }
        }
        let (quaternion, log_scales) = canonicalise(quaternion, log_scales);
        let (log_scales, log_gamma) = normalise(log_scales.map(f64::from));
        Ok((Self { quaternion, log_scales }, log_gamma as f32))
    }

    /// The covariance nearest to a mean of features, which is positive semi-definite but for
    /// rounding, and not zero.
    pub(crate) fn from_feature(feature: Feature) -> Self {
        let off = std::f64::consts::FRAC_1_SQRT_2;
        let [xx, yy, zz, xy, xz, yz] = feature.map(f64::from);
        let (scales, axes) = eigen_of(&[xx, yy, zz, off * xy, off * xz, off * yz]);
        let largest = scales.iter().fold(f64::MIN_POSITIVE, |m, &s| m.max(s));
        let floor = libm::exp(f64::from(2.0 * MIN_LOG_SCALE));
        let log_scales = scales.map(|s| libm::log((s / largest).max(floor)) as f32);
        let (quaternion, log_scales) =
            canonicalise(quaternion(&axes).map(|c| c as f32), log_scales);
        Self { quaternion, log_scales: normalise(log_scales.map(f64::from)).0 }
    }

    /// Unit quaternion (w, x, y, z), canonical: w > 0, least rotation angle.
    pub fn quaternion(&self) -> [f32; 4] {
        self.quaternion
    }

    /// Normalised log-scales of the three axes, each in [`MIN_LOG_SCALE`]..=0.
    pub fn log_scales(&self) -> [f32; 3] {
        self.log_scales
    }

    /// The point whose squared distances training and search compare: the entries xx, yy, zz, xy,
    /// xz, yz of the square root R diag(s / gamma) Rᵀ, the last three times sqrt(2), because they
    /// appear twice in the matrix.
    ///
    /// So a distance is the Frobenius norm of the difference of two square roots: the 2-Wasserstein
    /// distance where the covariances commute. Compressed 3DGS compares the covariances themselves.
    /// With roots thin axes count for more, so flat Gaussians stay flat.
    pub(crate) fn feature(&self) -> Feature {
        let scales = self.log_scales.map(|l| libm::exp(f64::from(l)));
        let [xx, yy, zz, xy, xz, yz] = axes_product(&rotation(self.quaternion), scales);
        let off = std::f64::consts::SQRT_2;
        [xx, yy, zz, off * xy, off * xz, off * yz].map(|c| c as f32)
    }
}

/// Log-scales less log(gamma), floored, and log(gamma).
fn normalise(log_scales: [f64; 3]) -> ([f32; 3], f64) {
    let largest = log_scales[0].max(log_scales[1]).max(log_scales[2]);
    let sum: f64 = log_scales.map(|l| libm::exp(2.0 * (l - largest))).iter().sum();
    let log_gamma = largest + 0.5 * libm::log(sum);
    let floor = f64::from(MIN_LOG_SCALE);
    (log_scales.map(|l| (l - log_gamma).clamp(floor, 0.0) as f32), log_gamma)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_trace_is_one(
            q in prop::array::uniform4(-1.0f32..1.0), s in prop::array::uniform3(-20.0f32..20.0),
        ) {
            let (c, log_gamma) = Covariance::split(q, s).unwrap();
            let square = |l: f32| libm::exp(2.0 * f64::from(l));
            prop_assert!((c.log_scales().map(square).iter().sum::<f64>() - 1.0).abs() < 1e-5);
            let norm: f64 = s.map(square).iter().sum();
            prop_assert!((f64::from(log_gamma) - 0.5 * libm::log(norm)).abs() < 2e-6 * 20.0);
            // The squared Frobenius norm of the square root is the trace.
            let square: f32 = c.feature().map(|x| x * x).iter().sum();
            prop_assert!((square - 1.0).abs() < 1e-5);
        }

        #[test]
        fn factoring_inverts(
            q in prop::array::uniform4(-1.0f32..1.0), s in prop::array::uniform3(-4.0f32..0.0),
        ) {
            let (c, _) = Covariance::split(q, s).unwrap();
            let (a, b) = (c.feature(), Covariance::from_feature(c.feature()).feature());
            prop_assert!((0..6).all(|k| (a[k] - b[k]).abs() < 1e-6), "{a:?} {b:?}");
        }
    }

    #[test]
    fn thin_axes_survive_and_degenerate_input_is_refused() {
        let (c, _) = Covariance::split([1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -9.0]).unwrap();
        assert!((c.log_scales()[2] + 9.0 + 0.5 * libm::logf(2.0)).abs() < 1e-5);
        let (c, _) = Covariance::split([0.0; 4], [0.0, 0.0, -9000.0]).unwrap();
        assert_eq!(c.log_scales()[2], MIN_LOG_SCALE);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 2e4] {
            let got = Covariance::split([1.0, 0.0, 0.0, 0.0], [0.0, bad, 0.0]);
            assert!(matches!(got, Err(Error::BadLogScale { .. })));
        }
    }
}
