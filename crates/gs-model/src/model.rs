//! Reading a model of any format that this crate knows.

use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
use crate::options::ReadOptions;
pub use crate::report::{Format, Report};
use crate::scene::Scene;
use crate::{fs, ply, splat, spz};

/// Reads a model: SPZ if the file starts as one (gzip or `NGSP`), `.splat` if its name ends in
/// `.splat`, else PLY.
///
/// # Errors
/// Those of [`ply::read_with`], [`spz::read`] and [`splat::read`].
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<(Scene, Report)> {
    let path = path.as_ref();
    let splat = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("splat"));
    if !splat && starts_like_ply(path)? {
        let (scene, report) = ply::read_with(path, options)?;
        return Ok((scene, of_ply(report)));
    }
    read_named(path, &fs::read(path)?, options)
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
    if bytes.starts_with(&[0x1f, 0x8b]) || bytes.starts_with(b"NGSP") {
        return spz::decode(path, bytes, options);
    }
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("splat")) {
        return splat::decode(path, bytes, options);
    }
    let (scene, ply) = ply::read_named(path, bytes, options)?;
    Ok((scene, of_ply(ply)))
}
