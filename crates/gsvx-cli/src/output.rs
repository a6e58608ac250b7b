//! Writing files so that an interrupted run, a full disk or an existing file loses nothing.

use anyhow::{Context, Result, bail};
use std::io::Write;
use std::path::Path;

/// Fails early, before the work, if `path` cannot become the output.
pub(crate) fn check(path: &Path, force: bool) -> Result<()> {
    if path.is_dir() {
        bail!("{}: is a directory; give a file name", path.display());
    }
    // Renaming onto a device or a pipe would replace it by a file.
    if std::fs::metadata(path).is_ok_and(|m| !m.is_file()) {
        bail!("{}: is not a regular file; give another name", path.display());
    }
    if path.exists() && !force {
        bail!("{}: already exists; pass --force to replace it", path.display());
    }
    let dir = parent(path);
    if !dir.is_dir() {
        bail!("{}: no such directory; create it first", dir.display());
    }
    Ok(())
}

/// Writes through a temporary file beside `path` that is renamed when it is complete.
pub(crate) fn write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    let dir = parent(path);
    let mut file = tempfile::Builder::new()
        .prefix(".gsvx-")
        .suffix(".part")
        .tempfile_in(dir)
        .with_context(|| format!("{}: cannot write here", dir.display()))?;
    let incomplete = || format!("{}: could not be written (is the disk full?)", path.display());
    {
        let mut out = std::io::BufWriter::with_capacity(1 << 20, file.as_file_mut());
        fill(&mut out).with_context(incomplete)?;
        out.flush().with_context(incomplete)?;
    }
    file.as_file().sync_all().with_context(incomplete)?;
    // A temporary file is private; an output is not.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(path).map_or(0o644, |m| m.permissions().mode());
        file.as_file()
            .set_permissions(std::fs::Permissions::from_mode(mode))
            .with_context(incomplete)?;
    }
    file.persist(path).map_err(|e| e.error).with_context(incomplete)?;
    Ok(())
}

fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    }
}

/// Bytes as a person reads them (decimal megabytes).
pub(crate) fn megabytes(bytes: u64) -> String {
    if bytes >= 1_000_000 {
        format!("{:.2} MB", bytes as f64 / 1e6)
    } else if bytes >= 1000 {
        format!("{:.1} kB", bytes as f64 / 1e3)
    } else {
        format!("{bytes} bytes")
    }
}
