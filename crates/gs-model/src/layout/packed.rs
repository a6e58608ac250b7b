//! 32 bytes for each Gaussian, and a word for each SH coefficient: the arrays of Spark's `ExtSplats`, which
//! the PlayCanvas adapter reads too.
//!
//! | word | of `a` | of `b` |
//! |---|---|---|
//! | 0 | x, f32 | red, green, f16 |
//! | 1 | y, f32 | blue, logarithm of the scale along x, f16 |
//! | 2 | z, f32 | logarithms of the scales along y and z, f16 |
//! | 3 | opacity, f16 | rotation |
//!
//! A rotation is its axis on an octahedron, two numbers of 10 bits, and its angle in 12 bits. A coefficient
//! is three magnitudes of 8 bits, their signs, and a common exponent of 5 bits.

use super::{colour, unit};
use crate::scene::Scene;
use half::f16;

/// Words of `a`, of `b`, and of each array of SH coefficients.
pub const WORDS: usize = 4;

/// The highest SH degree of a coefficient in each of the four arrays of SH coefficients: degree 1 and the first
/// coefficient of degree 2, the others of degree 2, and two arrays of degree 3.
pub const SH_DEGREES: [u8; 4] = [1, 2, 3, 3];

/// The words of `a`.
#[must_use]
pub fn a(scene: &Scene, i: usize) -> [u32; WORDS] {
    let [x, y, z] = scene.means[i].map(f32::to_bits);
    let [.., opacity] = colour(scene, i);
    [x, y, z, half_bits(opacity)]
}

/// The words of `b`.
#[must_use]
pub fn b(scene: &Scene, i: usize) -> [u32; WORDS] {
    let [r, g, b, _] = colour(scene, i).map(half_bits);
    let [sx, sy, sz] = scene.log_scales[i].map(half_bits);
    [r | g << 16, b | sx << 16, sy | sz << 16, rotation(scene.rotations[i])]
}

/// The words of one of the arrays of [`SH_DEGREES`]; 0 for coefficients that the scene does not have.
#[must_use]
pub fn sh(scene: &Scene, i: usize, array: usize) -> [u32; WORDS] {
    let sh = scene.sh_of(i);
    std::array::from_fn(|k| sh.get(1 + WORDS * array + k).map_or(0, |&c| coefficient(c)))
}

fn half_bits(v: f32) -> u32 {
    f16::from_f32(v).to_bits().into()
}

/// A rotation as axis and angle in 32 bits.
fn rotation(rotation: [f32; 4]) -> u32 {
    let sign = if rotation[0] < 0.0 { -1.0 } else { 1.0 };
    let [w, axis @ ..] = unit(rotation).map(|v| sign * v);
    let angle = 2.0 * libm::acosf(w.min(1.0));
    let sum: f32 = axis.iter().map(|v| v.abs()).sum();
    // The axis of no rotation does not matter.
    let [x, y, z] = if sum < 1e-6 { [1.0, 0.0, 0.0] } else { axis.map(|v| v / sum) };
    let away = |v: f32, other: f32| (1.0 - other.abs()) * if v < 0.0 { -1.0 } else { 1.0 };
    let (u, v) = if z < 0.0 { (away(x, y), away(y, x)) } else { (x, y) };
    let ten = |v: f32| (v * 511.5 + 512.0) as u32;
    let twelve = (angle * (4095.0 / std::f32::consts::PI) + 0.5) as u32;
    twelve.min(4095) << 20 | ten(v) << 10 | ten(u)
}

/// A coefficient as magnitudes, signs and the least exponent that holds them.
fn coefficient(rgb: [f32; 3]) -> u32 {
    let greatest = rgb.iter().fold(0.0f32, |m, v: &f32| m.max(v.abs()));
    // The exponent of a float rounds down: one more holds all below the next power of two.
    let exponent = (greatest.to_bits() >> 23) as i32 - 127 + 1;
    let biased = (exponent + 15).clamp(0, 31);
    // 2^(15 - biased), from its bits.
    let scale = 255.0 * f32::from_bits(((15 - biased + 127) as u32) << 23);
    let mut word = (biased as u32) << 27;
    for (k, v) in rgb.into_iter().enumerate() {
        let magnitude = (v.abs() * scale + 0.5) as u8;
        word |= u32::from(magnitude) << (8 * k) | u32::from(v < 0.0) << (24 + k);
    }
    word
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What Spark's shader makes of a word.
    fn decoded(word: u32) -> [f32; 3] {
        let scale = libm::exp2f((word >> 27) as f32 - 15.0) / 255.0;
        [0, 1, 2].map(|k| {
            let v = ((word >> (8 * k)) & 255) as f32 * scale;
            if word >> (24 + k) & 1 == 1 { -v } else { v }
        })
    }

    #[test]
    fn coefficients_are_within_half_a_step() {
        for rgb in
            [[0.3, -0.2, 0.0], [1.0, -1.0, 0.5], [1e-9, 0.0, 0.0], [0.0; 3], [5.0, 0.1, -3.9]]
        {
            let greatest = rgb.iter().fold(0.0f32, |m, v: &f32| m.max(v.abs()));
            let back = decoded(coefficient(rgb));
            for (a, b) in rgb.into_iter().zip(back) {
                // Half a step of the exponent, and the rounding of this test.
                assert!((a - b).abs() <= 1.0001 * greatest.max(1e-4) / 255.0, "{rgb:?} {back:?}");
            }
        }
    }

    /// What Spark's shader makes of a rotation.
    fn rotation_of(word: u32) -> [f32; 4] {
        let unit = |v: u32| (v & 1023) as f32 / 1023.0 * 2.0 - 1.0;
        let (x, y) = (unit(word), unit(word >> 10));
        let z = 1.0 - x.abs() - y.abs();
        let t = (-z).max(0.0);
        let fold = |v: f32| if v >= 0.0 { v - t } else { v + t };
        let axis = [fold(x), fold(y), z];
        let length = axis.iter().map(|v| v * v).sum::<f32>().sqrt();
        let half = (word >> 20) as f32 / 4095.0 * std::f32::consts::PI / 2.0;
        let [x, y, z] = axis.map(|v| v / length * libm::sinf(half));
        [libm::cosf(half), x, y, z]
    }

    #[test]
    fn rotations_are_as_near_as_the_layout_allows() {
        let mut state = 1u32;
        for _ in 0..2000 {
            let mut q = [0.0f32; 4];
            for v in &mut q {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *v = (state >> 8) as f32 / (1 << 23) as f32 - 1.0;
            }
            let length = q.iter().map(|v| v * v).sum::<f32>().sqrt();
            let back = rotation_of(rotation(q));
            let dot: f32 = q.iter().zip(back).map(|(a, b)| a / length * b).sum();
            let degrees = 2.0 * libm::acosf(dot.abs().min(1.0)).to_degrees();
            // Half a step of the axis at the edges of the octahedron, for half a turn.
            assert!(degrees < 0.46, "{q:?} {back:?} {degrees}");
        }
        assert_eq!(rotation([1.0, 0.0, 0.0, 0.0]) >> 20, 0);
    }
}
