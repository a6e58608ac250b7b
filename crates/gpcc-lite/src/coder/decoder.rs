//! Reads a stream, symbol by symbol.

use super::{Coder, ESCAPE, LOWEST, STATES, code_rest};
use crate::bit::Bit;
use crate::bytes::{BitReader, ByteReader};
use crate::error::{Error, Result};
use crate::symbols::{SCALE_BITS, Symbols};
use multiversion::multiversion;

/// The decoder half of the [coder](super).
#[derive(Clone, Debug)]
pub struct RansDecoder<'a> {
    states: [u32; STATES],
    /// Number of symbols decoded so far, modulo [`STATES`].
    turn: usize,
    words: &'a [[u8; 2]],
    /// Words taken so far.
    taken: usize,
    plain: BitReader<'a>,
}

impl<'a> RansDecoder<'a> {
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
        let mut r = ByteReader::new(data);
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

    /// Decodes values one after another, each by the model of its context. `decode` takes a model and a code, and returns
    /// the value and its interval.
    #[inline(always)]
    fn each<M, V>(
        &mut self,
        models: &mut [M],
        contexts: &[u8],
        values: &mut [V],
        decode: impl Fn(&mut M, u32) -> (V, u32, u32),
    ) {
        // In registers: the states in the order of their turns.
        let mut states: [u32; STATES] =
            std::array::from_fn(|i| self.states[(self.turn + i) % STATES]);
        let (words, mut taken) = (self.words, self.taken);
        let mut one = |state: &mut u32, context: u8, value: &mut V| {
            let code = *state & ((1 << SCALE_BITS) - 1);
            let (start, size);
            (*value, start, size) = decode(&mut models[usize::from(context)], code);
            *state = refilled(outside(*state, code - start, size), words, &mut taken);
        };
        let (contexts, last_contexts) = contexts.as_chunks::<STATES>();
        let (values, last_values) = values.as_chunks_mut::<STATES>();
        for (contexts, values) in contexts.iter().zip(values) {
            for i in 0..STATES {
                one(&mut states[i], contexts[i], &mut values[i]);
            }
        }
        for (i, (&context, value)) in last_contexts.iter().zip(last_values).enumerate() {
            one(&mut states[i], context, value);
        }
        self.taken = taken;
        for (i, state) in states.into_iter().enumerate() {
            self.states[(self.turn + i) % STATES] = state;
        }
        self.turn = (self.turn + last_contexts.len()) % STATES;
    }

    /// The rest of one level.
    #[cold]
    #[inline(never)]
    fn rest(&mut self, symbol: u32, shift: u32) -> i32 {
        code_rest(self, symbol, shift, 0)
    }

    /// Removes the symbol with this interval from state `x`, the state whose turn it is.
    #[inline(always)]
    fn advance(&mut self, x: u32, code: u32, start: u32, size: u32) {
        let x = outside(x, code - start, size);
        self.states[self.turn] = refilled(x, self.words, &mut self.taken);
        self.turn = (self.turn + 1) % STATES;
    }
}

/// What remains of state `x` when an interval of this size is taken out of it. `place` is that of the code in the
/// interval.
#[inline(always)]
fn outside(x: u32, place: u32, size: u32) -> u32 {
    size.wrapping_mul(x >> SCALE_BITS).wrapping_add(place)
}

/// The state with another word, if it is low.
#[inline(always)]
fn refilled(x: u32, words: &[[u8; 2]], taken: &mut usize) -> u32 {
    // Whether a word is taken cannot be predicted: no branch.
    let word = words.get(*taken).map_or(0, |w| u16::from_le_bytes(*w));
    let take = x < LOWEST;
    *taken += usize::from(take);
    std::hint::select_unpredictable(take, x << 16 | u32::from(word), x)
}

impl Coder for RansDecoder<'_> {
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

    fn decisions(&mut self, models: &mut [Bit], contexts: &[u8], limit: u32, values: &mut [bool]) {
        decisions(self, models, contexts, limit, values);
    }

    fn symbols(&mut self, models: &mut [Symbols], contexts: &[u8], values: &mut [u8]) {
        symbols(self, models, contexts, values);
    }

    fn rests(&mut self, symbols: &[u8], shifts: &[u8], levels: &mut [i32]) {
        rests(self, symbols, shifts, levels);
    }

    #[inline]
    fn bits(&mut self, _: u32, n: u32) -> u32 {
        self.plain.get(n)
    }

    #[inline]
    fn bits_and_sign(&mut self, above: u32, _: u32, n: u32, _: bool) -> (u32, bool) {
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

/// [`Coder::decisions`]; with the instructions of newer processors, as the two below.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt"))]
fn decisions(
    coder: &mut RansDecoder<'_>,
    models: &mut [Bit],
    contexts: &[u8],
    limit: u32,
    values: &mut [bool],
) {
    coder.each(models, contexts, values, |model, code| {
        let p1 = model.p1();
        let value = code < p1;
        model.learn(value, limit);
        let (start, size) = if value { (0, p1) } else { (p1, (1 << SCALE_BITS) - p1) };
        (value, start, size)
    });
}

/// [`Coder::symbols`].
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt"))]
fn symbols(
    coder: &mut RansDecoder<'_>,
    models: &mut [Symbols],
    contexts: &[u8],
    values: &mut [u8],
) {
    coder.each(models, contexts, values, |model, code| {
        let symbol = model.find(code);
        let (start, size) = model.interval(symbol);
        model.learn(symbol);
        (symbol as u8, start, size)
    });
}

/// [`Coder::rests`].
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt"))]
fn rests(coder: &mut RansDecoder<'_>, symbols: &[u8], shifts: &[u8], levels: &mut [i32]) {
    // In registers.
    let mut plain = coder.plain;
    for ((&symbol, &shift), level) in symbols.iter().zip(shifts).zip(levels) {
        let (symbol, shift) = (u32::from(symbol), u32::from(shift));
        // One comparison, which can be predicted: of zeros with plain bits, and of many plain bits.
        if shift > (16 * symbol).min(27) || symbol == ESCAPE {
            coder.plain = plain;
            *level = coder.rest(symbol, shift);
            plain = coder.plain;
            continue;
        }
        // Most: how many bits there are does not depend on them.
        let signed = u32::from(symbol != 0);
        let bits = plain.get(shift + signed);
        let sign = (bits & signed) as i32;
        *level = ((symbol << shift | bits >> signed) as i32 ^ -sign) + sign;
    }
    coder.plain = plain;
}
