//! Opacity as the logarithm of alpha.
//!
//! A rendered pixel changes by `d_alpha * T * contrast`. Attributes are coded with weights proportional
//! to `(alpha T)^2` (see [`crate::importance`]), so the error that counts is the relative one,
//! `d_alpha / alpha`: the natural quantity is `ln alpha`. For small alpha it equals the logit; for alpha
//! near 1 it saturates where the logit runs away.

/// Logits outside this range are moved to its ends before coding: below, alpha is under 1/2980 and no
/// rasterizer draws it (cut 1/255); above, alpha rounds to 1 in 8 bits.
pub(crate) const LOGIT_RANGE: [f32; 2] = [-8.0, 12.0];

/// `ln(sigmoid(logit))`, at most 0.
#[cfg(feature = "encode")]
#[must_use]
pub(crate) fn log_alpha_of_logit(logit: f32) -> f64 {
    let l = f64::from(logit.clamp(LOGIT_RANGE[0], LOGIT_RANGE[1]));
    // ln(1 / (1 + e^-l)), without cancellation at either end.
    if l >= 0.0 { -libm::log1p(libm::exp(-l)) } else { l - libm::log1p(libm::exp(l)) }
}

/// A derivative by ln(alpha), from that by the logit: `d ln(alpha) / d logit = 1 - alpha`.
#[cfg(feature = "encode")]
#[must_use]
pub(crate) fn gradient(logit: f32, by_logit: f32) -> f32 {
    let l = logit.clamp(LOGIT_RANGE[0], LOGIT_RANGE[1]);
    // 1 / (1 - alpha) = 1 + e^l.
    by_logit * (1.0 + libm::expf(l))
}

/// The inverse of [`log_alpha_of_logit`] up to rounding, for any input: values at or above 0
/// (quantisation error) give the greatest logit of [`LOGIT_RANGE`].
#[must_use]
pub(crate) fn logit_of_log_alpha(log_alpha: f32) -> f32 {
    let a = log_alpha.clamp(-80.0, 0.0);
    // logit = ln(alpha) - ln(1 - alpha)
    let rest = -libm::expm1f(a);
    let logit = if rest > 0.0 { a - libm::logf(rest) } else { LOGIT_RANGE[1] };
    logit.clamp(LOGIT_RANGE[0], LOGIT_RANGE[1])
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn round_trip_over_the_range() {
        for i in -800..=1200 {
            let logit = i as f32 / 100.0;
            let back = logit_of_log_alpha(log_alpha_of_logit(logit) as f32);
            assert!((back - logit).abs() < 1e-4, "{logit} -> {back}");
        }
    }

    #[test]
    fn ends_are_finite() {
        for v in [f32::MIN, -1e9, -0.0, 0.0, 1.0, f32::MAX] {
            assert!(logit_of_log_alpha(v).is_finite());
        }
        for v in [f32::MIN, -1e4, 1e4, f32::MAX] {
            assert!(log_alpha_of_logit(v) <= 0.0);
        }
    }
}
