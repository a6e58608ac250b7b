//! Version 4: a plain header, a table of contents and one Zstandard stream per attribute.

use std::io::Read;
use std::path::Path;

use rayon::prelude::*;
use ruzstd::decoding::StreamingDecoder;

use super::layout::SpzLayout;
use super::records::Records;
use super::{READ, broken, short};
use crate::bytes::word;
use crate::error::{Error, Result};

/// Header bytes.
pub(super) const HEADER: usize = 32;
/// Bytes per entry of the table of contents: compressed and uncompressed length.
pub(super) const ENTRY: usize = 16;
/// Largest ratio of the decompressed length to the length of the file. Real files have a ratio of
/// 1.2 to 3. The bound stops a small file from claiming a large memory.
const MAX_RATIO: u64 = 1024;

/// The layout, the number of Gaussians, the decompressed attributes in file order, and the extension records.
pub(super) fn parse(
    file: &Path,
    bytes: &[u8],
) -> Result<(SpzLayout, usize, [Vec<u8>; 6], Records)> {
    let bad = |reason: &str| Error::malformed(file, "SPZ header", reason);
    let header = || Error::truncated(file, bytes.len(), "the header is not whole");
    if bytes.len() < 8 {
        return Err(header());
    }
    let version = word(bytes, 4);
    if version != 4 {
        return Err(Error::version(file, "SPZ", version, READ));
    }
    if bytes.len() < HEADER {
        return Err(header());
    }
    let promised = word(bytes, 8);
    let layout = SpzLayout::new(file, version, [bytes[12], bytes[13], bytes[14]])?;
    let sizes = layout.sizes().map(|size| u64::from(promised) * size as u64);
    let needed: u64 = sizes.iter().sum();
    let truncated = |needed| short(file, bytes.len(), promised, needed);
    if needed > MAX_RATIO * bytes.len() as u64 {
        return Err(truncated(needed));
    }
    // Attributes without a byte have no stream.
    let present: Vec<usize> = (0..sizes.len()).filter(|&k| sizes[k] > 0).collect();
    if usize::from(bytes[15]) != present.len() {
        return Err(bad("the number of streams does not fit its SH degree"));
    }
    let toc = word(bytes, 16) as usize;
    let body = toc.saturating_add(present.len() * ENTRY);
    if toc < HEADER || body > bytes.len() {
        return Err(bad("its table of contents is outside the file"));
    }
    let records = Records::of(file, bytes[14], &bytes[HEADER..toc])?;
    let mut at = body;
    let mut parts: Vec<(usize, &[u8])> = Vec::with_capacity(present.len());
    for (i, &k) in present.iter().enumerate() {
        let entry = &bytes[toc + i * ENTRY..toc + (i + 1) * ENTRY];
        let [len, raw] =
            [0, 8].map(|o| u64::from(word(entry, o)) | u64::from(word(entry, o + 4)) << 32);
        if raw != sizes[k] {
            return Err(bad("the length of a stream is not that of its attribute"));
        }
        let left = bytes.len() - at;
        let Some(len) = usize::try_from(len).ok().filter(|&len| len <= left) else {
            return Err(truncated((at as u64).saturating_add(len)));
        };
        parts.push((k, &bytes[at..at + len]));
        at += len;
    }
    let unpacked: Vec<Result<(usize, Vec<u8>)>> =
        parts.into_par_iter().map(|(k, part)| Ok((k, unpack(file, part, sizes[k])?))).collect();
    let mut streams: [Vec<u8>; 6] = Default::default();
    for outcome in unpacked {
        let (k, data) = outcome?;
        if data.len() as u64 != sizes[k] {
            return Err(truncated(needed));
        }
        streams[k] = data;
    }
    Ok((layout, promised as usize, streams, records))
}

/// At most `len` bytes of a Zstandard frame.
fn unpack(file: &Path, part: &[u8], len: u64) -> Result<Vec<u8>> {
    let decoder = StreamingDecoder::new(part).map_err(|_| broken(file))?;
    let mut data = Vec::new();
    decoder.take(len).read_to_end(&mut data).map_err(|_| broken(file))?;
    Ok(data)
}
