//! Blocks of bytes behind their lengths.

use anyhow::{Context, Result};

/// Appends the length as an LEB128 number, then the bytes.
pub(super) fn put_block(out: &mut Vec<u8>, bytes: &[u8]) {
    let mut len = bytes.len();
    while len >= 0x80 {
        out.push(len as u8 | 0x80);
        len >>= 7;
    }
    out.push(len as u8);
    out.extend(bytes);
}

/// Takes a block off the front.
pub(super) fn block<'a>(rest: &mut &'a [u8]) -> Result<&'a [u8]> {
    let mut len = 0usize;
    for shift in (0..35).step_by(7) {
        let &byte = rest.split_off_first().context("the stream is cut off")?;
        len |= usize::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return rest.split_off(..len).context("the stream is cut off");
        }
    }
    anyhow::bail!("the length of a block is damaged")
}

/// Takes `N` bytes off the front.
pub(super) fn array<const N: usize>(rest: &mut &[u8]) -> Result<[u8; N]> {
    let (&first, behind) = rest.split_first_chunk::<N>().context("the stream is cut off")?;
    *rest = behind;
    Ok(first)
}
