//! Opacity in the domain it is coded in.
//!
//! A rendered pixel changes by `d_alpha * T * contrast`. Attributes are coded with weights
//! proportional to `(alpha T)^2` (see [`crate::importance`]), so the error that counts is
//! the relative one, `d_alpha / alpha`: the natural domain is `ln alpha`. For small alpha it
//! equals the logit; for alpha near 1 it saturates where the logit runs away. The other domains
//! are there for comparison and for the paper's profile.

use crate::error::{Error, Result};
use crate::options::OpacityDomain;

/// Logits outside this range are moved to its ends before coding: below, alpha is under
/// 1/2980 and no rasterizer draws it (cut 1/255); above, alpha rounds to 1 in 8 bit.
pub const LOGIT_RANGE: [f32; 2] = [-8.0, 12.0];

/// The value coded for an opacity logit.
#[must_use]
pub fn forward(domain: OpacityDomain, logit: f32) -> f64 {
    match domain {
        OpacityDomain::LogAlpha => log_alpha_of_logit(logit),
        OpacityDomain::Logit => f64::from(logit.clamp(LOGIT_RANGE[0], LOGIT_RANGE[1])),
        OpacityDomain::Alpha => libm::exp(log_alpha_of_logit(logit)),
    }
}

/// The opacity logit of a decoded value; finite for any finite value.
#[must_use]
pub fn inverse(domain: OpacityDomain, value: f64) -> f32 {
    match domain {
        OpacityDomain::LogAlpha => logit_of_log_alpha(value),
        OpacityDomain::Logit => (value as f32).clamp(LOGIT_RANGE[0], LOGIT_RANGE[1]),
        OpacityDomain::Alpha => logit_of_log_alpha(libm::log(value.clamp(f64::MIN_POSITIVE, 1.0))),
    }
}

/// Code of a domain in the opacity section.
#[must_use]
pub fn code(domain: OpacityDomain) -> u8 {
    match domain {
        OpacityDomain::LogAlpha => 0,
        OpacityDomain::Logit => 1,
        OpacityDomain::Alpha => 2,
    }
}

/// The domain of a code.
///
/// # Errors
/// [`Error::Corrupt`] for a code no encoder writes.
pub fn domain(code: u8) -> Result<OpacityDomain> {
    match code {
        0 => Ok(OpacityDomain::LogAlpha),
        1 => Ok(OpacityDomain::Logit),
        2 => Ok(OpacityDomain::Alpha),
        other => Err(Error::Corrupt { what: "opacity domain", value: other.into() }),
    }
}

/// `ln(sigmoid(logit))`, at most 0.
#[must_use]
pub fn log_alpha_of_logit(logit: f32) -> f64 {
    let l = f64::from(logit.clamp(LOGIT_RANGE[0], LOGIT_RANGE[1]));
    // ln(1 / (1 + e^-l)), without cancellation at either end.
    if l >= 0.0 { -libm::log1p(libm::exp(-l)) } else { l - libm::log1p(libm::exp(l)) }
}

/// The inverse of [`log_alpha_of_logit`] up to rounding, for any finite input: values at or
/// above 0 (quantisation error) give the greatest logit of [`LOGIT_RANGE`].
#[must_use]
pub fn logit_of_log_alpha(log_alpha: f64) -> f32 {
    let a = log_alpha.clamp(-80.0, 0.0);
    // logit = ln(alpha) - ln(1 - alpha)
    let rest = -libm::expm1(a);
    let logit = if rest > 0.0 { a - libm::log(rest) } else { f64::from(LOGIT_RANGE[1]) };
    (logit as f32).clamp(LOGIT_RANGE[0], LOGIT_RANGE[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip_over_the_range() {
        for i in -800..=1200 {
            let logit = i as f32 / 100.0;
            let back = logit_of_log_alpha(log_alpha_of_logit(logit));
            // At the top ln(alpha) is about -6e-6: conditioning of the domain, not an error.
            assert!((back - logit).abs() < 1e-4, "{logit} -> {back}");
        }
    }

    #[test]
    fn ends_are_finite() {
        for v in [f64::MIN, -1e9, -0.0, 0.0, 1.0, f64::MAX] {
            assert!(logit_of_log_alpha(v).is_finite());
        }
        for v in [f32::MIN, -1e4, 1e4, f32::MAX] {
            assert!(log_alpha_of_logit(v) <= 0.0);
        }
    }
}
