//! 3DGS models in PLY files: the layout of the Inria reference implementation.
//!
//! One `vertex` per Gaussian: mean `x y z`, `f_dc_0..2` (SH degree 0), `f_rest_*` (the higher
//! SH coefficients, **channel-major**: all of red, then green, then blue), `opacity` (a logit),
//! `scale_0..2` (natural logarithms), `rot_0..3` (quaternion, w first). The reader takes ASCII
//! and both binary formats, properties in any order and of any scalar type, with or without
//! normals. It skips other properties and elements and names them in the [`ReadReport`]. It also takes
//! models of 2D Gaussian splatting (two scales), of Mip-Splatting (`filter_3D`), and with `red green blue`
//! as bytes: [`ReadReport::notes`] says what became of them. [`compressed`] is PlayCanvas' format in PLY.

mod ascii;
mod binary;
mod columns;
pub mod compressed;
mod header;
mod report;
mod stream;
mod variants;
mod write;

use std::path::Path;

pub use header::{Format, MAX_HEADER_BYTES};
pub use report::ReadReport;
pub use stream::Parts;
pub use write::{header, row_bytes, rows, write, write_rows_to, write_to};

use report::{Extent, finish};

use crate::error::{Error, Result};
use crate::fs;
pub use crate::options::{CLAMPED_OPACITY_LOGIT, Invalid, ReadOptions};
use crate::scene::Scene;

/// Reads a 3DGS model, with the default [`ReadOptions`].
///
/// # Errors
/// [`Error::Io`] if the file cannot be read, a `Ply*` error if it is not a 3DGS model or not
/// whole, [`Error::InvalidGaussian`] if a Gaussian is invalid.
pub fn read(path: impl AsRef<Path>) -> Result<(Scene, ReadReport)> {
    read_with(path, &ReadOptions::default())
}

/// Reads a 3DGS model.
///
/// Memory: the scene, and the file too if it is ASCII or has lists or other elements. A header that
/// promises more rows than the file holds is an error before anything is allocated for them.
///
/// # Errors
/// As [`read`]; with [`Invalid::Drop`] no invalid Gaussian is an error.
pub fn read_with(path: impl AsRef<Path>, options: &ReadOptions) -> Result<(Scene, ReadReport)> {
    let path = path.as_ref();
    match stream::read(path, options)? {
        Some(read) => Ok(read),
        None => read_named(path, &fs::read(path)?, options),
    }
}

/// Reads a 3DGS model from the bytes of a PLY file, with the default [`ReadOptions`].
///
/// # Errors
/// As [`read`]; the file in the errors is `<bytes>`.
pub fn read_bytes(bytes: &[u8]) -> Result<(Scene, ReadReport)> {
    read_bytes_with(bytes, &ReadOptions::default())
}

/// Reads a 3DGS model from the bytes of a PLY file.
///
/// # Errors
/// As [`read_with`]; the file in the errors is `<bytes>`.
pub fn read_bytes_with(bytes: &[u8], options: &ReadOptions) -> Result<(Scene, ReadReport)> {
    read_named(Path::new("<bytes>"), bytes, options)
}

pub(crate) fn read_named(
    file: &Path,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<(Scene, ReadReport)> {
    let header = header::parse(file, bytes)?;
    let Some(vertex_at) = header.elements.iter().position(|e| e.name == "vertex") else {
        return Err(Error::PlyNoVertex { file: file.into() });
    };
    let vertex = &header.elements[vertex_at];
    let (before, after) = (&header.elements[..vertex_at], &header.elements[vertex_at + 1..]);
    let columns = columns::Columns::of(file, vertex)?;

    let (scene, trailing_bytes) = match header.format {
        Format::Ascii => {
            let mut lines = ascii::Lines::new(file, bytes, &header);
            before.iter().try_for_each(|e| lines.skip(e))?;
            let scene = lines.vertices(vertex, &columns)?;
            after.iter().try_for_each(|e| lines.skip(e))?;
            (scene, lines.trailing())
        }
        Format::BinaryLittleEndian | Format::BinaryBigEndian => {
            let body =
                binary::Body { file, bytes, big_endian: header.format == Format::BinaryBigEndian };
            let at = before.iter().try_fold(header.len, |at, e| body.skip(e, at))?;
            let (scene, at) = body.vertices(vertex, &columns, at)?;
            let end = after.iter().try_fold(at, |at, e| body.skip(e, at))?;
            (scene, bytes.len() - end)
        }
    };

    let skipped_elements = before.iter().chain(after).map(|e| (e.name.clone(), e.count)).collect();
    let file_bytes = bytes.len();
    let extent = Extent { vertex, skipped_elements, file_bytes, trailing_bytes };
    finish(file, scene, options, &header, columns, extent)
}
