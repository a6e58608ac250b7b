//! The entropy coder of every stream: four interleaved rANS states, and plain bits.
//!
//! A model gives every symbol an interval `start..start + size` of `0..2^15`. Symbol number `i` of
//! a stream is coded by state `i mod 4`, so that a processor can work on four symbols at a time.
//! Bits that are as good as random (signs, low bits) do not go through the states: they are stored
//! as they are, after the words of the states.
//!
//! rANS decodes in the opposite order of encoding. The encoder therefore keeps all intervals, and
//! codes them from the last to the first when the stream ends.
//!
//! Invariant: a decoder that uses the same models in the same order reads the values that were
//! coded. On a damaged stream it reads other values, and zeros after the end, until the caller asks
//! [`Coder::exhausted`].
//!
//! Layout and arithmetic: `docs/format.md`, "Entropy coder". Reference: J. Duda, "Asymmetric
//! numeral systems" (2013); F. Giesen, "Interleaved entropy coders" (2014).

mod decoder;
mod encoder;
mod silent;
mod tally;

pub use decoder::RansDecoder;
pub use encoder::RansEncoder;
pub use silent::Silent;
pub use tally::Tally;

use crate::bit::Bit;
use crate::symbols::{SYMBOLS, Symbols};

/// Number of states.
const STATES: usize = 4;
/// Least value of a state between two symbols, and the state before the first symbol is encoded.
const LOWEST: u32 = 1 << 16;

/// The symbol of magnitudes that are this or more.
pub(crate) const ESCAPE: u32 = SYMBOLS as u32 - 1;

/// Both directions of the coder behind one interface, so that a model is written once.
///
/// The encoder codes the value that it is given and returns it. The decoder ignores the argument
/// and returns what it reads.
pub trait Coder {
    /// True for the encoder.
    const ENCODING: bool;
    /// False if the coder drops what it codes, so that callers may skip work for it.
    const HEARD: bool = true;

    /// Codes a decision whose probability of being true is `p1 / 2^15`, `0 < p1 < 2^15`.
    fn decision(&mut self, p1: u32, value: bool) -> bool;

    /// Codes one decision after another, each by the model of its context, which learns it with a limit. The decoder
    /// fills `values` in.
    fn decisions(&mut self, models: &mut [Bit], contexts: &[u8], limit: u32, values: &mut [bool])
    where
        Self: Sized,
    {
        for (&context, value) in contexts.iter().zip(values) {
            let model = &mut models[usize::from(context)];
            *value = self.decision(model.p1(), *value);
            model.learn(*value, limit);
        }
    }

    /// Codes one symbol by its model, and the model learns it.
    fn symbol(&mut self, model: &mut Symbols, value: usize) -> usize;

    /// Codes one symbol after another, each by the model of its context. The decoder fills `values` in.
    fn symbols(&mut self, models: &mut [Symbols], contexts: &[u8], values: &mut [u8]) {
        for (&context, value) in contexts.iter().zip(values) {
            *value = self.symbol(&mut models[usize::from(context)], usize::from(*value)) as u8;
        }
    }

    /// Codes `n <= 32` plain bits; `value` must be below `2^n`.
    fn bits(&mut self, value: u32, n: u32) -> u32;

    /// Codes `n <= 30` plain bits and then a sign, if they or what is `above` them is not zero.
    fn bits_and_sign(&mut self, above: u32, value: u32, n: u32, negative: bool) -> (u32, bool);

    /// Codes the rest of one level after another in plain bits: what its symbol does not say. The decoder fills `levels`
    /// in.
    fn rests(&mut self, symbols: &[u8], shifts: &[u8], levels: &mut [i32])
    where
        Self: Sized,
    {
        for ((&symbol, &shift), level) in symbols.iter().zip(shifts).zip(levels) {
            *level = code_rest(self, symbol.into(), shift.into(), *level);
        }
    }

    /// True when the decoder has read past the end: the stream is truncated or damaged.
    fn exhausted(&self) -> bool;
}

