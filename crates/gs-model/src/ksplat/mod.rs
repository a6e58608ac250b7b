//! `.ksplat` files of GaussianSplats3D (mkkellogg), version 0.1: read only.
//!
//! A header of 4,096 bytes, a header of 1,024 bytes for each section, then the sections. A section is a
//! list of bucket sizes, the buckets' centres, and a row per Gaussian: mean, standard deviations,
//! quaternion (w first), colour and opacity as bytes, SH coefficients above degree 0, degree by degree
//! and channel-major. At compression level 0 these are `f32`. At levels 1 and 2 a mean is three 16-bit
//! steps from the centre of the Gaussian's bucket, and scales, quaternions and SH are half floats; at
//! level 2 SH coefficients are bytes between bounds in the header. Axes are those of PLY files. The
//! format is that of GaussianSplats3D 0.4.7; it has no other description than that source.

mod section;

use std::path::Path;

use crate::error::{Error, Result};
use crate::options::ReadOptions;
use crate::report;
use crate::rows;
use crate::scene::Scene;
use section::{SECTION_HEADER, Section};

/// Header bytes.
const HEADER: usize = 4096;
/// What the SH bounds of level 2 are where the header says 0.
const DEFAULT_SH_BOUND: f32 = 1.5;

pub(crate) fn decode(
    file: &Path,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<(Scene, report::Report)> {
    let header = Header::parse(file, bytes)?;
    let sections = sections(file, bytes, &header)?;
    let degree = sections.iter().map(|s| s.sh_degree).max().unwrap_or(0);
    // Every row of a section is in the file, so the sum is bounded by its length.
    let mut scene = Scene::zeros(sections.iter().map(|s| s.rows).sum(), degree);
    let mut first = 0;
    for section in &sections {
        rows::fill_range(&mut scene, first..first + section.rows, |mut rows| {
            for i in 0..rows.len() {
                let row = section.row(rows.first + i - first);
                rows.set(i, |c| row.number(c));
            }
            Ok(())
        })?;
        first += section.rows;
    }
    report::finish(file, scene, report::Format::Ksplat, options)
}

/// What the header says of all sections.
struct Header {
    sections: usize,
    level: u16,
    sh_bounds: [f32; 2],
}

impl Header {
    fn parse(file: &Path, bytes: &[u8]) -> Result<Self> {
        let bad = |reason: String| Err(malformed(file, "header", &reason));
        if bytes.len() < HEADER {
            return bad(format!("takes {HEADER} bytes, the file has {}", bytes.len()));
        }
        let (major, minor) = (bytes[0], bytes[1]);
        if major != 0 || minor < 1 {
            return bad(format!("has version {major}.{minor}; 0.1 is read"));
        }
        let level = half_word(bytes, 20);
        if level > 2 {
            return bad(format!("has compression level {level}; 0 to 2 are known"));
        }
        let bound = |at: usize, default: f32| match float(bytes, at) {
            0.0 => default,
            bound => bound,
        };
        let sh_bounds = [bound(36, -DEFAULT_SH_BOUND), bound(40, DEFAULT_SH_BOUND)];
        Ok(Self { sections: word(bytes, 4) as usize, level, sh_bounds })
    }
}

/// The sections, in file order.
fn sections<'a>(file: &Path, bytes: &'a [u8], header: &Header) -> Result<Vec<Section<'a>>> {
    let room = (bytes.len() - HEADER) / SECTION_HEADER;
    if header.sections > room {
        let reason = format!("promises {} sections, the file has room for {room}", header.sections);
        return Err(malformed(file, "header", &reason));
    }
    let (heads, mut data) = bytes[HEADER..].split_at(header.sections * SECTION_HEADER);
    let mut sections = Vec::with_capacity(header.sections);
    for (i, head) in heads.chunks_exact(SECTION_HEADER).enumerate() {
        let bad = |reason: &str| malformed(file, &format!("section {i}"), reason);
        let (section, rest) = Section::parse(head, data, header).map_err(bad)?;
        sections.push(section);
        data = rest;
    }
    Ok(sections)
}

fn malformed(file: &Path, place: &str, reason: &str) -> Error {
    Error::malformed(file, ".ksplat", place, reason)
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn half_word(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(word(bytes, at))
}
