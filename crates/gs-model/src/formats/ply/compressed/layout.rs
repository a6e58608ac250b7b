//! The bits of a Gaussian's words: how they are decoded, and how they are packed.

use std::path::Path;

use super::CHUNK;
use super::table::TableColumns;
use crate::error::Result;
use crate::formats::splat::opacity_logit;
use crate::math::{completed, smallest_three, unit};
use crate::rows::{self, SH};
use crate::scene::{SH_C0, Scene};

/// Bits of x, y and z in a packed position or scale, the first in the highest bits.
const BITS: [u32; 3] = [11, 10, 11];
/// SH coefficients lie between minus and plus half of this.
pub(super) const SH_RANGE: f32 = 8.0;

/// The elements of a file.
pub(super) struct PackedRows<'a> {
    /// `packed_position`, `packed_rotation`, `packed_scale`, `packed_color` of each Gaussian.
    pub(super) words: TableColumns<'a>,
    /// Minima and maxima of each chunk.
    pub(super) bounds: TableColumns<'a>,
    /// The higher SH coefficients of each Gaussian.
    pub(super) sh: Option<TableColumns<'a>>,
}

impl PackedRows<'_> {
    pub(super) fn scene(&self, file: &Path, n: usize, sh_degree: u8) -> Result<Scene> {
        rows::scene_of(file, n, sh_degree, |i| {
            let [means, rotation, log_scales, colour] = [0, 1, 2, 3].map(|k| self.words.word(i, k));
            let [means, log_scales] = [means, log_scales].map(unpack);
            let (rotation, colour) = (unpack_rotation(rotation), colour.to_be_bytes());
            move |c| match c {
                0..3 => self.between(i, c, means[c]) as f32,
                3..7 => rotation[c - 3],
                7..10 => self.between(i, 6 + c - 7, log_scales[c - 7]) as f32,
                10 => opacity_logit(colour[3]),
                11..14 => {
                    let t = f64::from(colour[c - SH]) / 255.0;
                    ((self.between(i, 12 + c - SH, t) - 0.5) / f64::from(SH_C0)) as f32
                }
                _ => self.sh.as_ref().map_or(0.0, |sh| {
                    let (k, channel) = ((c - SH) / 3, (c - SH) % 3);
                    sh_value(sh.byte(i, channel * (sh.offsets.len() / 3) + k - 1))
                }),
            }
        })
    }

    /// The number between bounds `low` and `low + 3` of a chunk; 0 and 1 where the file has none.
    fn between(&self, index: usize, low: usize, t: f64) -> f64 {
        if low + 3 >= self.bounds.offsets.len() {
            return t;
        }
        let bound = |k: usize| f64::from(self.bounds.float(index / CHUNK, k));
        // A bound may be infinite: that of a scale of 0 is.
        match t {
            0.0 => bound(low),
            1.0 => bound(low + 3),
            _ => bound(low) * (1.0 - t) + bound(low + 3) * t,
        }
    }
}

/// The coefficient of a byte: the middle of its step, but the ends of the range for the first and the
/// last.
fn sh_value(byte: u8) -> f32 {
    let t = match byte {
        0 => 0.0,
        255 => 1.0,
        _ => (f32::from(byte) + 0.5) / 256.0,
    };
    (t - 0.5) * SH_RANGE
}

/// The byte of a coefficient.
pub(super) fn sh_byte(value: f32) -> u8 {
    ((value / SH_RANGE + 0.5) * 256.0) as u8
}

/// Three numbers from 0 to 1.
fn unpack(word: u32) -> [f64; 3] {
    let steps = [word >> 21, word >> 11 & 1023, word & 2047];
    std::array::from_fn(|k| f64::from(steps[k]) / f64::from((1u32 << BITS[k]) - 1))
}

/// The word of three numbers from 0 to 1.
pub(super) fn pack(parts: [f64; 3]) -> u32 {
    let mut word = 0;
    for (t, bits) in parts.into_iter().zip(BITS) {
        word = word << bits | step(t, bits);
    }
    word
}

/// The nearest of `2^bits` steps from 0 to 1.
pub(super) fn step(t: f64, bits: u32) -> u32 {
    let most = (1u32 << bits) - 1;
    libm::floor(t * f64::from(most) + 0.5).clamp(0.0, f64::from(most)) as u32
}

/// The top two bits say which of w, x, y, z is largest and left out; the others follow.
fn unpack_rotation(word: u32) -> [f32; 4] {
    let part = |shift: u32| f64::from(word >> shift & 1023) / 1023.0;
    completed(
        (word >> 30) as usize,
        [20, 10, 0].map(|shift| (part(shift) - 0.5) * std::f64::consts::SQRT_2),
    )
}

/// The word of a quaternion `[w, x, y, z]` of any norm; the identity for one without direction.
pub(super) fn pack_rotation(q: [f32; 4]) -> u32 {
    let (largest, others) = smallest_three(unit(q));
    others.iter().fold(largest as u32, |word, v| {
        word << 10 | step(v * std::f64::consts::FRAC_1_SQRT_2 + 0.5, 10)
    })
}
