//! How much a Gaussian's covariance matters to the rendered image, estimated without cameras.

/// Square root of opacity times mean projected area. It replaces the rendered sensitivity of
/// Compressed 3DGS where there are neither photos nor cameras.
///
/// `opacity` is the activated value in 0..=1, `log_scales` are the Gaussian's own (not normalised).
/// The area is that of the one-sigma ellipsoid's shadow, averaged over viewing directions: a
/// quarter of its surface (Cauchy), here approximated by pi times the root mean square of the three
/// products of scales (exact for spheres, 4 % large for needles, 15 % for discs). The root makes
/// large Gaussians count for less, because they tend to be far away or hidden, which the formula
/// does not know. Where cameras exist, blending weights over training views do.
///
/// Unit: the scene's unit of length. Input that is not finite gives 0.
pub fn default_sensitivity(opacity: f32, log_scales: [f32; 3]) -> f32 {
    let [a, b, c] = log_scales.map(|l| libm::exp(f64::from(l)));
    let (ab, bc, ac) = (a * b, b * c, a * c);
    let area = std::f64::consts::PI * ((ab * ab + bc * bc + ac * ac) / 3.0).sqrt();
    let value = (f64::from(opacity.clamp(0.0, 1.0)) * area).sqrt();
    if value.is_finite() { value.min(f64::from(f32::MAX)) as f32 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(opacity: f32, log_scales: [f32; 3]) -> f32 {
        let s = default_sensitivity(opacity, log_scales);
        s * s
    }

    #[test]
    fn known_areas() {
        assert!((area(1.0, [0.0; 3]) - std::f32::consts::PI).abs() < 1e-5);
        // A unit disc's mean shadow is pi / 2, a long needle's pi² / 4 times both scales.
        let disc = area(0.5, [0.0, 0.0, -30.0]);
        assert!((disc / std::f32::consts::FRAC_PI_4 - 1.155).abs() < 1e-3);
        let needle = area(1.0, [5.0, -5.0, -5.0]);
        assert!((needle / 2.467_401 - 1.04).abs() < 1e-3);
        assert_eq!(default_sensitivity(f32::NAN, [0.0; 3]), 0.0);
        assert_eq!(default_sensitivity(1.0, [f32::NAN, 0.0, 0.0]), 0.0);
        assert_eq!(default_sensitivity(1.0, [f32::INFINITY, 0.0, 0.0]), 0.0);
        assert_eq!(default_sensitivity(2.0, [100.0; 3]), f32::MAX);
    }
}
