//! Adaptive binary range coder: integers only, carry propagation as in LZMA.
//!
//! The encoder writes four bytes more than the information needs; the decoder must use up
//! exactly what was written, so a cut or padded stream is an error and not a silent zero.

use crate::error::{Error, Result};

/// Probabilities given to the coder have this many bits.
const PROBABILITY_BITS: u32 = 15;

/// Smallest probability of either bit: a bit costs at most 10.4 and at least 0.0010 bits.
const LEAST: u32 = 24;

/// Adaptive probability of a bit being 0, in 1/65536, and how often it was updated.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bit {
    zero: u16,
    count: u8,
}

impl Bit {
    pub(crate) const NEW: Self = Self { zero: 1 << 15, count: 0 };

    fn probability(self) -> u32 {
        (u32::from(self.zero) >> (16 - PROBABILITY_BITS))
            .clamp(LEAST, (1 << PROBABILITY_BITS) - LEAST)
    }

    /// Moves towards the bit seen by 1 / (count + 1.5), the rate of a running mean, which
    /// settles at 1 / (LIMIT + 1.5).
    fn update(&mut self, bit: bool) {
        const LIMIT: u8 = 160;
        let divisor = 2 * i32::from(self.count) + 3;
        let target = if bit { 0 } else { 65535 };
        let zero = i32::from(self.zero);
        self.zero = (zero + 2 * (target - zero) / divisor) as u16;
        self.count = (self.count + 1).min(LIMIT);
    }
}

/// Writes bits.
pub(crate) struct Encoder {
    low: u64,
    range: u32,
    /// The last byte not yet written (a carry may still reach it) and the run of 0xff after it.
    held: Option<u8>,
    run: u64,
    bytes: Vec<u8>,
}

impl Encoder {
    /// Bytes are appended to `bytes`.
    pub(crate) fn new(bytes: Vec<u8>) -> Self {
        Self { low: 0, range: u32::MAX, held: None, run: 0, bytes }
    }

    pub(crate) fn bit(&mut self, model: &mut Bit, bit: bool) {
        let bound = (self.range >> PROBABILITY_BITS) * model.probability();
        if bit {
            self.low += u64::from(bound);
            self.range -= bound;
        } else {
            self.range = bound;
        }
        model.update(bit);
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.shift();
        }
    }

    /// The top byte of `low` leaves the register.
    fn shift(&mut self) {
        if self.low < 0xff00_0000 || self.low > 0xffff_ffff {
            let carry = (self.low >> 32) as u8;
            if let Some(held) = self.held {
                self.bytes.push(held.wrapping_add(carry));
            }
            for _ in 0..self.run {
                self.bytes.push(0xffu8.wrapping_add(carry));
            }
            self.run = 0;
            self.held = Some((self.low >> 24) as u8);
        } else {
            self.run += 1;
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    pub(crate) fn finish(mut self) -> Vec<u8> {
        for _ in 0..5 {
            self.shift();
        }
        self.bytes
    }
}

/// Reads the bits back.
pub(crate) struct Decoder<'a> {
    code: u32,
    range: u32,
    bytes: &'a [u8],
    next: usize,
}

impl<'a> Decoder<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { code: 0, range: u32::MAX, bytes, next: 0 };
        for _ in 0..4 {
            decoder.code = decoder.code << 8 | decoder.byte();
        }
        decoder
    }

    /// The next byte; zeros past the end, which [`Self::check`] reports.
    fn byte(&mut self) -> u32 {
        let byte = self.bytes.get(self.next).copied().unwrap_or(0);
        self.next += 1;
        u32::from(byte)
    }

    pub(crate) fn bit(&mut self, model: &mut Bit) -> bool {
        let bound = (self.range >> PROBABILITY_BITS) * model.probability();
        let bit = self.code >= bound;
        if bit {
            self.code -= bound;
            self.range -= bound;
        } else {
            self.range = bound;
        }
        model.update(bit);
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.code = self.code << 8 | self.byte();
        }
        bit
    }

    /// Whether everything decoded so far came from real bytes.
    ///
    /// # Errors
    /// [`Error::Truncated`] if bits were decoded from beyond the end.
    pub(crate) fn check(&self) -> Result<()> {
        if self.next > self.bytes.len() {
            return Err(Error::Truncated { length: self.bytes.len() });
        }
        Ok(())
    }

    /// [`Self::check`], and that nothing is left over.
    ///
    /// # Errors
    /// [`Error::Truncated`], [`Error::TrailingBytes`].
    pub(crate) fn finish(self) -> Result<()> {
        self.check()?;
        if self.next < self.bytes.len() {
            return Err(Error::TrailingBytes { used: self.next, length: self.bytes.len() });
        }
        Ok(())
    }
}

/// Adaptive model of a non-negative integer below 2^24: length in bits, then the bits below the
/// leading one, the first two of them adaptive by value and the others by position.
#[derive(Debug, Clone)]
pub(crate) struct Magnitude {
    length: [Bit; 25],
    mantissa: [[Bit; 4]; 25],
    low: [[Bit; 24]; 25],
}

