//! PlayCanvas' `compressed.ply`: Gaussians quantised within chunks of 256, in a binary PLY file.
//!
//! Element `chunk` holds, for every 256 Gaussians, the bounds of their means, log-scales and colours.
//! Element `vertex` holds four words per Gaussian: the mean and the log-scales (11, 10 and 11 bits
//! between the chunk's bounds), the rotation (the three smallest components, 10 bits each), and the
//! colour with the opacity (a byte each). Element `sh`, where there is one, holds a byte per higher SH
//! coefficient, channel-major, between -4 and 4. Older files have no bounds of colours: theirs are 0
//! and 1. Axes are those of other PLY files.

mod layout;
mod order;
mod table;
mod write;

use std::path::Path;

use super::columns::{rest_count, rest_degree, rest_names};
use super::header::{Encoding, PlyHeader, Scalar};
use super::origin;
use crate::error::{Error, Result};
use crate::formats::Format;
use crate::report::{DEGREE_4, Report};
use crate::scene::Scene;
use layout::PackedRows;
use table::ElementTable;

/// Files are read as other PLY files are, whose reader finds them by their header.
pub(crate) static FORMAT: Format = Format {
    name: "compressed-ply",
    about: "compressed.ply of PlayCanvas",
    extensions: &["compressed.ply"],
    magic: super::FORMAT.magic,
    max_sh_degree: 3,
    says_antialiased: true,
    says_origin: true,
    steps: Some(write::steps),
    read: super::FORMAT.read,
    write: Some(write::write),
};

/// Gaussians per chunk.
const CHUNK: usize = 256;
/// Properties of `chunk`, in file order; the last six are missing in older files.
const BOUNDS: [[&str; 6]; 3] = [
    ["min_x", "min_y", "min_z", "max_x", "max_y", "max_z"],
    ["min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z"],
    ["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"],
];
/// Properties of `vertex`, in file order.
const WORDS: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];

/// Reads the file of that header.
pub(super) fn read(file: &Path, bytes: &[u8], header: &PlyHeader) -> Result<(Scene, Report)> {
    if header.encoding != Encoding::BinaryLittleEndian {
        return Err(malformed(file, "header", "it is not binary_little_endian"));
    }
    let (n, sh_degree, decoder) = decoder(file, bytes, header)?;
    let antialiased = header.antialiased().unwrap_or(false);
    let scene = Scene {
        antialiased,
        origin: origin::of_file(&header.comments),
        ..decoder.scene(file, n, sh_degree.min(3))?
    };
    let mut report = Report::of(FORMAT.name, "PlayCanvas compressed.ply");
    report.notes = header.notes(&["vertex", "chunk", "sh"], 0);
    if sh_degree > 3 {
        report.notes.push(DEGREE_4.into());
    }
    Ok((scene, report))
}

/// The number of Gaussians, their SH degree in the file, and where the file holds them.
fn decoder<'a>(
    file: &Path,
    bytes: &'a [u8],
    header: &'a PlyHeader,
) -> Result<(usize, u8, PackedRows<'a>)> {
    let table = |element: &str| ElementTable::find(file, bytes, header, element);
    let needed = |element: &str| {
        table(element)?
            .ok_or_else(|| malformed(file, "header", format!("it has no element {element:?}")))
    };
    let (vertices, chunks) = (needed("vertex")?, needed("chunk")?);
    let n = vertices.rows;
    if chunks.rows < n.div_ceil(CHUNK) {
        return Err(malformed(file, "element \"chunk\"", "it has fewer rows than vertices need"));
    }
    // Some writers declare the element without a property where the degree is 0.
    let sh = table("sh")?.filter(|sh| sh.properties() > 0);
    let count = sh.as_ref().map_or(0, ElementTable::properties);
    let sh_degree = rest_degree(count).ok_or_else(|| rest_count(file, "sh", count))?;
    if sh.as_ref().is_some_and(|sh| sh.rows != n) {
        return Err(malformed(file, "element \"sh\"", "it has other rows than \"vertex\""));
    }
    let bounds = if chunks.has("min_r") { &BOUNDS[..] } else { &BOUNDS[..2] };
    let decoder = PackedRows {
        words: vertices.columns(file, &WORDS, Scalar::U32)?,
        bounds: chunks.columns(file, bounds.as_flattened(), Scalar::F32)?,
        sh: sh.map(|sh| sh.columns(file, &rest_names(sh.properties()), Scalar::U8)).transpose()?,
    };
    Ok((n, sh_degree, decoder))
}

fn malformed(file: &Path, place: &str, reason: impl AsRef<str>) -> Error {
    Error::malformed(file, &format!("compressed.ply, {place}"), reason)
}
