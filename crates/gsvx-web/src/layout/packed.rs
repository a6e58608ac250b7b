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

use super::column::Column;
use super::{ArrayLayout, base_colour, opacity};
use gs_model::Scene;
use half::f16;
use js_sys::Object;

/// `a`, `b`, `sh1` (degree 1, and the first coefficient of degree 2), `sh2` (its others), `sh3a` and `sh3b`
/// (degree 3).
pub(crate) struct Packed {
    a: Column<u32>,
    b: Column<u32>,
    sh: Vec<Column<u32>>,
}

/// The arrays of SH coefficients: name, and the highest SH degree of a coefficient in it.
const SH: [(&str, u8); 4] = [("sh1", 1), ("sh2", 2), ("sh3a", 3), ("sh3b", 3)];
/// Coefficients in each of them but the last, which has one less.
const IN_ARRAY: usize = 4;

impl Packed {
    pub(crate) fn of(arrays: &Object, capacity: usize, sh_degree: u8) -> Self {
        let sh = SH.into_iter().filter(|(_, degree)| *degree <= sh_degree);
        Self {
            a: Column::of(arrays, "a", 4, capacity),
            b: Column::of(arrays, "b", 4, capacity),
            sh: sh.map(|(name, _)| Column::of(arrays, name, IN_ARRAY, capacity)).collect(),
        }
    }
}

impl ArrayLayout for Packed {
    fn put(&mut self, first: usize, block: &Scene) {
        for i in 0..block.len() {
            let sh = block.sh_of(i);
            let alpha = half_bits(opacity(block.opacity_logits[i]));
            let [x, y, z] = block.means[i].map(f32::to_bits);
            self.a.block.extend([x, y, z, alpha]);
            let [r, g, b] = sh[0].map(|dc| half_bits(base_colour(dc)));
            let [sx, sy, sz] = block.log_scales[i].map(half_bits);
            let rotation = rotation(block.rotations[i]);
            self.b.block.extend([r | g << 16, b | sx << 16, sy | sz << 16, rotation]);
            let mut rest = sh[1..].iter().copied();
            for column in &mut self.sh {
                let words = (0..IN_ARRAY).map(|_| rest.next().map_or(0, coefficient));
                column.block.extend(words);
            }
        }
        self.a.flush(first);
        self.b.flush(first);
        self.sh.iter_mut().for_each(|column| column.flush(first));
    }
}

fn half_bits(v: f32) -> u32 {
    f16::from_f32(v).to_bits().into()
}

/// A rotation as axis and angle in 32 bits.
fn rotation(rotation: [f32; 4]) -> u32 {
    let length = rotation.iter().map(|v| v * v).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
    let sign = if rotation[0] < 0.0 { -1.0 } else { 1.0 };
    let [w, axis @ ..] = rotation.map(|v| sign * v / length);
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
