//! The bits of a Gaussian's words: how they are decoded, and how they are packed.

use super::CHUNK;
use super::table::Columns;
use crate::math::{completed, smallest_three, unit};
use crate::rows::SH;
use crate::scene::SH_C0;
use crate::splat::opacity_logit;

/// Bits of x, y and z in a packed position or scale, the first in the highest bits.
const BITS: [u32; 3] = [11, 10, 11];
/// SH coefficients lie between minus and plus half of this.
pub(super) const SH_RANGE: f32 = 8.0;

/// The elements of a file.
pub(super) struct Decoder<'a> {
    /// `packed_position`, `packed_rotation`, `packed_scale`, `packed_color` of each Gaussian.
    pub(super) words: Columns<'a>,
    /// Minima and maxima of each chunk.
    pub(super) bounds: Columns<'a>,
    /// The higher SH coefficients of each Gaussian.
    pub(super) sh: Option<Columns<'a>>,
}

/// One Gaussian.
pub(super) struct Row<'a> {
    decoder: &'a Decoder<'a>,
    index: usize,
    means: [u32; 3],
    log_scales: [u32; 3],
    rotation: [f32; 4],
    colour: [u8; 4],
}

impl Decoder<'_> {
    pub(super) fn row(&self, index: usize) -> Row<'_> {
        let [means, rotation, log_scales, colour] = [0, 1, 2, 3].map(|k| self.words.word(index, k));
        Row {
            decoder: self,
            index,
            means: unpack(means),
            log_scales: unpack(log_scales),
            rotation: unpack_rotation(rotation),
            colour: colour.to_be_bytes(),
        }
    }

    /// The number between bounds `low` and `low + 3` of a chunk; 0 and 1 where the file has none.
    fn between(&self, index: usize, low: usize, t: f64) -> f64 {
        if low + 3 >= self.bounds.offsets.len() {
            return t;
        }
        let bound = |k: usize| f64::from(self.bounds.float(index / CHUNK, k));
        bound(low) * (1.0 - t) + bound(low + 3) * t
    }
}

impl Row<'_> {
    /// Number `c` in scene order.
    pub(super) fn number(&self, c: usize) -> f32 {
        let decoder = self.decoder;
        let part = |k: usize, v: u32| f64::from(v) / f64::from((1u32 << BITS[k]) - 1);
        match c {
            0..3 => decoder.between(self.index, c, part(c, self.means[c])) as f32,
            3..7 => self.rotation[c - 3],
            7..10 => {
                let k = c - 7;
                decoder.between(self.index, 6 + k, part(k, self.log_scales[k])) as f32
            }
            10 => opacity_logit(self.colour[3]),
            11..14 => {
                let k = c - SH;
                let t = f64::from(self.colour[k]) / 255.0;
                ((decoder.between(self.index, 12 + k, t) - 0.5) / f64::from(SH_C0)) as f32
            }
            _ => {
                let (k, channel) = ((c - SH) / 3, (c - SH) % 3);
                decoder.sh.as_ref().map_or(0.0, |sh| {
                    let per_channel = sh.offsets.len() / 3;
                    sh_value(sh.byte(self.index, channel * per_channel + k - 1))
                })
            }
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

fn unpack(word: u32) -> [u32; 3] {
    [word >> 21, word >> 11 & 1023, word & 2047]
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
