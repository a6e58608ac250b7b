//! Logistic mixing of binary predictions, in integers.
//!
//! Several models predict one decision. Their predictions are added in the logistic domain,
//! `stretch(p) = ln(p / (1 - p))`, with weights that follow the coding error (the mixer of
//! Mahoney's PAQ). The lossless coders of this crate and of its callers use mixing; the lossy ones do
//! not.

use crate::coder::Coder;
use crate::logistic::squash;
use crate::model::Bit;

/// Weights of `N` predictions in one mixing context.
#[derive(Clone, Copy, Debug)]
pub struct Mixer<const N: usize>([i32; N]);

impl<const N: usize> Mixer<N> {
    /// Equal weights that sum to `sum / 65536`.
    #[must_use]
    pub fn new(sum: i32) -> Self {
        Self([sum / N as i32; N])
    }

    /// The mixed probability of inputs in the stretched domain.
    #[inline]
    pub(crate) fn mix(&self, inputs: &[i32; N]) -> u32 {
        let mut dot = 0i64;
        for (w, x) in self.0.iter().zip(inputs) {
            dot += i64::from(*w) * i64::from(*x);
        }
        squash((dot >> 16) as i32)
    }

    /// Moves the weights along the coding error; `rate` is about 2 (slow) to 16 (fast).
    #[inline]
    pub(crate) fn update(&mut self, inputs: &[i32; N], p1: u32, bit: bool, rate: i32) {
        let err = ((i32::from(bit) << 16) - p1 as i32) * rate;
        for (w, x) in self.0.iter_mut().zip(inputs) {
            // The product fits 32 bits for rates up to 16. A hostile stream may wrap a weight.
            *w = w.wrapping_add((*x * err + (1 << 17)) >> 18);
        }
    }
}

/// How fast mixers learn.
const RATE: i32 = 3;

/// Codes one decision with the mixed prediction of the models `bits`; then these and the mixer
/// learn it.
#[inline(always)]
pub fn code_mixed<const N: usize, C: Coder>(
    coder: &mut C,
    mixer: &mut Mixer<N>,
    bits: [&mut Bit; N],
    bit: bool,
    limit: u32,
) -> bool {
    let mut inputs = [0; N];
    for (x, b) in inputs.iter_mut().zip(&bits) {
        *x = b.stretched();
    }
    let p1 = mixer.mix(&inputs);
    let bit = coder.decision(p1 >> 1, bit);
    mixer.update(&inputs, p1, bit, RATE);
    for b in bits {
        b.learn(bit, limit);
    }
    bit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mixer_finds_the_input_that_knows() {
        let mut m = Mixer::<2>::new(65_536);
        let mut s = 1u32;
        let mut right = 0;
        for i in 0..4000 {
            s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let bit = s >> 31 == 1;
            let noise = if s >> 20 & 1 == 1 { 600 } else { -600 };
            let inputs = [if bit { 600 } else { -600 }, noise];
            let p1 = m.mix(&inputs);
            right += u32::from(i >= 2000 && (p1 > 65536 * 3 / 4) == bit);
            m.update(&inputs, p1, bit, 4);
        }
        assert!(right > 1990, "{right}");
    }

    /// The greatest error times the greatest input at the greatest rate fits 32 bits.
    #[test]
    fn no_update_overflows() {
        for x in [-2048, 2047] {
            for (p1, bit) in [(32, true), (65504, false)] {
                let mut m = Mixer::<1>::new(65_536);
                for _ in 0..100_000 {
                    m.update(&[x], p1, bit, 16);
                }
                assert!((32..=65504).contains(&m.mix(&[x])));
            }
        }
    }
}
