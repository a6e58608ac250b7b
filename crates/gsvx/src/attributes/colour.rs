//! Decorrelation of the three colour channels of one SH coefficient.
//!
//! The transform is orthonormal, so a quantisation step means the same error in every
//! plane: Y = (R+G+B)/sqrt 3, Co = (R-B)/sqrt 2, Cg = (-R+2G-B)/sqrt 6.

/// 1/sqrt 3, 1/sqrt 2, 1/sqrt 6.
const A: f64 = 0.577_350_269_189_625_8;
const B: f64 = std::f64::consts::FRAC_1_SQRT_2;
const C: f64 = 0.408_248_290_463_863;

/// RGB to luma and two chroma planes.
#[must_use]
pub fn forward(rgb: [f32; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(f64::from);
    [(r + g + b) * A, (r - b) * B, (g + g - r - b) * C]
}

/// One plane of [`forward`]: 0 luma, 1 and 2 chroma.
#[must_use]
pub fn forward_plane(rgb: [f32; 3], plane: usize) -> f64 {
    let [r, g, b] = rgb.map(f64::from);
    match plane {
        0 => (r + g + b) * A,
        1 => (r - b) * B,
        _ => (g + g - r - b) * C,
    }
}

/// The inverse of [`forward`].
#[must_use]
pub fn inverse(ycc: [f64; 3]) -> [f32; 3] {
    let [y, o, g] = [ycc[0] * A, ycc[1] * B, ycc[2] * C];
    [(y + o - g) as f32, (y + g + g) as f32, (y - o - g) as f32]
}

#[cfg(test)]
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
        fn planes_are_those_of_forward(r in -10f32..10.0, g in -10f32..10.0, b in -10f32..10.0) {
            let rgb = [r, g, b];
            prop_assert_eq!([0, 1, 2].map(|p| forward_plane(rgb, p)), forward(rgb));
        }

        #[test]
        fn forward_keeps_energy(r in -10f32..10.0, g in -10f32..10.0, b in -10f32..10.0) {
            let e: f64 = forward([r, g, b]).iter().map(|v| v * v).sum();
            let e0: f64 = [r, g, b].iter().map(|&v| f64::from(v) * f64::from(v)).sum();
            prop_assert!((e - e0).abs() <= 1e-9 * (1.0 + e0));
        }
    }
}
