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

use crate::bytes::{BitReader, BitWriter, Reader, put_varint};
use crate::error::{Error, Result};
use crate::model::Symbols;

/// Interval sizes sum to `2^SCALE_BITS`.
pub(crate) const SCALE_BITS: u32 = 15;
/// Number of states.
const STATES: usize = 4;
/// Intervals that an encoder keeps in one piece; a multiple of [`STATES`].
const BLOCK: usize = 1 << 16;
/// Least value of a state between two symbols, and the state before the first symbol is encoded.
const LOWEST: u32 = 1 << 16;

/// Both directions of the coder behind one interface, so that a model is written once.
///
/// The encoder codes the value that it is given and returns it. The decoder ignores the argument
/// and returns what it reads.
pub trait Coder {
    /// True for the encoder.
    const ENCODING: bool;

    /// Codes a decision whose probability of being true is `p1 / 2^15`, `0 < p1 < 2^15`.
    fn decision(&mut self, p1: u32, value: bool) -> bool;

    /// Codes one symbol by its model, and the model learns it.
    fn symbol(&mut self, model: &mut Symbols, value: usize) -> usize;

    /// Codes one symbol after another, each by the model of its context. The decoder fills `values` in.
    fn symbols(&mut self, models: &mut [Symbols], contexts: &[u8], values: &mut [u8]);

    /// Codes `n <= 32` plain bits; `value` must be below `2^n`.
    fn bits(&mut self, value: u32, n: u32) -> u32;

    /// Codes plain bits (value and number, at most 30) and then a sign, if they or what is `above` them
    /// is not zero.
    fn bits_and_sign(&mut self, above: u32, value: (u32, u32), negative: bool) -> (u32, bool);

    /// True when the decoder has read past the end: the stream is truncated or damaged.
    fn exhausted(&self) -> bool;
}

/// The encoder half of the [coder](self).
#[derive(Clone, Debug, Default)]
pub struct Encoder {
    /// Start in the low 16 bits, size in the high 16. In blocks, since a growing list would be in memory
    /// twice while it is moved.
    intervals: Vec<Vec<u32>>,
    plain: BitWriter,
}

impl Encoder {
    #[inline]
    fn interval(&mut self, start: u32, size: u32) {
        debug_assert!(size > 0 && start + size <= 1 << SCALE_BITS);
        match self.intervals.last_mut() {
            Some(block) if block.len() < BLOCK => block.push(start | size << 16),
            _ => {
                let mut block = Vec::with_capacity(BLOCK);
                block.push(start | size << 16);
                self.intervals.push(block);
            }
        }
    }

    /// True if nothing was coded yet.
    fn is_empty(&self) -> bool {
        self.intervals.is_empty() && self.plain.is_empty()
    }

    /// Ends the stream and returns its bytes: none if nothing was coded.
    #[must_use]
    pub fn finish(self) -> Vec<u8> {
        if self.is_empty() {
            return Vec::new();
        }
        let mut states = [LOWEST; STATES];
        let mut words: Vec<u16> = Vec::new();
        let blocks = self.intervals.into_iter().rev();
        let last_first = blocks.flat_map(|block| block.into_iter().enumerate().rev());
        for (i, interval) in last_first {
            let (start, size) = (interval & 0xffff, interval >> 16);
            let x = &mut states[i % STATES];
            // The result must stay below 2^32.
            if u64::from(*x) >= u64::from(size) << (32 - SCALE_BITS) {
                words.push(*x as u16);
                *x >>= 16;
            }
            *x = (*x / size) << SCALE_BITS | (*x % size + start);
        }
        let mut out = Vec::with_capacity(2 * words.len() + 32);
        put_varint(&mut out, words.len() as u64);
        out.extend(states.iter().flat_map(|x| x.to_le_bytes()));
        out.extend(words.iter().rev().flat_map(|w| w.to_le_bytes()));
        out.extend(self.plain.finish());
        out
    }
}

impl Coder for Encoder {
    const ENCODING: bool = true;

    #[inline]
    fn decision(&mut self, p1: u32, value: bool) -> bool {
        if value {
            self.interval(0, p1);
        } else {
            self.interval(p1, (1 << SCALE_BITS) - p1);
        }
        value
    }

    #[inline]
    fn symbol(&mut self, model: &mut Symbols, value: usize) -> usize {
        let (start, size) = model.interval(value);
        self.interval(start, size);
        model.learn(value);
        value
    }

    fn symbols(&mut self, models: &mut [Symbols], contexts: &[u8], values: &mut [u8]) {
        for (&context, value) in contexts.iter().zip(values) {
            self.symbol(&mut models[usize::from(context)], usize::from(*value));
        }
    }

    #[inline]
    fn bits(&mut self, value: u32, n: u32) -> u32 {
        self.plain.put(value, n);
        value
    }

