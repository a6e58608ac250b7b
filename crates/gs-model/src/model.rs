//! Reading a model of any format that this crate knows.

use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
use crate::options::ReadOptions;
pub use crate::report::{Format, Report};
use crate::scene::Scene;
use crate::{fs, gltf, ksplat, ply, splat, spz};

/// The kinds of files that are told apart before they are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// PLY, also PlayCanvas' `compressed.ply`.
    Ply,
    /// SPZ.
    Spz,
    /// glTF in one file.
    Gltf,
    /// SOG in one file. It is read where the feature `sog` is on.
    Sog,
    /// `.splat`.
    Splat,
    /// `.ksplat`.
    Ksplat,
}

impl Kind {
    /// What a file is by its first bytes: `ply`; gzip's mark or `NGSP` of SPZ; `glTF`; a zip archive of
    /// SOG. `.splat` and `.ksplat` have no such mark: their name has to end so. Anything else is
    /// taken for PLY, whose reader says that it is none.
    #[must_use]
    pub fn of(name: &Path, bytes: &[u8]) -> Self {
        if has_extension(name, "splat") {
            Self::Splat
        } else if has_extension(name, "ksplat") {
            Self::Ksplat
        } else if bytes.starts_with(&[0x1f, 0x8b]) || bytes.starts_with(b"NGSP") {
            Self::Spz
        } else if bytes.starts_with(b"glTF") || has_extension(name, "gltf") {
            Self::Gltf
        } else if bytes.starts_with(b"PK") {
            Self::Sog
        } else {
            Self::Ply
        }
    }
}

/// Reads a model of the kind that its first bytes or its name say ([`Kind::of`]), or a SOG from its
/// `meta.json` and the images beside it.
///
/// # Errors
/// Those of [`ply::read_with`]; [`Error::Malformed`], [`Error::SplatLength`] or an `Spz*` error of the other
/// formats; [`Error::InvalidGaussian`] as the options say.
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<(Scene, Report)> {
    let path = path.as_ref();
    if !has_no_mark(path) && starts_like_ply(path)? {
        return match ply::read_with(path, options) {
            Ok((scene, report)) => Ok((scene, of_ply(report))),
            Err(Error::PlyCompressed { .. }) => {
                ply::compressed::decode(path, &fs::read(path)?, options)
            }
            Err(error) => Err(error),
        };
    }
    #[cfg(feature = "sog")]
    if has_extension(path, "json") {
        return crate::sog::decode_beside(path, &fs::read(path)?, options);
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
    let name = name.as_ref();
    read_as(Kind::of(name, bytes), name, bytes, options)
}

/// Reads a model of a known kind from bytes. `name` is the file in errors.
///
/// # Errors
/// As [`read`].
pub fn read_as(
    kind: Kind,
    name: impl AsRef<Path>,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<(Scene, Report)> {
    let name = name.as_ref();
    match kind {
        Kind::Splat => splat::decode(name, bytes, options),
        Kind::Ksplat => ksplat::decode(name, bytes, options),
        Kind::Spz => spz::decode(name, bytes, options),
        Kind::Gltf => gltf::decode(name, bytes, options),
        #[cfg(feature = "sog")]
        Kind::Sog => crate::sog::decode(name, bytes, options),
        #[cfg(not(feature = "sog"))]
        Kind::Sog => Err(Error::malformed(name, "SOG", "the file", "is not read by this build")),
        Kind::Ply => match ply::read_named(name, bytes, options) {
            Ok((scene, report)) => Ok((scene, of_ply(report))),
            Err(Error::PlyCompressed { .. }) => ply::compressed::decode(name, bytes, options),
            Err(error) => Err(error),
        },
    }
}
