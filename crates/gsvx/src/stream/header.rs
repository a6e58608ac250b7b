//! The fixed part of a stream: signature, version, scene parameters, table of contents.

use super::{Reader, SectionKind, TocEntry, Writer};
use crate::error::{Error, Result};
use voxel::Cube;

/// First eight bytes of every stream. The non-ASCII byte, CR LF and ^Z catch text-mode
/// transfers, as in PNG.
pub const SIGNATURE: [u8; 8] = [0x89, b'G', b'S', b'V', b'X', 0x0d, 0x0a, 0x1a];
/// Major version: a reader refuses any other.
pub const MAJOR: u8 = 5;
/// Latest minor version: a reader accepts later ones and skips the sections it does not know. A
/// stream says the earliest minor version that has all its sections.
pub const MINOR: u8 = 1;
/// Greatest table of contents accepted; no encoder writes more than one entry per kind.
const MAX_SECTIONS: u64 = 64;

/// How colours are to be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColourSpace {
    /// As trained: display-referred values of the photos (usually sRGB-encoded).
    #[default]
    AsTrained,
}

/// Axes of the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CoordinateSystem {
    /// As in the input (COLMAP and Inria: right-handed, usually y down, z forward).
    #[default]
    AsTrained,
}

/// Parameters of the whole scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Number of Gaussians.
    pub count: u64,
    /// Runs of consecutive leaves that are coded apart; at least 1.
    pub slices: u64,
    /// SH degree stored, 0 to 3.
    pub sh_degree: u8,
    /// Finest octree depth.
    pub j_high: u8,
    /// The cube the octree divides.
    pub cube: Cube,
    /// How colours are to be read.
    pub colour_space: ColourSpace,
    /// Axes of the world.
    pub coordinate_system: CoordinateSystem,
}

pub(super) fn write(header: &Header, toc: &[TocEntry]) -> Vec<u8> {
    let mut body = Writer::default();
    body.u8(header.sh_degree);
    body.u8(header.j_high);
    body.u8(match header.colour_space {
        ColourSpace::AsTrained => 0,
    });
    body.u8(match header.coordinate_system {
        CoordinateSystem::AsTrained => 0,
    });
    for v in header.cube.origin {
        body.f64(v);
    }
    body.f64(header.cube.side);
    body.varint(header.count);
    body.varint(header.slices);
    body.varint(toc.len() as u64);
    for entry in toc {
        body.u8(entry.kind.code());
        body.varint(entry.len);
        body.u32(entry.crc);
    }
    let mut out = Writer { bytes: SIGNATURE.to_vec() };
    out.u8(MAJOR);
    let latest = toc.iter().any(|entry| entry.kind == SectionKind::Outliers);
    out.u8(if latest { MINOR } else { 0 });
    out.block(&body.bytes);
    let crc = crc32c::crc32c(&out.bytes);
    out.u32(crc);
    out.bytes
}

/// Header, table of contents and the offset of the first section.
pub(super) fn read(bytes: &[u8]) -> Result<(Header, Vec<TocEntry>, usize)> {
    let mut outer = Reader::new(bytes, "header");
    let signature = outer.take(bytes.len().min(SIGNATURE.len()))?;
    if signature != &SIGNATURE[..signature.len()] || signature.is_empty() {
        return Err(Error::NotGsvx);
    }
    if signature.len() < SIGNATURE.len() {
        outer.take(1)?;
    }
    let (major, minor) = (outer.u8()?, outer.u8()?);
    if major != MAJOR {
        return Err(Error::Version { major, minor, ours: MAJOR });
    }
    let block = outer.block()?;
    let end = outer.position();
    let expected = outer.u32()?;
    let found = crc32c::crc32c(&bytes[..end]);
    if found != expected {
        return Err(Error::HeaderChecksum { expected, found });
    }
    let mut r = Reader::new(block, "header");
    let corrupt = |what, value: u64| Error::Corrupt { what, value };
    let sh_degree = r.u8()?;
    if sh_degree > 3 {
        return Err(corrupt("SH degree", sh_degree.into()));
    }
    let j_high = r.u8()?;
    if j_high > gpcc_lite::morton::MAX_DEPTH {
        return Err(corrupt("octree depth", j_high.into()));
    }
    let colour_space = match r.u8()? {
        0 => ColourSpace::AsTrained,
        v => return Err(corrupt("colour space", v.into())),
    };
    let coordinate_system = match r.u8()? {
        0 => CoordinateSystem::AsTrained,
        v => return Err(corrupt("coordinate system", v.into())),
    };
    let origin = [
        r.finite_f64("cube origin x")?,
        r.finite_f64("cube origin y")?,
        r.finite_f64("cube origin z")?,
    ];
    let side = r.finite_f64("cube side")?;
    if side <= 0.0 {
        return Err(corrupt("cube side", side.to_bits()));
    }
    let count = r.varint()?;
    let slices = r.varint()?;
    if slices == 0 || slices > (count / crate::slices::LEAST).max(1) {
        return Err(corrupt("slice count", slices));
    }
    let sections = r.varint()?;
    if sections > MAX_SECTIONS {
        return Err(corrupt("section count", sections));
    }
    let mut toc: Vec<TocEntry> = Vec::with_capacity(sections as usize);
    for _ in 0..sections {
        let kind = SectionKind::from_code(r.u8()?);
        if toc.iter().any(|e| e.kind == kind) {
            return Err(corrupt("repeated section", kind.code().into()));
        }
        toc.push(TocEntry { kind, len: r.varint()?, crc: r.u32()? });
    }
    let header = Header {
        count,
        slices,
        sh_degree,
        j_high,
        cube: Cube { origin, side },
        colour_space,
        coordinate_system,
    };
    Ok((header, toc, end + 4))
}
