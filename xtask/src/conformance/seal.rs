//! Repairs the checksums of a gsvx stream, so that changes reach what is behind them. The fuzz targets
//! include this file.

/// Bytes before the head's body: signature, version, length of the body.
const PREAMBLE: usize = 13;
/// In the place of a level of detail: Gaussians bit for bit, in one layer.
const EXACT: u8 = 255;

/// Bit of the header's first byte, above the SH degree: the scene has an origin.
const HAS_ORIGIN: u8 = 0x80;

/// A position in the head's body.
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Cursor<'_> {
    fn skip(&mut self, n: usize) -> Option<()> {
        self.at = self.at.checked_add(n).filter(|&at| at <= self.bytes.len())?;
        Some(())
    }

    fn byte(&mut self) -> Option<u8> {
        let byte = *self.bytes.get(self.at)?;
        self.at += 1;
        Some(byte)
    }

    fn varint(&mut self) -> Option<u64> {
        let mut value = 0u64;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 127) << shift;
            if byte < 128 {
                return Some(value);
            }
        }
        None
    }
}

/// Places of the checksums of layers, each with the bytes that it is of; as far as the head can be
/// followed.
fn layers(head: &[u8]) -> Vec<(usize, std::ops::Range<usize>)> {
    let mut found = Vec::new();
    let mut cursor = Cursor { bytes: head, at: PREAMBLE };
    let mut offset = head.len() + 4;
    let mut walk = || {
        let (sh_degree, _) = (cursor.byte()?, cursor.byte()?);
        // The cube, the steps, and the origin, if there is one.
        cursor.skip(4 * 8 + 6 * 4 + if sh_degree & HAS_ORIGIN != 0 { 3 * 8 } else { 0 })?;
        cursor.varint()?;
        for _ in 0..cursor.varint()? {
            let lod = cursor.byte()?;
            cursor.varint()?;
            cursor.varint()?;
            // The bounds.
            cursor.skip(6 * 4)?;
            for _ in 0..if lod == EXACT { 1 } else { 1 + usize::from(sh_degree & 3) } {
                let len = usize::try_from(cursor.varint()?).ok()?;
                let place = cursor.at;
                cursor.skip(4)?;
                let end = offset.checked_add(len)?;
                found.push((place, offset..end));
                offset = end;
            }
        }
        Some(())
    };
    // A head that cannot be followed to its end keeps the checksums behind that point.
    let _ = walk();
    found
}

/// Makes all checksums those of the bytes.
pub(crate) fn repair(bytes: &mut [u8]) {
    let Some(&[a, b, c, d]) = bytes.get(PREAMBLE - 4..PREAMBLE) else { return };
    let body = u32::from_le_bytes([a, b, c, d]) as usize;
    let end = PREAMBLE.saturating_add(body);
    if bytes.len() < end.saturating_add(4) {
        return;
    }
    for (place, layer) in layers(&bytes[..end]) {
        if let Some(layer) = bytes.get(layer) {
            let crc = crc32c::crc32c(layer);
            bytes[place..place + 4].copy_from_slice(&crc.to_le_bytes());
        }
    }
    let crc = crc32c::crc32c(&bytes[..end]);
    bytes[end..end + 4].copy_from_slice(&crc.to_le_bytes());
}
