//! Reading and writing of bytes, variable-length integers and bit fields.

use crate::error::{Error, Result};

/// Appends `v` in base 128 (LEB128), low digits first. The high bit of a byte says that more bytes follow.
pub fn put_varint(out: &mut Vec<u8>, mut v: u64) {
    while v >= 0x80 {
        out.push((v as u8) | 0x80);
        v >>= 7;
    }
    out.push(v as u8);
}

/// The number that [`put_varint`] wrote, of whose bytes `next` gives one after the other; `None` if 64 bits do not hold it.
///
/// # Errors
/// Those of `next`.
pub fn varint<E>(mut next: impl FnMut() -> Result<u8, E>) -> Result<Option<u64>, E> {
    let mut v = 0u64;
    for shift in (0..64).step_by(7) {
        let byte = next()?;
        if shift == 63 && byte > 1 {
            break;
        }
        v |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Ok(Some(v));
        }
    }
    Ok(None)
}

/// Reads a stream front to back; every read is checked.
#[derive(Clone, Debug)]
pub(crate) struct ByteReader<'a> {
    data: &'a [u8],
    pos: usize,
}

impl<'a> ByteReader<'a> {
    pub(crate) fn new(data: &'a [u8]) -> Self {
        Self { data, pos: 0 }
    }

    pub(crate) fn pos(&self) -> usize {
        self.pos
    }

    pub(crate) fn remaining(&self) -> usize {
        self.data.len() - self.pos
    }

    pub(crate) fn u8(&mut self, what: &'static str) -> Result<u8> {
        let v = *self.data.get(self.pos).ok_or(Error::Truncated { offset: self.pos, what })?;
        self.pos += 1;
        Ok(v)
    }

    pub(crate) fn varint(&mut self, what: &'static str) -> Result<u64> {
        varint(|| self.u8(what))?.ok_or(Error::Corrupt { what, offset: self.pos })
    }

    pub(crate) fn bytes(&mut self, n: u64, what: &'static str) -> Result<&'a [u8]> {
        if n > self.remaining() as u64 {
            return Err(Error::Truncated { offset: self.data.len(), what });
        }
        let s = &self.data[self.pos..self.pos + n as usize];
        self.pos += n as usize;
        Ok(s)
    }

    /// A number of channels, at most `max`.
    pub(crate) fn channels(&mut self, max: usize) -> Result<u64> {
        let channels = self.varint("channel count")?;
        if channels > max as u64 { Err(self.corrupt("channel count")) } else { Ok(channels) }
    }

    pub(crate) fn corrupt(&self, what: &'static str) -> Error {
        Error::Corrupt { what, offset: self.pos }
    }
}

/// Writes bit fields, most significant bit first.
#[derive(Clone, Debug, Default)]
pub(crate) struct BitWriter {
    out: Vec<u8>,
    acc: u64,
    fill: u32,
}

impl BitWriter {
    /// Appends the low `n` bits of `v`; `n` is at most 32.
    #[inline]
    pub(crate) fn put(&mut self, v: u32, n: u32) {
        debug_assert!(n <= 32 && (n == 32 || v >> n == 0));
        self.acc = (self.acc << n) | u64::from(v);
        self.fill += n;
        if self.fill >= 32 {
            self.fill -= 32;
            self.out.extend_from_slice(&((self.acc >> self.fill) as u32).to_be_bytes());
        }
    }

    /// True before the first bit.
    pub(crate) fn is_empty(&self) -> bool {
        self.out.is_empty() && self.fill == 0
    }

    /// Pads the last byte with zeros and returns the bytes.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        while self.fill >= 8 {
            self.fill -= 8;
            self.out.push((self.acc >> self.fill) as u8);
        }
        if self.fill > 0 {
            self.out.push((self.acc << (8 - self.fill)) as u8);
        }
        self.out
    }
}

/// Reads what [`BitWriter`] wrote; zeros after the end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BitReader<'a> {
    data: &'a [u8],
    pos: usize,
    acc: u64,
    fill: u32,
}

impl<'a> BitReader<'a> {
    pub(crate) fn new(data: &'a [u8]) -> Self {
        Self { data, pos: 0, acc: 0, fill: 0 }
    }

    /// Reads `n` bits, at most 32.
    #[inline]
    pub(crate) fn get(&mut self, n: u32) -> u32 {
        let bits = self.peek(n);
        self.skip(n);
        bits
    }

    /// Looks at the next `n` bits, at most 32.
    #[inline]
    pub(crate) fn peek(&mut self, n: u32) -> u32 {
        if self.fill < n {
            self.refill();
        }
        ((self.acc >> (self.fill - n)) & ((1u64 << n) - 1)) as u32
    }

    /// Takes `n` bits that [`BitReader::peek`] has looked at.
    #[inline]
    pub(crate) fn skip(&mut self, n: u32) {
        self.fill -= n;
    }

    /// Takes four more bytes. There must be fewer than 32 bits left.
    #[inline]
    fn refill(&mut self) {
        let mut word = [0; 4];
        if let Some(w) = self.data.get(self.pos..self.pos + 4) {
            word.copy_from_slice(w);
        } else if let Some(rest) = self.data.get(self.pos..) {
            word[..rest.len()].copy_from_slice(rest);
        }
        self.acc = (self.acc << 32) | u64::from(u32::from_be_bytes(word));
        self.pos += 4;
        self.fill += 32;
    }

    /// Counts the ones up to the next zero, at most 32, and skips them; also skips the zero if
    /// there are fewer than 32.
    #[inline]
    pub(crate) fn ones(&mut self) -> u32 {
        if self.fill < 32 {
            self.refill();
        }
        let n = ((self.acc << (64 - self.fill)).leading_ones()).min(32);
        self.fill -= (n + 1).min(32);
        n
    }

    /// True once more bits were read than there are.
    pub(crate) fn overrun(&self) -> bool {
        self.consumed() > self.data.len()
    }

    /// True once a bit of the last byte was taken, or if there is no byte.
    pub(crate) fn at_end(&self) -> bool {
        self.consumed() == self.data.len()
    }

    /// Bytes consumed so far, whole or in part.
    pub(crate) fn consumed(&self) -> usize {
        self.pos - (self.fill / 8) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_varint_is_any_number_below_2_to_the_64() {
        for v in [0, 127, 128, 1 << 35, 1 << 62, 1 << 63, u64::MAX] {
            let mut bytes = Vec::new();
            put_varint(&mut bytes, v);
            assert_eq!(ByteReader::new(&bytes).varint("number").unwrap(), v);
        }
        let mut too_great = [0xff; 10];
        too_great[9] = 2;
        assert!(ByteReader::new(&too_great).varint("number").is_err());
        assert!(ByteReader::new(&[0x80; 11]).varint("number").is_err());
    }
}
