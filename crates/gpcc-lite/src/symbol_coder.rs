//! A range coder with bits beside it that need no model.
//!
//! Signs and the low bits of large magnitudes are as good as random. As decisions of the range
//! coder each of them would lengthen the chain of dependent operations that a decoder's time is
//! made of; as plain bits of their own they are a shift away.

use crate::bytes::{BitReader, BitWriter, put_varint};
use crate::error::Result;
use crate::range::{BinaryCoder, RangeDecoder, RangeEncoder};
use crate::symbols::{self, Symbols};

/// Both directions of symbols and plain bits.
pub(crate) trait SymbolCoder: BinaryCoder {
    /// Codes one symbol by its model, which learns it.
    fn code_symbol(&mut self, model: &mut Symbols, symbol: usize) -> usize;

    /// Codes `n <= 32` bits without a model.
    fn code_bits(&mut self, value: u32, n: u32) -> u32;
}

/// The encoder half.
#[derive(Debug, Default)]
pub(crate) struct SymbolEncoder {
    coded: RangeEncoder,
    plain: BitWriter,
}

impl SymbolEncoder {
    /// What was coded, without plain bits, of which there must be none.
    pub(crate) fn finish(self) -> Vec<u8> {
        debug_assert!(self.plain.is_empty());
        self.coded.finish()
    }

    /// What was coded behind its length, then the plain bits.
    pub(crate) fn finish_both(self, out: &mut Vec<u8>) {
        let coded = self.coded.finish();
        put_varint(out, coded.len() as u64);
        out.extend(coded);
        out.extend(self.plain.finish());
    }
}

/// The decoder half.
#[derive(Debug)]
pub(crate) struct SymbolDecoder<'a> {
    coded: RangeDecoder<'a>,
    plain: BitReader<'a>,
}

impl<'a> SymbolDecoder<'a> {
    /// Of a stream without plain bits.
    pub(crate) fn coded(data: &'a [u8]) -> Self {
        Self { coded: RangeDecoder::new(data), plain: BitReader::new(&[]) }
    }

    /// Of what [`SymbolEncoder::finish_both`] wrote and nothing else.
    ///
    /// # Errors
    /// If the length is beyond the end.
    pub(crate) fn both(data: &'a [u8]) -> Result<Self> {
        let mut r = crate::bytes::Reader::new(data);
        let len = r.varint("coefficients")?;
        let coded = RangeDecoder::new(r.bytes(len, "coefficients")?);
        Ok(Self { coded, plain: BitReader::new(&data[r.pos()..]) })
    }
}

impl BinaryCoder for SymbolEncoder {
    const ENCODING: bool = true;

    #[inline]
    fn code(&mut self, p1: u32, bit: bool) -> bool {
        self.coded.code(p1, bit)
    }

    #[inline]
    fn code_raw(&mut self, value: u32, n: u32) -> u32 {
        self.coded.code_raw(value, n)
    }

    fn exhausted(&self) -> bool {
        false
    }
}

impl BinaryCoder for SymbolDecoder<'_> {
    const ENCODING: bool = false;

    #[inline]
    fn code(&mut self, p1: u32, bit: bool) -> bool {
        self.coded.code(p1, bit)
    }

    #[inline]
    fn code_raw(&mut self, value: u32, n: u32) -> u32 {
        self.coded.code_raw(value, n)
    }

    #[inline]
    fn exhausted(&self) -> bool {
        self.coded.exhausted() | self.plain.overrun()
    }
}

impl SymbolCoder for SymbolEncoder {
    #[inline]
    fn code_symbol(&mut self, model: &mut Symbols, symbol: usize) -> usize {
        let (start, size) = model.interval(symbol);
        self.coded.code_part(symbols::BITS, start, size);
        model.learn(symbol);
        symbol
    }

    #[inline]
    fn code_bits(&mut self, value: u32, n: u32) -> u32 {
        self.plain.put(value, n);
        value
    }
}

impl SymbolCoder for SymbolDecoder<'_> {
    #[inline]
    fn code_symbol(&mut self, model: &mut Symbols, _: usize) -> usize {
        let symbol = self.coded.code_part(symbols::BITS, |code| {
            let symbol = model.find(code);
            let (start, size) = model.interval(symbol);
            (symbol, start, size)
        });
        model.learn(symbol);
        symbol
    }

    #[inline]
    fn code_bits(&mut self, _: u32, n: u32) -> u32 {
        self.plain.get(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Bit;

    /// Symbols, decisions and bits in turn, of which a decoder gets back the values.
    fn run(coder: &mut impl SymbolCoder, rounds: u32) -> Vec<(usize, bool, u32)> {
        let (mut symbols, mut decision) = (Symbols::geometric(700, 6), Bit::default());
        let one = |i: u32| {
            let value = i.wrapping_mul(0x9e37_79b9);
            let symbol = coder.code_symbol(&mut symbols, value as usize % 7);
            let bit = decision.code(coder, value & 64 != 0, 250);
            let n = i % 33;
            let low = (u64::from(value) & ((1 << n) - 1)) as u32;
            (symbol, bit, coder.code_bits(low, n))
        };
        (0..rounds).map(one).collect()
    }

    #[test]
    fn symbols_decisions_and_bits_come_back() {
        for rounds in [0, 1, 5, 2000] {
            let mut encoder = SymbolEncoder::default();
            let want = run(&mut encoder, rounds);
            let mut bytes = Vec::new();
            encoder.finish_both(&mut bytes);
            let mut decoder = SymbolDecoder::both(&bytes).unwrap();
            assert_eq!(run(&mut decoder, rounds), want);
            assert!(!decoder.exhausted(), "{rounds}");
        }
    }

    #[test]
    fn plain_bits_that_are_not_there_are_noticed() {
        let mut encoder = SymbolEncoder::default();
        run(&mut encoder, 2000);
        let mut bytes = Vec::new();
        encoder.finish_both(&mut bytes);
        // Two bytes are more than the bits of the last one's padding.
        let mut decoder = SymbolDecoder::both(&bytes[..bytes.len() - 2]).unwrap();
        run(&mut decoder, 2000);
        assert!(decoder.exhausted());
        assert!(SymbolDecoder::both(&[200, 1, 7]).is_err(), "a length beyond the end");
    }
}
