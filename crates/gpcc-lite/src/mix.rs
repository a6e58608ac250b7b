//! Logistic mixing of binary predictions, in integers.
//!
//! Several models predict one decision. Their predictions are added in the logistic domain,
//! `stretch(p) = ln(p / (1 - p))`, with weights that follow the coding error (the mixer of
//! Mahoney's PAQ). The tables are computed at compile time from one integer constant, so they are
//! the same on every machine. The lossless coders of this crate and of its callers use mixing; the
//! lossy ones do not.

use crate::coder::Coder;
use crate::model::Bit;

/// `e^(1/256)` with 62 fraction bits.
const EXP_STEP: u128 = 4629735647166717428;

const SQUASH: [u16; 4096] = {
    let mut t = [0u16; 4096];
    let mut e: u128 = 1 << 40; // e^(i/256), 40 fraction bits
    let mut i = 0;
    while i < 2048 {
        let p = (65536 * e + (((1 << 40) + e) >> 1)) / ((1 << 40) + e);
        let p = if p > 65535 - 31 { 65535 - 31 } else { p };
        t[2048 + i] = p as u16;
        t[2048 - i] = (65536 - p) as u16;
        e = (e * EXP_STEP) >> 62;
        i += 1;
    }
    t[0] = t[1];
    t
};

const STRETCH: [i16; 4096] = {
    let mut t = [0i16; 4096];
    let mut i = 0usize;
    let mut p = 0usize;
    while p < 4096 {
        while i < 4095 && (SQUASH[i] as usize) < 16 * p + 8 {
            i += 1;
        }
        t[p] = i as i16 - 2048;
        p += 1;
    }
    t
};

/// [`STRETCH`] of the probabilities that a [`Bit`] codes with, by the top 12 bits of its state.
const STRETCH_STATE: [i16; 4096] = {
    let mut t = STRETCH;
    // The coder's probabilities are at least 32 and at most 65504, in 1/65536.
    t[0] = t[2];
    t[1] = t[2];
    t[4095] = t[4094];
    t
};

/// `ln(p / (1 - p))` of the probability in a [`Bit`], with 8 fraction bits.
#[inline]
pub(crate) fn stretch_of_state(state: u32) -> i32 {
    i32::from(STRETCH_STATE[(state >> 20) as usize])
}

/// The 16-bit probability whose `ln(p / (1 - p))` is `x / 256`, within `[32, 65504]`.
#[inline]
pub(crate) fn squash(x: i32) -> u32 {
    u32::from(SQUASH[(x.clamp(-2047, 2047) + 2048) as usize])
}

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

/// Codes one decision with the mixed prediction of the models `bits`; then these and the mixer
/// learn it.
#[inline(always)]
pub fn code_mixed<const N: usize, C: Coder>(
    coder: &mut C,
    mixer: &mut Mixer<N>,
    bits: [&mut Bit; N],
    bit: bool,
    rate: i32,
    limit: u32,
) -> bool {
    let mut inputs = [0; N];
    for (x, b) in inputs.iter_mut().zip(&bits) {
        *x = b.stretched();
    }
    let p1 = mixer.mix(&inputs);
    let bit = coder.decision(p1 >> 1, bit);
    mixer.update(&inputs, p1, bit, rate);
    for b in bits {
        b.learn(bit, limit);
    }
    bit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[allow(clippy::disallowed_methods, reason = "the definition the tables are compared with")]
    fn squash_is_the_logistic_function() {
        for x in -2047..=2047 {
            let want = 65536.0 / (1.0 + (-f64::from(x) / 256.0).exp());
            let got = f64::from(squash(x));
            assert!((got - want.clamp(32.0, 65504.0)).abs() <= 1.0, "{x}: {got} {want}");
        }
        assert_eq!(squash(i32::MIN), squash(-2047));
        assert_eq!(squash(i32::MAX), squash(2047));
        for p in (64..65472).step_by(16) {
            let back = squash(i32::from(STRETCH[(p >> 4) as usize])) as i32;
            assert!((back - p).abs() <= 16 + p.min(65536 - p) / 100, "{p} {back}");
        }
    }

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
