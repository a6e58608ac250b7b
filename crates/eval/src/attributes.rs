//! The quantities that streams hold of a Gaussian, defined a second time, in double precision. The
//! bounds of docs/accuracy.md are bounds of these.

use gsvx::latents::LOGIT_RANGE;

/// `ln alpha` of an opacity logit, which is moved into [`LOGIT_RANGE`] first.
pub(crate) fn log_alpha(logit: f32) -> f64 {
    let logit = f64::from(logit.clamp(LOGIT_RANGE[0], LOGIT_RANGE[1]));
    -libm::log1p(libm::exp(-logit))
}

/// Luma and two chroma planes of a coefficient of the three colours; orthonormal.
pub(crate) fn colour_planes(rgb: [f32; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(f64::from);
    [
        (r + g + b) / 3.0f64.sqrt(),
        (r - b) * std::f64::consts::FRAC_1_SQRT_2,
        (2.0 * g - r - b) / 6.0f64.sqrt(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_the_logits_are_kept() {
        assert!((log_alpha(0.0) + std::f64::consts::LN_2).abs() < 1e-15);
        assert!((log_alpha(-1e4) + 8.000_335).abs() < 1e-6, "{}", log_alpha(-1e4));
        assert_eq!(log_alpha(1e4), log_alpha(12.0));
    }

    #[test]
    fn planes_keep_the_sum_of_squares() {
        let square = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>();
        let rgb = [0.3, -1.5, 2.25];
        assert!((square(colour_planes(rgb)) - square(rgb.map(f64::from))).abs() < 1e-12);
        assert_eq!(colour_planes([1.0; 3])[1..], [0.0; 2]);
    }
}
