//! Repairs the checksums of a gsvx stream, so that changes reach what is behind them. The fuzz targets
//! include this file.

use gsvx::{Index, SIGNATURE};

use super::forge::head;

/// Bytes before the head's body: signature, version, length of the body.
pub(crate) const PREAMBLE: usize = SIGNATURE.len() + 5;

/// Makes all checksums those of the bytes, as far as the head can be read: a decoder refuses the rest.
pub(crate) fn repair(bytes: &mut [u8]) {
    let Some(&[a, b, c, d]) = bytes.get(PREAMBLE - 4..PREAMBLE) else { return };
    let end = PREAMBLE.saturating_add(u32::from_le_bytes([a, b, c, d]) as usize);
    if bytes.len() < end.saturating_add(4) {
        return;
    }
    seal_head(bytes, end);
    let Ok(mut index) = Index::parse(bytes) else { return };
    for layer in index.chunks.iter_mut().flat_map(|chunk| &mut chunk.layers) {
        let range = layer.range();
        if let Some(layer_bytes) = bytes.get(range.start as usize..range.end as usize) {
            layer.crc = crc32c::crc32c(layer_bytes);
        }
    }
    // Behind what is known a head may have more.
    let known = head(&index);
    let known = &known[PREAMBLE..known.len() - 4];
    bytes[PREAMBLE..PREAMBLE + known.len()].copy_from_slice(known);
    seal_head(bytes, end);
}

fn seal_head(bytes: &mut [u8], end: usize) {
    let crc = crc32c::crc32c(&bytes[..end]);
    bytes[end..end + 4].copy_from_slice(&crc.to_le_bytes());
}
