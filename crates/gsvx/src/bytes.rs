//! Little-endian reading and writing with bounds checks.

use crate::error::{Error, Result};

/// Appends little-endian values to a byte vector.
#[cfg(feature = "encode")]
#[derive(Debug, Default)]
pub(crate) struct Writer {
    /// The bytes written so far.
    pub(crate) bytes: Vec<u8>,
}

#[cfg(feature = "encode")]
impl Writer {
    /// One byte.
    pub(crate) fn u8(&mut self, v: u8) {
        self.bytes.push(v);
    }

    /// Four bytes.
    pub(crate) fn u32(&mut self, v: u32) {
        self.bytes.extend_from_slice(&v.to_le_bytes());
    }

    /// An IEEE 754 single.
    pub(crate) fn f32(&mut self, v: f32) {
        self.bytes.extend_from_slice(&v.to_le_bytes());
    }

    /// An IEEE 754 double.
    pub(crate) fn f64(&mut self, v: f64) {
        self.bytes.extend_from_slice(&v.to_le_bytes());
    }

    /// LEB128: seven bits per byte, least significant first, high bit = more follow.
    pub(crate) fn varint(&mut self, v: u64) {
        gpcc_lite::put_varint(&mut self.bytes, v);
    }

    /// A varint length followed by that many bytes.
    pub(crate) fn block(&mut self, payload: &[u8]) {
        self.varint(payload.len() as u64);
        self.bytes.extend_from_slice(payload);
    }
}

/// Reads little-endian values from a slice. [`Error::Truncated`] if there is less, [`Error::Corrupt`] for a value that
/// cannot be.
#[derive(Clone, Debug)]
pub(crate) struct SliceReader<'a> {
    bytes: &'a [u8],
    at: usize,
    what: &'static str,
}

impl<'a> SliceReader<'a> {
    /// Reads `bytes`; `what` names the part in errors.
    pub(crate) fn new(bytes: &'a [u8], what: &'static str) -> Self {
        Self { bytes, at: 0, what }
    }

    /// Bytes left.
    pub(crate) fn remaining(&self) -> usize {
        self.bytes.len() - self.at
    }

    /// The next `n` bytes.
    pub(crate) fn take(&mut self, n: usize) -> Result<&'a [u8]> {
        if n > self.remaining() {
            return Err(Error::Truncated {
                what: self.what,
                offset: self.at as u64,
                need: n as u64,
                have: self.remaining() as u64,
            });
        }
        let out = &self.bytes[self.at..self.at + n];
        self.at += n;
        Ok(out)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    /// One byte.
    pub(crate) fn u8(&mut self) -> Result<u8> {
        Ok(self.array::<1>()?[0])
    }

    /// Four bytes.
    pub(crate) fn u32(&mut self) -> Result<u32> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    /// An IEEE 754 single of any value.
    pub(crate) fn f32(&mut self) -> Result<f32> {
        Ok(f32::from_le_bytes(self.array()?))
    }

    /// An IEEE 754 single that must be finite.
    pub(crate) fn finite_f32(&mut self, what: &'static str) -> Result<f32> {
        let v = self.f32()?;
        if v.is_finite() {
            Ok(v)
        } else {
            Err(Error::Corrupt { what, value: u64::from(v.to_bits()) })
        }
    }

    /// An IEEE 754 double that must be finite.
    pub(crate) fn finite_f64(&mut self, what: &'static str) -> Result<f64> {
        let v = f64::from_le_bytes(self.array()?);
        if v.is_finite() { Ok(v) } else { Err(Error::Corrupt { what, value: v.to_bits() }) }
    }

    /// A LEB128 integer of at most ten bytes.
    pub(crate) fn varint(&mut self) -> Result<u64> {
        let mut last = 0;
        let read = gpcc_lite::varint(|| {
            last = self.u8()?;
            Ok::<_, Error>(last)
        });
        read?.ok_or(Error::Corrupt { what: "varint", value: u64::from(last) })
    }

    /// A varint length and that many bytes.
    pub(crate) fn block(&mut self) -> Result<&'a [u8]> {
        let n = self.varint()?;
        self.take(usize::try_from(n).unwrap_or(usize::MAX))
    }
}
