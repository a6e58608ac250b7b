//! Reads files, lists folders, and writes files atomically: a written file appears whole or not at
//! all.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).map_err(|e| Error::io(path, "read", e))
}

/// A text file in UTF-8 without a byte order mark. Windows tools write one, or UTF-16.
#[cfg(feature = "cameras")]
pub(crate) fn text(bytes: &[u8]) -> std::borrow::Cow<'_, [u8]> {
    let units = |of: fn([u8; 2]) -> u16, bytes: &[u8]| {
        let units: Vec<u16> = bytes.chunks_exact(2).map(|b| of([b[0], b[1]])).collect();
        String::from_utf16_lossy(&units).into_bytes().into()
    };
    match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => rest.into(),
        [0xff, 0xfe, rest @ ..] => units(u16::from_le_bytes, rest),
        [0xfe, 0xff, rest @ ..] => units(u16::from_be_bytes, rest),
        _ => bytes.into(),
    }
}

/// The names in a folder, sorted; none if the folder does not exist.
#[cfg(feature = "cameras")]
pub(crate) fn names(dir: &Path) -> Result<Vec<OsString>> {
    if !dir.is_dir() {
        return Ok(Vec::new());
    }
    let list = || -> io::Result<Vec<OsString>> {
        fs::read_dir(dir)?.map(|entry| entry.map(|e| e.file_name())).collect()
    };
    let mut names = list().map_err(|e| Error::io(dir, "list", e))?;
    names.sort();
    Ok(names)
}

/// Calls `write` on a new file beside `path`, then renames it to `path`.
///
/// On any failure the temporary file is removed and a file that was at `path` stays as it was. The
/// new file is not synced: this guards against a full disk or a killed process, not against a power
/// cut.
pub(crate) fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<()>,
) -> Result<()> {
    // A device or a pipe (/dev/stdout) is written to, not replaced by a file.
    if fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) {
        let mut out =
            OpenOptions::new().write(true).open(path).map_err(|e| Error::io(path, "open", e))?;
        return write(&mut out);
    }
    let (temporary, mut out) = create_beside(path).map_err(|e| Error::io(path, "create", e))?;
    let outcome = write(&mut out)
        .and_then(|()| fs::rename(&temporary, path).map_err(|e| Error::io(path, "rename", e)));
    if outcome.is_err() {
        // Best effort: the first error is the one to report.
        let _ = fs::remove_file(&temporary);
    }
    outcome
}

/// A new file in the folder of `path`, under a name that no other process uses.
fn create_beside(path: &Path) -> io::Result<(PathBuf, File)> {
    let name = path.file_name().ok_or_else(|| io::Error::from(io::ErrorKind::IsADirectory))?;
    let mut attempt = 0u32;
    loop {
        let mut temporary = OsString::from(".");
        temporary.push(name);
        temporary.push(format!(".{}-{attempt}.tmp", std::process::id()));
        let temporary = path.with_file_name(temporary);
        match OpenOptions::new().write(true).create_new(true).open(&temporary) {
            Ok(file) => return Ok((temporary, file)),
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists && attempt < 1000 => attempt += 1,
            Err(e) => return Err(e),
        }
    }
}
