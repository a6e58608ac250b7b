//! SPZ files (Niantic): versions 2 to 4 are read, version 4 is written.
//!
//! A header (`NGSP`, version, number of Gaussians, SH degree, fractional bits of the positions,
//! flags), then, each for all Gaussians: positions (3 x 24-bit fixed point), opacities (a byte),
//! colours (3 bytes), log-scales (3 bytes), rotations (version 2: x y z as bytes; from version 3:
//! the three smallest components, 10 bits each) and the higher SH coefficients (bytes,
//! coefficient-major). Versions 2 and 3 are all of this in one gzip stream. Version 4 has a plain
//! header of 32 bytes, optional extension records (skipped here), a table of contents and one
//! Zstandard stream per attribute.
//!
//! SPZ's axes are x right, y up, z back; a PLY file's y points down and z forward. Reader and writer
//! negate y and z in means, rotations and SH coefficients, so that a model that is converted to SPZ
//! and back keeps its orientation.

mod layout;
mod streams;
mod write;

use std::io::Read;
use std::path::Path;

use flate2::bufread::GzDecoder;

use layout::{Layout, word};
pub use write::{MAX_COORDINATE, WriteOptions, write, write_to};

use crate::error::{Error, Result};
use crate::options::ReadOptions;
use crate::report;
use crate::scene::Scene;

const HEADER: usize = 16;

/// Reads an SPZ file.
///
/// Memory: the scene and as much of the decompressed file as the header's count needs. DEFLATE data
/// decompresses to at most 1,032 times its size; Zstandard streams that promise more than 1,024 times
/// the size of the file are refused.
pub(crate) fn decode(
    file: &Path,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<(Scene, report::Report)> {
    if bytes.starts_with(b"NGSP") {
        // From version 4 the header is not compressed.
        let (layout, n, streams) = streams::parse(file, bytes)?;
        let scene = layout.scene(streams.each_ref().map(|s| &s[..]), n)?;
        return report::finish(file, scene, report::Format::Spz { version: 4 }, options);
    }
    let bad = |reason| Error::SpzHeader { file: file.into(), reason };
    let mut unzip = GzDecoder::new(bytes);
    let mut data = Vec::new();
    let mut inflate = |data: &mut Vec<u8>, len: u64| {
        let outcome = unzip.by_ref().take(len).read_to_end(data);
        outcome.map_err(|e| {
            let cut_short = e.kind() == std::io::ErrorKind::UnexpectedEof;
            let reason = if cut_short { "cut short" } else { "broken" };
            Error::SpzCompressedData { file: file.into(), compression: "gzip", reason }
        })
    };
    inflate(&mut data, HEADER as u64)?;
    if data.len() < HEADER || &data[..4] != b"NGSP" {
        return Err(bad("no NGSP header in a gzip stream"));
    }
    let (version, promised) = (word(&data, 4), word(&data, 8));
    if !matches!(version, 2 | 3) {
        return Err(Error::SpzVersion { file: file.into(), version });
    }
    let layout = Layout::new(file, version, data[12], data[13])?;
    let needed = u64::from(promised) * layout.sizes().iter().sum::<usize>() as u64;
    inflate(&mut data, needed)?;
    let body = &data[HEADER..];
    if (body.len() as u64) < needed {
        let (needed, len) = (needed + HEADER as u64, data.len());
        return Err(Error::SpzTruncated { file: file.into(), promised, needed, len });
    }
    // gzip's checksum is verified at the end of the stream. Surplus data is ignored.
    inflate(&mut Vec::new(), 1)?;
    let mut rest = body;
    let attributes = layout.sizes().map(|size| {
        let (attribute, after) = rest.split_at(promised as usize * size);
        rest = after;
        attribute
    });
    let scene = layout.scene(attributes, promised as usize)?;
    report::finish(file, scene, report::Format::Spz { version }, options)
}
