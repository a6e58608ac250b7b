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

use crate::bytes::{float, half_word, word};
use crate::error::{Error, Result};
use crate::formats::Format;
use crate::report::Report;
use crate::scene::Scene;
use section::{KsplatSection, SECTION_HEADER};

pub(crate) static FORMAT: Format = Format {
    name: "ksplat",
    about: ".ksplat of GaussianSplats3D, version 0.1",
    extensions: &["ksplat"],
    magic: &[],
    max_sh_degree: 3,
    says_antialiased: false,
    says_origin: false,
    steps: None,
    read: |file, bytes, _| read(file, bytes),
    write: None,
};

/// Header bytes.
const HEADER: usize = 4096;
/// What the SH bounds of level 2 are where the header says 0.
const DEFAULT_SH_BOUND: f32 = 1.5;

/// True for the first bytes of a file with the header of a `.ksplat`, whatever its name: early versions of
/// GaussianSplats3D called such files `.splat`. Most of the header is zero.
pub(crate) fn is(bytes: &[u8]) -> bool {
    let Some(header) = bytes.get(..HEADER) else { return false };
    header.starts_with(&[0, 1, 0, 0]) && header[64..].iter().all(|&b| b == 0)
}

fn read(file: &Path, bytes: &[u8]) -> Result<(Scene, Report)> {
    let header = KsplatHeader::parse(file, bytes)?;
    let sections = sections(file, bytes, &header)?;
    let sh_degree = sections.iter().map(|s| s.sh_degree).max().unwrap_or(0);
    let mut scene = Scene { sh_degree, ..Scene::default() };
    for section in &sections {
        scene.append(&section.scene(file)?);
    }
    Ok((scene, Report::of(FORMAT.name, ".ksplat")))
}

/// What the header says of all sections.
struct KsplatHeader {
    sections: usize,
    level: u16,
    sh_bounds: [f32; 2],
}

impl KsplatHeader {
    fn parse(file: &Path, bytes: &[u8]) -> Result<Self> {
        if bytes.len() < HEADER {
            let missing = format!("the header of a .ksplat takes {HEADER} bytes");
            return Err(Error::truncated(file, bytes.len(), missing));
        }
        let (major, minor) = (bytes[0], bytes[1]);
        if major != 0 || minor < 1 {
            return Err(Error::version(file, ".ksplat", format!("{major}.{minor}"), "0.1 is"));
        }
        let level = half_word(bytes, 20);
        if level > 2 {
            let reason = format!("compression level {level}; 0 to 2 are known");
            return Err(Error::malformed(file, "header", reason));
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
fn sections<'a>(
    file: &Path,
    bytes: &'a [u8],
    header: &KsplatHeader,
) -> Result<Vec<KsplatSection<'a>>> {
    let room = (bytes.len() - HEADER) / SECTION_HEADER;
    if header.sections > room {
        let missing =
            format!("{} sections are promised, there is room for {room}", header.sections);
        return Err(Error::truncated(file, bytes.len(), missing));
    }
    let (heads, mut data) = bytes[HEADER..].split_at(header.sections * SECTION_HEADER);
    let mut sections = Vec::with_capacity(header.sections);
    for (i, head) in heads.chunks_exact(SECTION_HEADER).enumerate() {
        let bad = |reason: &str| Error::malformed(file, &format!("section {i}"), reason);
        let (section, rest) = KsplatSection::parse(head, data, header).map_err(bad)?;
        sections.push(section);
        data = rest;
    }
    Ok(sections)
}