/// Codes a number of any size in plain bits (Elias gamma code): as many zeros as `value + 1` has
/// bits after its leading one, then `value + 1` itself. 32 zeros have no leading one after them.
#[cold]
pub(crate) fn code_gamma<C: Coder>(coder: &mut C, value: u32) -> u32 {
    let v = u64::from(value) + 1;
    let bits = v.ilog2();
    let mut zeros = 0;
    while zeros < 32 && coder.bits(u32::from(zeros == bits), 1) == 0 {
        zeros += 1;
    }
    let low = coder.bits((v & ((1 << zeros) - 1)) as u32, zeros);
    ((1u64 << zeros | u64::from(low)) - 1).min(u64::from(u32::MAX)) as u32
}

/// Codes the rest of a level in plain bits: the excess over the escape symbol, the low bits and the
/// sign.
#[inline(always)]
fn code_rest<C: Coder>(coder: &mut C, symbol: u32, shift: u32, level: i32) -> i32 {
    let magnitude = level.unsigned_abs();
    let mut high = symbol;
    if symbol == ESCAPE {
        let rest = code_gamma(coder, (magnitude >> shift).saturating_sub(ESCAPE));
        high = ESCAPE.saturating_add(rest);
    }
    let high = high.min(i32::MAX as u32 >> shift);
    let low = magnitude & ((1 << shift) - 1);
    let (low, negative) = coder.bits_and_sign(high, low, shift, level < 0);
    let (magnitude, sign) = ((high << shift | low) as i32, -i32::from(negative));
    (magnitude ^ sign).wrapping_sub(sign)
}

/// Codes a signed number in plain bits, the sign in the lowest bit.
pub(crate) fn code_signed<C: Coder>(coder: &mut C, v: i32) -> i32 {
    unfolded(code_gamma(coder, folded(v)))
}

/// A signed number as an unsigned one, the sign in the lowest bit.
#[inline]
pub(crate) fn folded(v: i32) -> u32 {
    (v << 1 ^ v >> 31) as u32
}

/// The inverse of [`folded`].
#[inline]
pub(crate) fn unfolded(u: u32) -> i32 {
    (u >> 1) as i32 ^ -((u & 1) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::symbols::SCALE_BITS;

    /// Symbols, decisions, plain bits and large numbers in turn.
    fn run(coder: &mut impl Coder, rounds: u32) -> Vec<(usize, bool, u32, u32)> {
        let (mut symbols, mut decision) = (Symbols::geometric(700, 6), Bit::default());
        let round = |i: u32| {
            let value = i.wrapping_mul(0x9e37_79b9);
            let symbol = coder.symbol(&mut symbols, value as usize % 7);
            let bit = decision.code(coder, value & 64 != 0, 250);
            let n = i % 33;
            let low = (u64::from(value) & ((1 << n) - 1)) as u32;
            let low = coder.bits(low, n);
            (symbol, bit, low, code_gamma(coder, value >> (i % 32)))
        };
        (0..rounds).map(round).collect()
    }

    #[test]
    fn everything_comes_back() {
        for rounds in [0, 1, 2, 3, 5, 2000] {
            let mut encoder = RansEncoder::default();
            let want = run(&mut encoder, rounds);
            let bytes = encoder.finish();
            assert_eq!(bytes.is_empty(), rounds == 0);
            let mut decoder = RansDecoder::new(&bytes).unwrap();
            assert_eq!(run(&mut decoder, rounds), want);
            decoder.finish().unwrap();
        }
    }

    #[test]
    fn what_is_cut_off_is_noticed() {
        let mut encoder = RansEncoder::default();
        run(&mut encoder, 2000);
        let bytes = encoder.finish();
        for len in 0..bytes.len() {
            let cut = RansDecoder::new(&bytes[..len]);
            let whole = cut.is_ok_and(|mut decoder| {
                run(&mut decoder, 2000);
                decoder.finish().is_ok()
            });
            assert!(!whole, "{len} of {} bytes", bytes.len());
        }
    }

    #[test]
    fn a_likely_decision_takes_little() {
        let mut encoder = RansEncoder::default();
        for _ in 0..32_000 {
            encoder.decision((1 << SCALE_BITS) - 32, true);
        }
        // -log2(1 - 2^-10) bits each: 5.6 bytes.
        assert!(encoder.finish().len() <= 1 + 16 + 8);
    }
}
