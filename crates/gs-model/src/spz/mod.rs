//! SPZ files (Niantic): versions 2 to 4 are read, version 4 is written, and version 3 inside glTF.
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

use layout::SpzLayout;
pub use write::{MAX_COORDINATE, ShBits, pack, pack_version_3};

use crate::axes::ABOUT_X;
use crate::bytes::word;
use crate::error::{Error, Result};
use crate::foreign;
use crate::format::Format;
use crate::report::Report;
use crate::scene::Scene;

pub(crate) static FORMAT: Format = Format {
    name: "spz",
    about: "SPZ of Niantic: versions 2 to 4 are read, 4 is written",
    extensions: &["spz"],
    magic: &[b"\x1f\x8b\x08", MAGIC],
    max_sh_degree: 3,
    read: |file, bytes, _| read(file, bytes),
    write: Some(write::write),
};

const MAGIC: &[u8] = b"NGSP";
/// Which versions are read.
const READ: &str = "2 to 4 are";
const HEADER: usize = 16;

/// Turns a scene between the axes of PLY files and those of SPZ, as reading and writing SPZ do.
pub fn turn(scene: &mut Scene) {
    ABOUT_X.scene(scene);
}

/// Reads an SPZ file.
///
/// Memory: the scene and as much of the decompressed file as the header's count needs. DEFLATE data
/// decompresses to at most 1,032 times its size; Zstandard streams that promise more than 1,024 times
/// the size of the file are refused.
fn read(file: &Path, bytes: &[u8]) -> Result<(Scene, Report)> {
    let (scene, version) = if bytes.starts_with(MAGIC) {
        // From version 4 the header is not compressed.
        let (layout, n, streams) = streams::parse(file, bytes)?;
        (layout.scene(streams.each_ref().map(|s| &s[..]), n), 4)
    } else if bytes.starts_with(b"\x1f\x8b") {
        zipped(file, bytes)?
    } else {
        return Err(Error::other_format(file, "an SPZ file", bytes));
    };
    Ok((scene, Report::of(FORMAT.name, format!("SPZ, version {version}"))))
}

/// Versions 2 and 3: one gzip stream. Returns the version too.
fn zipped(file: &Path, bytes: &[u8]) -> Result<(Scene, u32)> {
    let mut unzip = GzDecoder::new(bytes);
    let mut data = Vec::new();
    let mut inflate = |data: &mut Vec<u8>, len: u64| {
        let outcome = unzip.by_ref().take(len).read_to_end(data);
        outcome.map_err(|e| match e.kind() {
            std::io::ErrorKind::UnexpectedEof => Error::truncated(
                file,
                bytes.len(),
                "the compressed data is cut short; get it again",
            ),
            _ => broken(file),
        })
    };
    inflate(&mut data, HEADER as u64)?;
    if data.len() < HEADER || !data.starts_with(MAGIC) {
        return Err(foreign::gzip(file, &data));
    }
    let (version, promised) = (word(&data, 4), word(&data, 8));
    if !matches!(version, 2 | 3) {
        return Err(Error::version(file, "SPZ", version, READ));
    }
    let layout = SpzLayout::new(file, version, data[12], data[13])?;
    let needed = u64::from(promised) * layout.sizes().iter().sum::<usize>() as u64;
    inflate(&mut data, needed)?;
    let body = &data[HEADER..];
    if (body.len() as u64) < needed {
        return Err(short(file, data.len(), promised, needed + HEADER as u64));
    }
    // gzip's checksum is verified at the end of the stream. Surplus data is ignored.
    inflate(&mut Vec::new(), 1)?;
    let mut rest = body;
    let attributes = layout.sizes().map(|size| {
        let (attribute, after) = rest.split_at(promised as usize * size);
        rest = after;
        attribute
    });
    Ok((layout.scene(attributes, promised as usize), version))
}

/// The decompressors' own messages name their internal types.
fn broken(file: &Path) -> Error {
    Error::malformed(file, "SPZ", "its compressed data is broken; get it again")
}

fn short(file: &Path, len: usize, promised: u32, needed: u64) -> Error {
    let missing =
        format!("the header promises {promised} Gaussians, {needed} bytes after decompression");
    Error::truncated(file, len, missing)
}
