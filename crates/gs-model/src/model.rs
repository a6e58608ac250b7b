//! Reading a model of any format of [`Format::all`].

use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
use crate::formats::Format;
use crate::formats::{foreign, ply};
use crate::fs;
use crate::report::{ReadOptions, Report};
use crate::scene::Scene;

/// Reads a model of the format that its first bytes or its name say ([`Format::of`]).
///
/// # Errors
/// What [`Error`] says of files.
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<(Scene, Report)> {
    let path = path.as_ref();
    if let Some(start) = start(path)? {
        // A file that is no model is refused before it is read into memory.
        foreign::refuse(path, &start).map_or(Ok(()), Err)?;
        if Format::of(path, &start) == Some(&ply::FORMAT) {
            return ply::read_with(path, options);
        }
    }
    read_named(path, &fs::read(path)?, options)
}

/// The first bytes of a file that can be read again from its start. A pipe cannot: the bytes read here
/// would be gone.
fn start(path: &Path) -> Result<Option<Vec<u8>>> {
    let io = |e| Error::io(path, "read", e);
    let file = std::fs::File::open(path).map_err(io)?;
    if !file.metadata().map_err(io)?.is_file() {
        return Ok(None);
    }
    let mut start = Vec::new();
    file.take(foreign::START as u64).read_to_end(&mut start).map_err(io)?;
    Ok(Some(start))
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
    foreign::refuse(name, &bytes[..bytes.len().min(foreign::START)]).map_or(Ok(()), Err)?;
    let format = Format::of(name, bytes);
    #[cfg(feature = "formats")]
    if format.is_none_or(|f| !f.magic.is_empty()) {
        foreign::json(name, bytes).map_or(Ok(()), Err)?;
    }
    match format {
        Some(format) => format.read(name, bytes, options),
        None => Err(Error::other_format(name, "a model of a known format", bytes)),
    }
}
