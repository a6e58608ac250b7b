//! SPZ files (Niantic): versions 2 to 4 are read, version 4 is written, and version 3 inside glTF.
//!
//! A header (`NGSP`, version, number of Gaussians, SH degree, fractional bits of the positions,
//! flags), then, each for all Gaussians: positions (3 x 24-bit fixed point), opacities (a byte),
//! colours (3 bytes), log-scales (3 bytes), rotations (version 2: x y z as bytes; from version 3:
//! the three smallest components, 10 bits each) and the higher SH coefficients (bytes,
//! coefficient-major). Versions 2 and 3 are all of this in one gzip stream. Version 4 has a plain
//! header of 32 bytes, optional extension records, a table of contents and one Zstandard stream per attribute.
//! The record `SPZ_ADOBE_coordinate_system` is honoured, others are named in the report. Of SH degree 4, degrees 0
//! to 3 are read.
//!
//! SPZ's axes are x right, y up, z back; a PLY file's y points down and z forward. Reader and writer
//! negate y and z in means, rotations and SH coefficients, so that a model that is converted to SPZ
//! and back keeps its orientation. [`crate::FileAxes::Keep`] leaves the numbers as they are.

mod layout;
mod records;
mod streams;
mod write;

use std::io::Read;
use std::path::Path;

use flate2::bufread::GzDecoder;

use layout::SpzLayout;
use records::Records;
pub use write::{MAX_COORDINATE, ShBits, pack, pack_version_3};

use crate::axes::{ABOUT_X, STAYING};
use crate::bytes::word;
use crate::error::{Error, Result};
use crate::formats::Format;
use crate::formats::foreign;
use crate::report::{FileAxes, ReadOptions, Report};
use crate::scene::Scene;

pub(crate) static FORMAT: Format = Format {
    name: "spz",
    about: "SPZ of Niantic: versions 2 to 4 are read, 4 is written",
    extensions: &["spz"],
    magic: &[b"\x1f\x8b\x08", MAGIC],
    max_sh_degree: 3,
    says_antialiased: true,
    says_origin: false,
    steps: Some(write::steps),
    read,
    write: Some(write::write),
};

const MAGIC: &[u8] = b"NGSP";
/// Which versions are read.
const READ: &str = "2 to 4 are";
const HEADER: usize = 16;
/// Most bytes of extension records in versions 2 and 3.
const MOST_RECORD_BYTES: u64 = 1 << 20;
/// Flags of the header whose meaning is known: antialiased, extension records.
const KNOWN_FLAGS: u8 = 3;

/// Turns a scene between the axes of PLY files and those of SPZ, as reading and writing SPZ do.
pub fn turn(scene: &mut Scene) {
    ABOUT_X.scene(scene);
}

/// Reads an SPZ file.
///
/// Memory: the scene and as much of the decompressed file as the header's count needs. DEFLATE data
/// decompresses to at most 1,032 times its size; Zstandard streams that promise more than 1,024 times
/// the size of the file are refused.
pub(crate) fn read(file: &Path, bytes: &[u8], options: &ReadOptions) -> Result<(Scene, Report)> {
    let unpacked = if bytes.starts_with(MAGIC) {
        // From version 4 the header is not compressed.
        let (layout, count, streams, records) = streams::parse(file, bytes)?;
        SpzContent { version: 4, flags: bytes[14], layout, count, streams, records }
    } else if bytes.starts_with(b"\x1f\x8b") {
        unzipped(file, bytes)?
    } else {
        return Err(Error::other_format(file, "an SPZ file", bytes));
    };
    let SpzContent { version, flags, layout, count, streams, records } = unpacked;
    let keeps = options.axes == FileAxes::Keep;
    let others = records.axes.filter(|axes| !keeps && !axes.is_usual());
    let others = others.map(|axes| axes.to_ply(file)).transpose()?;
    let signs = if keeps || others.is_some() { &STAYING } else { &ABOUT_X };
    let mut scene = layout.scene(file, streams.each_ref().map(|s| &s[..]), count, signs)?;
    if let Some(placement) = others {
        placement.scene(&mut scene);
    }
    let mut report = Report::of(FORMAT.name, format!("SPZ, version {version}"));
    report.notes = layout.notes();
    report.notes.extend(records.notes);
    let unknown = flags & !KNOWN_FLAGS;
    if unknown != 0 {
        report
            .notes
            .push(format!("the header has flags whose meaning is not known: {unknown:#04x}"));
    }
    Ok((scene, report))
}

/// What a file holds, decompressed.
struct SpzContent {
    version: u32,
    flags: u8,
    layout: SpzLayout,
    /// Gaussians.
    count: usize,
    /// The attributes, in file order.
    streams: [Vec<u8>; 6],
    records: Records,
}

/// Versions 2 and 3: one gzip stream.
fn unzipped(file: &Path, bytes: &[u8]) -> Result<SpzContent> {
    let mut unzip = GzDecoder::new(bytes);
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
    let mut head = Vec::new();
    inflate(&mut head, HEADER as u64)?;
    if head.len() < HEADER || !head.starts_with(MAGIC) {
        return Err(foreign::gzip(file, &head));
    }
    let (version, promised) = (word(&head, 4), word(&head, 8));
    if !matches!(version, 2 | 3) {
        return Err(Error::version(file, "SPZ", version, READ));
    }
    let flags = head[14];
    let layout = SpzLayout::new(file, version, [head[12], head[13], flags])?;
    let sizes = layout.sizes().map(|size| u64::from(promised) * size as u64);
    let needed = HEADER as u64 + sizes.iter().sum::<u64>();
    let (mut streams, mut len): ([Vec<u8>; 6], _) = (Default::default(), HEADER as u64);
    for (stream, size) in streams.iter_mut().zip(sizes) {
        len += inflate(stream, size)? as u64;
    }
    if len < needed {
        return Err(short(file, len as usize, promised, needed));
    }
    // gzip's checksum is verified at the end of the stream. Surplus data is ignored.
    let mut rest = Vec::new();
    inflate(&mut rest, MOST_RECORD_BYTES)?;
    let records = Records::of(file, flags, &rest)?;
    Ok(SpzContent { version, flags, layout, count: promised as usize, streams, records })
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
