//! Gzip files without compression.

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