    #[inline]
    fn bits_and_sign(&mut self, above: u32, (value, n): (u32, u32), negative: bool) -> (u32, bool) {
        self.plain.put(value, n);
        self.plain.put(u32::from(negative), u32::from(above | value != 0));
        (value, negative)
    }

    fn exhausted(&self) -> bool {
        false
    }
}

/// Counts what an [`Encoder`] would write, without writing it.
#[derive(Clone, Copy, Debug)]
pub struct Tally {
    /// Whole bits.
    bits: u64,
    /// The product of the probabilities of what is not in `bits` yet, above 2^-512.
    probability: f64,
}

impl Default for Tally {
    fn default() -> Self {
        Self { bits: 0, probability: 1.0 }
    }
}

/// 2^-512 and its inverse.
const SMALL: f64 = f64::from_bits((1023 - 512) << 52);
const LARGE: f64 = f64::from_bits((1023 + 512) << 52);

impl Tally {
    /// The number of bits so far, rounded to whole bits.
    #[must_use]
    pub fn bits(&self) -> u64 {
        self.bits + (1023 - (self.probability.to_bits() >> 52))
    }

    #[inline]
    fn interval(&mut self, size: u32) {
        self.probability *= f64::from(size) * (1.0 / f64::from(1u32 << SCALE_BITS));
        if self.probability < SMALL {
            self.probability *= LARGE;
            self.bits += 512;
        }
    }
}

impl Coder for Tally {
    const ENCODING: bool = true;

    #[inline]
    fn decision(&mut self, p1: u32, value: bool) -> bool {
        self.interval(if value { p1 } else { (1 << SCALE_BITS) - p1 });
        value
    }

    #[inline]
    fn symbol(&mut self, model: &mut Symbols, value: usize) -> usize {
        self.interval(model.interval(value).1);
        model.learn(value);
        value
    }

    fn symbols(&mut self, models: &mut [Symbols], contexts: &[u8], values: &mut [u8]) {
        for (&context, value) in contexts.iter().zip(values) {
            self.symbol(&mut models[usize::from(context)], usize::from(*value));
        }
    }

    #[inline]
    fn bits(&mut self, value: u32, n: u32) -> u32 {
        self.bits += u64::from(n);
        value
    }

    #[inline]
    fn bits_and_sign(&mut self, above: u32, (value, n): (u32, u32), negative: bool) -> (u32, bool) {
        self.bits += u64::from(n) + u64::from(above | value != 0);
        (value, negative)
    }

    fn exhausted(&self) -> bool {
        false
    }
}

/// The decoder half of the [coder](self).
#[derive(Clone, Debug)]
pub struct Decoder<'a> {
    states: [u32; STATES],
    /// Number of symbols decoded so far, modulo [`STATES`].
    turn: usize,
    words: &'a [[u8; 2]],
    /// Words taken so far.
    taken: usize,
    plain: BitReader<'a>,
}

impl<'a> Decoder<'a> {
    /// A decoder of the stream `data`.
    ///
    /// # Errors
    /// [`Error::Truncated`] or [`Error::Corrupt`] if the head of the stream is damaged.
    pub fn new(data: &'a [u8]) -> Result<Self> {
        let mut states = [LOWEST; STATES];
        if data.is_empty() {
            let plain = BitReader::new(data);
            return Ok(Self { states, turn: 0, words: &[], taken: 0, plain });
        }
        let mut r = Reader::new(data);
        let words = r.varint("number of words")?;
        for x in &mut states {
            let b = r.bytes(4, "rANS state")?;
            *x = u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
            if *x < LOWEST {
                return Err(r.corrupt("rANS state"));
            }
        }
        let words = r.bytes(words.saturating_mul(2), "rANS words")?;
        let (words, _) = words.as_chunks::<2>();
        Ok(Self { states, turn: 0, words, taken: 0, plain: BitReader::new(&data[r.pos()..]) })
    }

    /// Whether the stream ends here, as a whole stream does: all words and all bytes of plain bits are
    /// taken, and the states are those that the encoder began with.
    ///
    /// # Errors
    /// [`Error::Truncated`] or [`Error::Corrupt`].
    pub fn finish(&self) -> Result<()> {
        if self.exhausted() {
            return Err(Error::Truncated { offset: self.taken * 2, what: "entropy-coded data" });
        }
        let whole = self.taken == self.words.len() && self.plain.at_end();
        if !whole || self.states != [LOWEST; STATES] {
            return Err(Error::Corrupt { offset: self.taken * 2, what: "entropy-coded data" });
        }
        Ok(())
    }

