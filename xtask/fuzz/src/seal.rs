//! Repairs checksums, so that mutations reach what is behind them.

fn varint(bytes: &[u8], at: &mut usize) -> Option<u64> {
    let mut value = 0u64;
    for shift in (0..64).step_by(7) {
        let byte = *bytes.get(*at)?;
        *at += 1;
        value |= u64::from(byte & 127).checked_shl(shift)?;
        if byte < 128 {
            return Some(value);
        }
    }
    None
}

/// Makes the checksums of a gsvx stream those of its bytes, as far as there is a table of
/// contents to follow (docs/bitstream.md, sections 1 and 2).
pub(crate) fn stream(bytes: &mut [u8]) -> Option<()> {
    let mut at = 10;
    let body = varint(bytes, &mut at)? as usize;
    let end = at.checked_add(body)?;
    bytes.get(end..end.checked_add(4)?)?;
    at += 36;
    // Gaussians, slices.
    varint(bytes, &mut at)?;
    varint(bytes, &mut at)?;
    let sections = varint(bytes, &mut at)?.min(64);
    let mut payload = end + 4;
    for _ in 0..sections {
        at += 1;
        let len = varint(bytes, &mut at)? as usize;
        if at + 4 > end {
            break;
        }
        if let Some(section) = payload.checked_add(len).and_then(|to| bytes.get(payload..to)) {
            let crc = crc32c::crc32c(section);
            bytes[at..at + 4].copy_from_slice(&crc.to_le_bytes());
        }
        payload = payload.saturating_add(len);
        at += 4;
    }
    let crc = crc32c::crc32c(&bytes[..end]);
    bytes[end..end + 4].copy_from_slice(&crc.to_le_bytes());
    Some(())
}

/// The same for a checkpoint, whose last four bytes are the checksum of all before.
pub(crate) fn checkpoint(bytes: &mut [u8]) {
    let Some(body) = bytes.len().checked_sub(4) else { return };
    let crc = crc32c::crc32c(&bytes[..body]);
    bytes[body..].copy_from_slice(&crc.to_le_bytes());
}

/// `data` as a gzip file of one stored block: deflate is a well-fuzzed library's business.
pub(crate) fn gzip(data: &[u8]) -> Vec<u8> {
    let data = &data[..data.len().min(0xffff)];
    let len = data.len() as u16;
    let mut out = vec![0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 255, 1];
    out.extend(len.to_le_bytes());
    out.extend((!len).to_le_bytes());
    out.extend(data);
    out.extend(crc32fast::hash(data).to_le_bytes());
    out.extend(u32::from(len).to_le_bytes());
    out
}
