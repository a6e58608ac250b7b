//! The container. The paper has none, so this is ours:
//!
//! | bytes | what |
//! |---|---|
//! | 6 | `paper`, version 1 |
//! | 1 | SH degree, 0 to 3; and 128 if the model is antialiased |
//! | 32 | cube: origin x, y, z and side, 64-bit floats in little-endian order |
//! | block | geometry |
//! | block | opacity |
//! | blocks | for each SH coefficient Y, U, V |
//! | block | covariances |
//!
//! A block is its length as an LEB128 number, then its bytes.

use crate::error::{Error, Result};
use gpcc_lite::{put_varint, varint};

const SIGNATURE: [u8; 6] = *b"paper\x01";
/// Added to the SH degree.
const ANTIALIASED: u8 = 128;

/// A stream that is being written.
pub(crate) struct ContainerWriter {
    pub(crate) bytes: Vec<u8>,
    /// Bytes by what they are for.
    pub(crate) parts: Vec<(&'static str, u64)>,
}

impl ContainerWriter {
    pub(crate) fn new(sh_degree: u8, antialiased: bool) -> Self {
        let mut this = Self { bytes: Vec::new(), parts: Vec::new() };
        this.raw("head", &SIGNATURE);
        this.raw("head", &[sh_degree | if antialiased { ANTIALIASED } else { 0 }]);
        this
    }

    /// Appends bytes that belong to `part`.
    pub(crate) fn raw(&mut self, part: &'static str, bytes: &[u8]) {
        self.bytes.extend(bytes);
        match self.parts.last_mut() {
            Some((last, sum)) if *last == part => *sum += bytes.len() as u64,
            _ => self.parts.push((part, bytes.len() as u64)),
        }
    }

    /// Appends a block that belongs to `part`.
    pub(crate) fn block(&mut self, part: &'static str, bytes: &[u8]) {
        let mut block = Vec::with_capacity(bytes.len() + 5);
        put_block(&mut block, bytes);
        self.raw(part, &block);
    }
}

/// Appends the length as an LEB128 number, then the bytes.
pub(crate) fn put_block(out: &mut Vec<u8>, bytes: &[u8]) {
    put_varint(out, bytes.len() as u64);
    out.extend(bytes);
}

/// What is left of a stream or a block.
pub(crate) struct ContainerReader<'a>(pub(crate) &'a [u8]);

impl<'a> ContainerReader<'a> {
    /// Opens a stream; returns its SH degree too, and whether its model is antialiased.
    pub(crate) fn open(bytes: &'a [u8]) -> Result<(Self, u8, bool)> {
        let mut this = Self(bytes.strip_prefix(&SIGNATURE).ok_or(Error::Signature)?);
        let [head] = this.array("SH degree")?;
        match head & !ANTIALIASED {
            degree @ 0..=3 => Ok((this, degree, head != degree)),
            _ => Err(Error::Corrupt { what: "SH degree above 3" }),
        }
    }

    /// Takes `N` bytes off the front.
    pub(crate) fn array<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N]> {
        let (&first, behind) = self.0.split_first_chunk().ok_or(Error::Truncated { what })?;
        self.0 = behind;
        Ok(first)
    }

    /// Takes a finite number off the front.
    pub(crate) fn float(&mut self, what: &'static str) -> Result<f64> {
        let number = f32::from_le_bytes(self.array(what)?);
        if number.is_finite() { Ok(f64::from(number)) } else { Err(Error::Corrupt { what }) }
    }

    /// Takes a block off the front.
    pub(crate) fn block(&mut self, what: &'static str) -> Result<&'a [u8]> {
        let len = varint(|| self.array(what).map(|[byte]| byte))?;
        let len = len.ok_or(Error::Corrupt { what: "the length of a block" })?;
        let len = usize::try_from(len).map_err(|_| Error::Truncated { what })?;
        self.0.split_off(..len).ok_or(Error::Truncated { what })
    }

    /// The end of the stream.
    pub(crate) fn finish(self) -> Result<()> {
        if self.0.is_empty() { Ok(()) } else { Err(Error::Corrupt { what: "bytes after the end" }) }
    }
}