impl Magnitude {
    pub(crate) const NEW: Self =
        Self { length: [Bit::NEW; 25], mantissa: [[Bit::NEW; 4]; 25], low: [[Bit::NEW; 24]; 25] };

    pub(crate) fn encode(&mut self, coder: &mut Encoder, value: u32) {
        debug_assert!(value < 1 << 24);
        let value = value + 1;
        let length = value.ilog2() as usize;
        for k in 0..length {
            coder.bit(&mut self.length[k], true);
        }
        if length < 24 {
            coder.bit(&mut self.length[length], false);
        }
        let mut prefix = 1;
        for k in (0..length).rev() {
            let bit = value >> k & 1 == 1;
            coder.bit(self.model(length, k, prefix), bit);
            prefix = 2 * prefix + usize::from(bit);
        }
    }

    pub(crate) fn decode(&mut self, coder: &mut Decoder<'_>) -> u32 {
        let mut length = 0;
        while length < 24 && coder.bit(&mut self.length[length]) {
            length += 1;
        }
        let mut prefix = 1;
        for k in (0..length).rev() {
            let bit = coder.bit(self.model(length, k, prefix));
            prefix = 2 * prefix + usize::from(bit);
        }
        prefix as u32 - 1
    }

    fn model(&mut self, length: usize, k: usize, prefix: usize) -> &mut Bit {
        if prefix < 4 { &mut self.mantissa[length][prefix] } else { &mut self.low[length][k] }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn bits_come_back(bits in prop::collection::vec((any::<bool>(), 0usize..5), 0..3000)) {
            let mut encoder = Encoder::new(Vec::new());
            let mut models = [Bit::NEW; 5];
            for &(bit, context) in &bits {
                encoder.bit(&mut models[context], bit);
            }
            let bytes = encoder.finish();
            let mut decoder = Decoder::new(&bytes);
            let mut models = [Bit::NEW; 5];
            for &(bit, context) in &bits {
                prop_assert_eq!(decoder.bit(&mut models[context]), bit);
            }
            decoder.finish().unwrap();
        }

        #[test]
        fn magnitudes_come_back(values in prop::collection::vec((0u32..1 << 24, 0u32..24), 0..500)) {
            let values: Vec<u32> = values.into_iter().map(|(v, shift)| v >> shift).collect();
            let mut encoder = Encoder::new(Vec::new());
            let mut model = Magnitude::NEW;
            values.iter().for_each(|&v| model.encode(&mut encoder, v));
            let bytes = encoder.finish();
            let mut decoder = Decoder::new(&bytes);
            let mut model = Magnitude::NEW;
            for &v in &values {
                prop_assert_eq!(model.decode(&mut decoder), v);
            }
            decoder.finish().unwrap();
        }
    }

    #[test]
    fn long_carries_are_propagated() {
        // Likely bits pile up 0xff bytes, the unlikely ones force carries into them.
        let mut rng = crate::rng::SplitMix64::new(11);
        for limit in [1u64, 3, 20, 300] {
            let bits: Vec<bool> =
                (0..60_000).map(|_| !rng.next_u64().is_multiple_of(limit)).collect();
            let mut encoder = Encoder::new(Vec::new());
            let mut model = Bit::NEW;
            bits.iter().for_each(|&b| encoder.bit(&mut model, b));
            let bytes = encoder.finish();
            let mut decoder = Decoder::new(&bytes);
            let mut model = Bit::NEW;
            assert!(bits.iter().all(|&b| decoder.bit(&mut model) == b));
            decoder.finish().unwrap();
            // Within 3 % of the entropy of the source.
            let p = 1.0 / limit as f64;
            let h = |p: f64| if p > 0.0 { -p * libm::log2(p) } else { 0.0 };
            let ideal = 60_000.0 * (h(p) + h(1.0 - p)) / 8.0;
            assert!((bytes.len() as f64) < 1.03 * ideal + 32.0, "{} {ideal}", bytes.len());
        }
    }

    #[test]
    fn cut_and_padded_streams_are_errors() {
        let mut encoder = Encoder::new(Vec::new());
        let mut model = Magnitude::NEW;
        (0..100).for_each(|v| model.encode(&mut encoder, v * 37 % 101));
        let mut bytes = encoder.finish();
        let decode = |bytes: &[u8]| {
            let mut decoder = Decoder::new(bytes);
            let mut model = Magnitude::NEW;
            (0..100).for_each(|_| {
                model.decode(&mut decoder);
            });
            decoder.finish()
        };
        decode(&bytes).unwrap();
        bytes.push(0);
        assert!(matches!(decode(&bytes), Err(Error::TrailingBytes { .. })));
        bytes.truncate(bytes.len() - 2);
        assert!(matches!(decode(&bytes), Err(Error::Truncated { .. })));
    }
}
