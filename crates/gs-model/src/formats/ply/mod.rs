//! 3DGS models in PLY files: the layout of the Inria reference implementation.
//!
//! One `vertex` per Gaussian: mean `x y z`, `f_dc_0..2` (SH degree 0), `f_rest_*` (the higher
//! SH coefficients, **channel-major**: all of red, then green, then blue), `opacity` (a logit),
//! `scale_0..2` (natural logarithms), `rot_0..3` (quaternion, w first). The reader takes ASCII
//! and both binary formats, properties in any order and of any scalar type, with or without
//! normals. [`Report::notes`] names what it skips: other properties that are not zero, other elements, SH
//! coefficients of degree 4, comments that say more than who made the file. It also takes models of 2D Gaussian
//! splatting (two scales), of Mip-Splatting (`filter_3D`), and with `red green blue`: the notes say what became
//! of them. A comment says whether a model is antialiased: `SplatRenderMode: mip`, or Postshot's `antialiased 1`; the
//! former is written. PlayCanvas' `compressed.ply` is read too, under the feature `formats`.

mod ascii;
mod binary;
mod columns;
#[cfg(feature = "formats")]
pub(crate) mod compressed;
mod header;
mod origin;
mod stream;
mod timed;
mod variants;
mod write;

use std::path::Path;

pub use header::MAX_HEADER_BYTES;
pub use stream::Parts;
pub use timed::TimedModel;
pub use write::{header, row_bytes, rows, write, write_rows_to, write_to};

use columns::Columns;
use header::{Encoding, PlyHeader};

use crate::error::{Error, Result};
use crate::formats::Format;
use crate::formats::foreign;
use crate::fs;
use crate::report::{ReadOptions, Report};
use crate::scene::Scene;

pub(crate) static FORMAT: Format = Format {
    name: "ply",
    about: "PLY of 3DGS (Inria, gsplat ...), of 2D Gaussian splatting and of Mip-Splatting; every float as it is",
    extensions: &["ply"],
    magic: &[b"ply"],
    max_sh_degree: 3,
    says_antialiased: true,
    says_origin: true,
    steps: None,
    read: |file, bytes, _| read_file(file, bytes),
    write: Some(write::write_all),
};

/// Reads a 3DGS model, with the default [`ReadOptions`].
///
/// Memory: the scene, and the file too if it is ASCII or has lists or other elements. A header that
/// promises more rows than the file holds is an error before anything is allocated for them.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read; [`Error::OtherFormat`], [`Error::Malformed`] or
/// [`Error::Truncated`] if it is not a 3DGS model or not whole; [`Error::InvalidGaussian`].
pub fn read(path: impl AsRef<Path>) -> Result<(Scene, Report)> {
    read_with(path, &ReadOptions::default())
}

/// As [`read`], with other options.
pub(crate) fn read_with(path: impl AsRef<Path>, options: &ReadOptions) -> Result<(Scene, Report)> {
    let path = path.as_ref();
    let Some((mut scene, mut report)) = stream::read(path)? else {
        return FORMAT.read(path, &fs::read(path)?, options);
    };
    options.apply(path, &mut scene, &mut report)?;
    Ok((scene, report))
}

/// Reads a 3DGS model from the bytes of a PLY file, with the default [`ReadOptions`].
///
/// # Errors
/// As [`read`]; the file in the errors is `<bytes>`.
pub fn read_bytes(bytes: &[u8]) -> Result<(Scene, Report)> {
    FORMAT.read("<bytes>", bytes, &ReadOptions::default())
}

const MOVES: &str = "a model that moves (SpaceTime Gaussians or FreeTimeGS); gsvx encode --fps makes a sequence of it";

fn read_file(file: &Path, bytes: &[u8]) -> Result<(Scene, Report)> {
    let header = header::parse(file, bytes)?;
    let Some(vertex_at) = header.elements.iter().position(|e| e.name == "vertex") else {
        return Err(Error::malformed(file, "header", "no element \"vertex\""));
    };
    let vertex = &header.elements[vertex_at];
    if vertex.properties.iter().any(|p| p.name == "packed_position") {
        #[cfg(feature = "formats")]
        return compressed::read(file, bytes, &header);
        #[cfg(not(feature = "formats"))]
        return Err(Error::malformed(
            file,
            "header",
            "a compressed.ply, which this build does not read",
        ));
    }
    if vertex.moves() {
        return Err(foreign::is(file, MOVES));
    }
    let (before, after) = (&header.elements[..vertex_at], &header.elements[vertex_at + 1..]);
    let mut columns = Columns::of(file, vertex).map_err(|error| {
        let faces = header.elements.iter().find(|e| e.name == "face" && e.count > 0);
        faces.map_or(error, |faces| {
            foreign::is(
                file,
                &format!("a mesh of {} faces; gsvx reads models of Gaussians", faces.count),
            )
        })
    })?;
    let (scene, trailing_bytes) = match header.encoding {
        Encoding::Ascii => {
            let mut lines = ascii::Lines::new(file, bytes, &header);
            before.iter().try_for_each(|e| lines.skip(e))?;
            let scene = lines.vertices(vertex, &mut columns)?;
            after.iter().try_for_each(|e| lines.skip(e))?;
            (scene, lines.trailing())
        }
        encoding => {
            let big_endian = encoding == Encoding::BinaryBigEndian;
            let body = binary::BinaryBody { file, bytes, big_endian };
            let at = before.iter().try_fold(header.len, |at, e| body.skip(e, at))?;
            let (scene, at) = body.vertices(vertex, &mut columns, at)?;
            let end = after.iter().try_fold(at, |at, e| body.skip(e, at))?;
            (scene, bytes.len() - end)
        }
    };
    let scene = Scene {
        antialiased: antialiased(&header, &columns),
        origin: columns.scene_origin(&header),
        ..scene
    };
    Ok((scene, report_of(&header, &columns, trailing_bytes)))
}

/// Whether a model is antialiased. Models of Mip-Splatting are, whatever their comments leave out.
fn antialiased(header: &PlyHeader, columns: &Columns) -> bool {
    header.antialiased().unwrap_or(columns.variants.filter_3d.is_some())
}

/// What a file of that header holds, after its rows were read.
fn report_of(header: &PlyHeader, columns: &Columns, trailing_bytes: usize) -> Report {
    let mut report = Report::of(FORMAT.name, header.encoding.form());
    report.notes = columns.variants.notes();
    report.notes.extend(columns.notes());
    report.notes.extend((columns.origin != [0.0; 3]).then(|| origin::note(columns.origin)));
    report.notes.extend(header.notes(&["vertex"], trailing_bytes));
    report
}
