//! Reading a model of any format that this crate knows.

use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
use crate::options::ReadOptions;
pub use crate::report::{Format, Report};
use crate::scene::Scene;
use crate::{fs, gltf, ksplat, ply, splat, spz};

/// Reads a model, whose first bytes say what it is: PLY (also PlayCanvas' `compressed.ply`), SPZ (gzip or
/// `NGSP`), glTF (`glTF`), SOG (a zip archive, or the `meta.json` of an unbundled one). `.splat` and
/// `.ksplat` have no such mark: their name has to end so.
///
/// # Errors
/// Those of [`ply::read_with`] and of the other readers.
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<(Scene, Report)> {
    let path = path.as_ref();
    if !has_no_mark(path) && starts_like_ply(path)? {
        return match ply::read_with(path, options) {
            Ok((scene, report)) => Ok((scene, of_ply(report))),
            Err(Error::PlyCompressed { .. }) => ply::compressed::read(path, options),
            Err(error) => Err(error),
        };
    }
    #[cfg(feature = "sog")]
    if has_extension(path, "json") {
        return crate::sog::read(path, options);
    }
    read_named(path, &fs::read(path)?, options)
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// True for files that their name alone identifies.
fn has_no_mark(path: &Path) -> bool {
    has_extension(path, "splat") || has_extension(path, "ksplat")
}

/// True for a PLY file that can be read again from its start. A pipe cannot: the bytes read here are
/// gone.
fn starts_like_ply(path: &Path) -> Result<bool> {
    let io = |e| Error::io(path, "read", e);
    let mut file = std::fs::File::open(path).map_err(io)?;
    if !file.metadata().map_err(io)?.is_file() {
        return Ok(false);
    }
    let mut start = Vec::new();
    file.by_ref().take(3).read_to_end(&mut start).map_err(io)?;
    Ok(start == b"ply")
}

fn of_ply(ply: ply::ReadReport) -> Report {
    Report {
        format: Format::Ply(ply.format),
        gaussians_in_file: ply.gaussians_in_file,
        dropped: ply.dropped.clone(),
        clamped_opacities: ply.clamped_opacities,
        ply: Some(ply),
    }
}

/// Reads a model from bytes, as [`read`] does from a file. `name` replaces the path of the file in
/// the choice of the format and in errors.
///
/// # Errors
/// As [`read`].
pub fn read_named(
    name: impl AsRef<Path>,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<(Scene, Report)> {
    let path = name.as_ref();
    if has_extension(path, "splat") {
        return splat::decode(path, bytes, options);
    }
    if has_extension(path, "ksplat") {
        return ksplat::decode(path, bytes, options);
    }
    if bytes.starts_with(&[0x1f, 0x8b]) || bytes.starts_with(b"NGSP") {
        return spz::decode(path, bytes, options);
    }
    if bytes.starts_with(b"glTF") || has_extension(path, "gltf") {
        return gltf::decode(path, bytes, options);
    }
    if bytes.starts_with(b"PK") {
        #[cfg(feature = "sog")]
        return crate::sog::decode(path, bytes, options);
        #[cfg(not(feature = "sog"))]
        return Err(Error::malformed(path, "SOG", "the file", "is not read by this build"));
    }
    match ply::read_named(path, bytes, options) {
        Ok((scene, report)) => Ok((scene, of_ply(report))),
        Err(Error::PlyCompressed { .. }) => ply::compressed::decode(path, bytes, options),
        Err(error) => Err(error),
    }
}