    /// Removes the symbol with this interval from state `x`, the state whose turn it is.
    #[inline(always)]
    fn advance(&mut self, x: u32, code: u32, start: u32, size: u32) {
        self.states[self.turn] = next_state(x, code, start, size, self.words, &mut self.taken);
        self.turn = (self.turn + 1) % STATES;
    }
}

/// The state after an interval was taken out of `x`.
#[inline(always)]
fn next_state(
    x: u32,
    code: u32,
    start: u32,
    size: u32,
    words: &[[u8; 2]],
    taken: &mut usize,
) -> u32 {
    let x = size.wrapping_mul(x >> SCALE_BITS).wrapping_add(code - start);
    // Whether a word is taken cannot be predicted: no branch.
    let word = words.get(*taken).map_or(0, |w| u16::from_le_bytes(*w));
    let take = x < LOWEST;
    *taken += usize::from(take);
    std::hint::select_unpredictable(take, x << 16 | u32::from(word), x)
}

impl Coder for Decoder<'_> {
    const ENCODING: bool = false;

    #[inline]
    fn decision(&mut self, p1: u32, _: bool) -> bool {
        let x = self.states[self.turn];
        let code = x & ((1 << SCALE_BITS) - 1);
        let value = code < p1;
        let (start, size) = if value { (0, p1) } else { (p1, (1 << SCALE_BITS) - p1) };
        self.advance(x, code, start, size);
        value
    }

    #[inline]
    fn symbol(&mut self, model: &mut Symbols, _: usize) -> usize {
        let x = self.states[self.turn];
        let code = x & ((1 << SCALE_BITS) - 1);
        let symbol = model.find(code);
        let (start, size) = model.interval(symbol);
        self.advance(x, code, start, size);
        model.learn(symbol);
        symbol
    }

    fn symbols(&mut self, models: &mut [Symbols], contexts: &[u8], values: &mut [u8]) {
        let (contexts, last_contexts) = contexts.as_chunks::<STATES>();
        let (values, last_values) = values.as_chunks_mut::<STATES>();
        // In registers: the states in the order of their turns.
        let mut states: [u32; STATES] =
            std::array::from_fn(|i| self.states[(self.turn + i) % STATES]);
        let (words, mut taken) = (self.words, self.taken);
        for (contexts, values) in contexts.iter().zip(values) {
            for i in 0..STATES {
                let model = &mut models[usize::from(contexts[i])];
                let code = states[i] & ((1 << SCALE_BITS) - 1);
                let symbol = model.find(code);
                let (start, size) = model.interval(symbol);
                states[i] = next_state(states[i], code, start, size, words, &mut taken);
                model.learn(symbol);
                values[i] = symbol as u8;
            }
        }
        self.taken = taken;
        for (i, state) in states.into_iter().enumerate() {
            self.states[(self.turn + i) % STATES] = state;
        }
        for (&context, value) in last_contexts.iter().zip(last_values) {
            *value = self.symbol(&mut models[usize::from(context)], 0) as u8;
        }
    }

    #[inline]
    fn bits(&mut self, _: u32, n: u32) -> u32 {
        self.plain.get(n)
    }

    #[inline]
    fn bits_and_sign(&mut self, above: u32, (_, n): (u32, u32), _: bool) -> (u32, bool) {
        // Both at once, the sign on trial.
        let both = self.plain.peek(n + 1);
        let (value, sign) = (both >> 1, both & 1);
        let signed = u32::from(above | value != 0);
        self.plain.skip(n + signed);
        (value, sign & signed != 0)
    }

    #[inline]
    fn exhausted(&self) -> bool {
        self.taken > self.words.len() || self.plain.overrun()
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Bit;

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
            let mut encoder = Encoder::default();
            let want = run(&mut encoder, rounds);
            let bytes = encoder.finish();
            assert_eq!(bytes.is_empty(), rounds == 0);
            let mut decoder = Decoder::new(&bytes).unwrap();
            assert_eq!(run(&mut decoder, rounds), want);
            decoder.finish().unwrap();
        }
    }

    #[test]
    fn what_is_cut_off_is_noticed() {
        let mut encoder = Encoder::default();
        run(&mut encoder, 2000);
        let bytes = encoder.finish();
        for len in 0..bytes.len() {
            let cut = Decoder::new(&bytes[..len]);
            let whole = cut.is_ok_and(|mut decoder| {
                run(&mut decoder, 2000);
                decoder.finish().is_ok()
            });
            assert!(!whole, "{len} of {} bytes", bytes.len());
        }
    }

    #[test]
    fn a_likely_decision_takes_little() {
        let mut encoder = Encoder::default();
        for _ in 0..32_000 {
            encoder.decision((1 << SCALE_BITS) - 32, true);
        }
        // -log2(1 - 2^-10) bits each: 5.6 bytes.
        assert!(encoder.finish().len() <= 1 + 16 + 8);
    }
}
