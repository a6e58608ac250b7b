//! Writing files so that an interrupted run, a full disk or an existing file loses nothing.
//!
//! An [`Output`] is opened before the work, so that a folder that cannot be written fails at once.
//! The bytes go to a temporary file beside the final name, which is renamed when it is complete.

use anyhow::{Context, Result, bail};
use std::fs::File;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Duration;
use tempfile::NamedTempFile;

/// Temporary files to remove when the process is interrupted.
static PENDING: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes what an interrupted run has begun to write. The files' final names are untouched.
pub(crate) fn remove_pending() {
    if let Ok(mut pending) = PENDING.lock() {
        for path in pending.drain(..) {
            // Best effort: the process is about to end.
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Names of temporary files.
const PREFIX: &str = ".gsvx-";
const SUFFIX: &str = ".part";
/// Age from which a temporary file without an owner is taken for left behind: long enough for one
/// just created to get its lock.
const STALE: Duration = Duration::from_secs(60);

/// Removes what killed runs left in `dir`. Best effort: what cannot be removed stays.
fn sweep(dir: &Path) {
    for entry in std::fs::read_dir(dir).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some(name) = name.to_str() else { continue };
        if !(name.starts_with(PREFIX) && name.ends_with(SUFFIX)) {
            continue;
        }
        let Ok(file) = File::open(entry.path()) else { continue };
        let age = file.metadata().and_then(|m| m.modified()).map(|t| t.elapsed());
        if age.is_ok_and(|a| a.is_ok_and(|a| a > STALE)) && file.try_lock().is_ok() {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// A file that will appear whole or not at all, or standard output.
pub(crate) struct Output {
    path: PathBuf,
    /// None: standard output.
    file: Option<NamedTempFile>,
    force: bool,
}

impl Output {
    /// Opens `path`, or standard output for `-`.
    pub(crate) fn open(path: &Path, force: bool) -> Result<Self> {
        if is_stdio(path) {
            if std::io::stdout().is_terminal() {
                bail!("standard output is a terminal; redirect it, or name a file with -o");
            }
            return Ok(Self { path: path.into(), file: None, force });
        }
        let name = path.display();
        if path.is_dir() {
            bail!("{name}: is a directory; give a file name");
        }
        if let Ok(there) = std::fs::metadata(path) {
            // Renaming onto a device or a pipe would replace it by a file.
            if !there.is_file() {
                bail!("{name}: is not a regular file; give another name");
            }
            if !force {
                bail!("{name}: already exists; pass --force to replace it");
            }
            if there.permissions().readonly() {
                bail!("{name}: is read-only; make it writable or give another name");
            }
        }
        let dir = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        if !dir.is_dir() {
            bail!("{}: no such directory; create it first", dir.display());
        }
        sweep(dir);
        let file = tempfile::Builder::new()
            .prefix(PREFIX)
            .suffix(SUFFIX)
            .tempfile_in(dir)
            .with_context(|| format!("{}: cannot write here", dir.display()))?;
        // Says to other runs that this file has an owner. A file system without locks costs no
        // more than that.
        let _ = file.as_file().lock();
        if let Ok(mut pending) = PENDING.lock() {
            pending.push(file.path().into());
        }
        Ok(Self { path: path.into(), file: Some(file), force })
    }

    /// True if the bytes go to standard output.
    pub(crate) fn is_stdout(&self) -> bool {
        self.file.is_none()
    }

    /// The name as given.
    pub(crate) fn name(&self) -> String {
        if self.is_stdout() { "standard output".into() } else { self.path.display().to_string() }
    }

    /// Writes everything and gives the file its name.
    pub(crate) fn write(
        mut self,
        fill: impl FnOnce(&mut (dyn Write + Send)) -> Result<()>,
    ) -> Result<()> {
        let Some(file) = &mut self.file else {
            let name = self.name();
            let mut out = std::io::stdout();
            fill(&mut out).with_context(|| name.clone())?;
            return out.flush().with_context(|| name.clone());
        };
        let mut out = std::io::BufWriter::with_capacity(1 << 20, file.as_file_mut());
        let outcome = fill(&mut out).and_then(|()| Ok(out.flush()?));
        drop(out);
        outcome.with_context(|| self.incomplete())?;
        self.finish()
    }

    /// As [`Output::write`], in whatever order the positions have; not for standard output. For what
    /// can be made again: the disk is waited for only where a file is replaced, which a power cut
    /// must not cost.
    #[cfg(unix)]
    pub(crate) fn write_at(
        self,
        fill: impl FnOnce(&(dyn Fn(&[u8], u64) -> std::io::Result<()> + Sync)) -> Result<()>,
    ) -> Result<()> {
        use std::os::unix::fs::FileExt;
        if let Some(file) = &self.file {
            let file = file.as_file();
            fill(&|bytes, at| file.write_all_at(bytes, at)).with_context(|| self.incomplete())?;
        }
        let replaces = self.path.exists();
        self.put_in_place(replaces)
    }

    fn incomplete(&self) -> String {
        format!("{}: could not be written (is the disk full?)", self.name())
    }

    /// Gives the file its name once the disk has it.
    fn finish(self) -> Result<()> {
        self.put_in_place(true)
    }

    fn put_in_place(self, on_disk: bool) -> Result<()> {
        let (name, incomplete) = (self.name(), self.incomplete());
        let incomplete = || incomplete.clone();
        let Some(file) = self.file else { return Ok(()) };
        if on_disk {
            file.as_file().sync_all().with_context(incomplete)?;
        }
        // A temporary file is private; an output is not.
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = std::fs::metadata(&self.path).map_or(0o644, |m| m.permissions().mode());
            file.as_file()
                .set_permissions(std::fs::Permissions::from_mode(mode))
                .with_context(incomplete)?;
        }
        let temporary = file.path().to_path_buf();
        if self.force {
            file.persist(&self.path).map_err(|e| e.error).with_context(incomplete)?;
        } else {
            // Something else may have made the file meanwhile.
            file.persist_noclobber(&self.path)
                .map_err(|e| e.error)
                .with_context(|| format!("{name}: could not be put in place"))?;
        }
        if let Ok(mut pending) = PENDING.lock() {
            pending.retain(|p| *p != temporary);
        }
        Ok(())
    }
}

/// True for `-`, which stands for standard input or output.
pub(crate) fn is_stdio(path: &Path) -> bool {
    path.as_os_str() == "-"
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
