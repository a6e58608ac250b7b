//! Binary range coder with 64-bit state and 16-bit probabilities.
//!
//! The interval is `[low, low + range)` with `range >= 2^32` before every decision, so a
//! probability loses at most 2^-16 of itself to rounding. Words of 32 bits leave the coder; a
//! carry walks back through the bytes already written. The decoder reads zeros after the end,
//! and the encoder drops the zero bytes at the end of its last eight.

/// Both directions of the coder behind one face, so a model is written once.
///
/// The encoder codes the `bit` (or value) it is given and returns it; the decoder ignores the
/// argument and returns what it read.
pub trait BinaryCoder {
    /// True for the encoder.
    const ENCODING: bool;

    /// Codes one decision whose probability of being true is `p1 / 65536`, `1 <= p1 <= 65535`.
    fn code(&mut self, p1: u32, bit: bool) -> bool;

    /// Codes `n <= 16` equiprobable bits.
    fn code_raw(&mut self, value: u32, n: u32) -> u32;

    /// Codes `n <= 32` equiprobable bits.
    #[inline]
    fn code_raw_wide(&mut self, value: u32, n: u32) -> u32 {
        if n <= 16 {
            return self.code_raw(value, n);
        }
        let high = self.code_raw(value >> 16, n - 16);
        (high << 16) | self.code_raw(value & 0xffff, 16)
    }

    /// True when the decoder has read further past the end than any encoder's stream goes.
    fn exhausted(&self) -> bool;
}

/// The encoder half of the [range coder](self).
#[derive(Clone, Debug)]
pub struct RangeEncoder {
    out: Vec<u8>,
    low: u64,
    range: u64,
}

impl Default for RangeEncoder {
    fn default() -> Self {
        Self::new()
    }
}

impl RangeEncoder {
    /// An empty stream.
    #[must_use]
    pub fn new() -> Self {
        Self { out: Vec::new(), low: 0, range: u64::MAX }
    }

    /// Bytes written so far, without what is still in the state.
    #[must_use]
    pub fn len(&self) -> usize {
        self.out.len()
    }

    /// True before the first byte has left the coder.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.out.is_empty()
    }

    #[cold]
    fn carry(&mut self) {
        for b in self.out.iter_mut().rev() {
            let (v, over) = b.overflowing_add(1);
            *b = v;
            if !over {
                break;
            }
        }
    }

    #[inline]
    fn add(&mut self, v: u64) {
        let (low, over) = self.low.overflowing_add(v);
        self.low = low;
        if over {
            self.carry();
        }
    }

    #[inline]
    fn renormalise(&mut self) {
        if self.range < 1 << 32 {
            self.out.extend_from_slice(&((self.low >> 32) as u32).to_be_bytes());
            self.low <<= 32;
            self.range <<= 32;
        }
    }

    /// Ends the stream: the shortest byte string that lies in the final interval.
    #[must_use]
    pub fn finish(mut self) -> Vec<u8> {
        // The value with the most trailing zero bits in [low, low + range).
        for zeros in (0..64).rev() {
            let mask = (1u64 << zeros) - 1;
            let (up, over) = self.low.overflowing_add(mask);
            let value = up & !mask;
            // Distance from low, modulo 2^64, tells whether it is still inside.
            if value.wrapping_sub(self.low) < self.range {
                if over {
                    self.carry();
                }
                let kept = 8 - (value.trailing_zeros() / 8).min(8) as usize;
                self.out.extend_from_slice(&value.to_be_bytes()[..kept]);
                break;
            }
        }
        self.out
    }
}

impl BinaryCoder for RangeEncoder {
    const ENCODING: bool = true;

    #[inline]
    fn code(&mut self, p1: u32, bit: bool) -> bool {
        debug_assert!((1..=65535).contains(&p1));
        let bound = (self.range >> 16) * u64::from(p1);
        if bit {
            self.range = bound;
        } else {
            self.add(bound);
            self.range -= bound;
        }
        self.renormalise();
        bit
    }

    #[inline]
    fn code_raw(&mut self, value: u32, n: u32) -> u32 {
        debug_assert!(n <= 16 && u64::from(value) < 1 << n);
        self.range >>= n;
        self.add(self.range * u64::from(value));
        self.renormalise();
        value
    }

    fn exhausted(&self) -> bool {
        false
    }
}

impl RangeEncoder {
    /// Codes a symbol of frequency `size` in `2^bits`, with `start` before it.
    #[inline]
    pub(crate) fn code_part(&mut self, bits: u32, start: u32, size: u32) {
        let part = self.range >> bits;
        self.add(part * u64::from(start));
        self.range = part * u64::from(size);
        self.renormalise();
    }
}

/// The decoder half of the [range coder](self).
#[derive(Clone, Debug)]
pub struct RangeDecoder<'a> {
    data: &'a [u8],
    pos: usize,
    code: u64,
    range: u64,
}

impl<'a> RangeDecoder<'a> {
    /// Starts at the first byte of `data`, which holds one stream and nothing else.
    #[must_use]
    pub fn new(data: &'a [u8]) -> Self {
        let mut d = Self { data, pos: 0, code: 0, range: u64::MAX };
        d.code = (u64::from(d.word()) << 32) | u64::from(d.word());
        d
    }

    #[inline]
    fn word(&mut self) -> u32 {
        let at = self.pos;
        self.pos = at.saturating_add(4);
        if let Some(w) = self.data.get(at..at + 4) {
            return u32::from_be_bytes([w[0], w[1], w[2], w[3]]);
        }
        let mut w = [0u8; 4];
        if let Some(tail) = self.data.get(at..) {
            w[..tail.len()].copy_from_slice(tail);
        }
        u32::from_be_bytes(w)
    }

    #[inline]
    fn renormalise(&mut self) {
        if self.range < 1 << 32 {
            self.code = (self.code << 32) | u64::from(self.word());
            self.range <<= 32;
        }
    }
}

impl BinaryCoder for RangeDecoder<'_> {
    const ENCODING: bool = false;

    #[inline]
    fn code(&mut self, p1: u32, _bit: bool) -> bool {
        debug_assert!((1..=65535).contains(&p1));
        let bound = (self.range >> 16) * u64::from(p1);
        let bit = self.code < bound;
        if bit {
            self.range = bound;
        } else {
            self.code -= bound;
            self.range -= bound;
        }
        self.renormalise();
        bit
    }

    #[inline]
    fn code_raw(&mut self, _value: u32, n: u32) -> u32 {
        self.range >>= n;
        let v = (self.code / self.range).min((1 << n) - 1);
        // wrapping: only a stream no encoder wrote has code beyond the interval.
        self.code = self.code.wrapping_sub(v * self.range);
        self.renormalise();
        v as u32
    }

    fn exhausted(&self) -> bool {
        // The state reads 8 bytes ahead, and up to 8 zero bytes were dropped.
        self.pos > self.data.len() + 16
    }
}

impl RangeDecoder<'_> {
    /// Decodes a symbol: `find` has the place of each of the `2^bits` codes, the frequency before a symbol,
    /// and its own.
    #[inline]
    pub(crate) fn code_part(
        &mut self,
        bits: u32,
        find: impl FnOnce(u32) -> (usize, u32, u32),
    ) -> usize {
        let part = self.range >> bits;
        let (symbol, start, size) = find((self.code / part).min((1 << bits) - 1) as u32);
        // wrapping: only a stream no encoder wrote has code beyond the interval.
        self.code = self.code.wrapping_sub(part * u64::from(start));
        self.range = part * u64::from(size);
        self.renormalise();
        symbol
    }
}
