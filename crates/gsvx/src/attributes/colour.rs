//! Decorrelation of the three colour channels of one SH coefficient.
//!
//! The transform is orthonormal, so a quantisation step means the same error in every
//! plane: Y = (R+G+B)/sqrt 3, Co = (R-B)/sqrt 2, Cg = (-R+2G-B)/sqrt 6.

/// 1/sqrt 3, 1/sqrt 2, 1/sqrt 6.
const A: f32 = 0.577_350_26;
const B: f32 = std::f32::consts::FRAC_1_SQRT_2;
const C: f32 = 0.408_248_3;

/// RGB to luma and two chroma planes.
#[cfg(feature = "encode")]
#[must_use]
pub(crate) fn forward([r, g, b]: [f32; 3]) -> [f32; 3] {
    [(r + g + b) * A, (r - b) * B, (g + g - r - b) * C]
}

/// The inverse of [`forward`], every operation rounded to single precision.
#[inline(always)]
#[must_use]
pub(crate) fn inverse(ycc: [f32; 3]) -> [f32; 3] {
    let [y, o, g] = [ycc[0] * A, ycc[1] * B, ycc[2] * C];
    [y + o - g, y + g + g, y - o - g]
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn inverse_undoes_forward(r in -10f32..10.0, g in -10f32..10.0, b in -10f32..10.0) {
            let back = inverse(forward([r, g, b]));
            for (x, y) in back.iter().zip([r, g, b]) {
                prop_assert!((x - y).abs() < 1e-5);
            }
        }

        #[test]
        fn forward_keeps_energy(r in -10f32..10.0, g in -10f32..10.0, b in -10f32..10.0) {
            let e: f64 = forward([r, g, b]).iter().map(|&v| f64::from(v) * f64::from(v)).sum();
            let e0: f64 = [r, g, b].iter().map(|&v| f64::from(v) * f64::from(v)).sum();
            prop_assert!((e - e0).abs() <= 1e-5 * (1.0 + e0));
        }
    }
}
