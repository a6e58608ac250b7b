//! A folder for what does not fit in memory. A run that was killed leaves it behind, and the same command goes on
//! from there.
//!
//! Invariant: a file has its name only once it is whole. What another command, another input or another
//! version of this one has left is never used.

use anyhow::{Context, Result, anyhow, bail};
use indicatif::DecimalBytes;
use std::fs::{File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Names the work that the folder is for.
const KEY: &str = "key";
const LOCK: &str = "lock";
/// End of the names of files that are being written.
const UNFINISHED: &str = ".part";
/// The first file with which a later run can go on.
pub(crate) const KEPT: &str = "rows";
/// Names of all files that this command makes there, or their beginnings.
const OURS: [&str; 6] = [KEY, LOCK, "means", "plan", KEPT, "tile-"];

/// A folder that no other run uses.
#[derive(Debug)]
pub(crate) struct Scratch {
    dir: PathBuf,
    /// Held as long as the folder is in use.
    _lock: File,
    /// Whether another run has begun this work.
    pub(crate) resumed: bool,
}

impl Scratch {
    /// Opens `dir`, and empties it if it holds other work than `key`.
    pub(crate) fn open(dir: &Path, key: &str) -> Result<Self> {
        let name = dir.display();
        std::fs::create_dir_all(dir)
            .with_context(|| format!("{name}: the folder for scratch files cannot be made"))?;
        let found = files(dir)?;
        if let Some(other) = found.iter().find(|f| !OURS.iter().any(|ours| f.starts_with(ours))) {
            bail!(
                "{name}: holds {other}, which is no scratch file; name another folder with --scratch"
            );
        }
        let at = |file: &str| dir.join(file);
        let lock = File::create(at(LOCK)).with_context(|| format!("{name}: cannot write here"))?;
        if matches!(lock.try_lock(), Err(TryLockError::WouldBlock)) {
            bail!(
                "{name}: another run is using this folder; wait for it, or name another with --scratch"
            );
        }
        let resumed = std::fs::read_to_string(at(KEY)).is_ok_and(|k| k == key);
        for file in found.iter().filter(|f| *f != LOCK && (!resumed || f.ends_with(UNFINISHED))) {
            std::fs::remove_file(at(file))
                .with_context(|| format!("{name}: {file} cannot be removed"))?;
        }
        let this = Self { dir: dir.into(), _lock: lock, resumed };
        if !resumed {
            this.write(KEY, key.as_bytes())?;
        }
        Ok(this)
    }

    /// Where a file of this name is.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.join(name)
    }

    /// Whether a file is there, whole.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.path(name).exists()
    }

    /// Begins a file, for [`Scratch::finish`].
    pub(crate) fn begin(&self, name: &str) -> Result<File> {
        let path = self.path(&format!("{name}{UNFINISHED}"));
        File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(&path)
            .map_err(|e| self.full(e))
    }

    /// Gives a file its name.
    pub(crate) fn finish(&self, name: &str) -> Result<()> {
        let from = self.path(&format!("{name}{UNFINISHED}"));
        std::fs::rename(from, self.path(name)).map_err(|e| self.full(e))
    }

    /// Writes a whole file.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        self.begin(name)?.write_all(bytes).map_err(|e| self.full(e))?;
        self.finish(name)
    }

    /// Removes a file that is no longer needed.
    pub(crate) fn forget(&self, name: &str) {
        // Best effort: the folder is removed in the end.
        let _ = std::fs::remove_file(self.path(name));
    }

    /// What went wrong with a file here.
    pub(crate) fn full(&self, error: std::io::Error) -> anyhow::Error {
        anyhow!("{}: scratch files cannot be written: {error}", self.dir.display())
    }

    /// Refuses work that needs more room than the disk has. What this work has written already counts.
    pub(crate) fn check_room(&self, needed: u64) -> Result<()> {
        let length = |f: String| self.path(&f).metadata().map_or(0, |m| m.len());
        let there: u64 = files(&self.dir)?.into_iter().map(length).sum();
        match free_bytes(&self.dir) {
            Some(free) if free + there < needed => bail!(
                "{}: {} of scratch files are needed, {} are free; name a folder on another disk with --scratch",
                self.dir.display(),
                DecimalBytes(needed),
                DecimalBytes(free + there)
            ),
            _ => Ok(()),
        }
    }

    /// Removes the folder.
    pub(crate) fn remove(&self) {
        // Best effort: it is of no use any more.
        for file in files(&self.dir).unwrap_or_default() {
            let _ = std::fs::remove_file(self.path(&file));
        }
        let _ = std::fs::remove_dir(&self.dir);
    }
}

impl Drop for Scratch {
    /// After an error: the folder stays where there is something to go on with.
    fn drop(&mut self) {
        if !self.has(KEPT) {
            self.remove();
        }
    }
}

fn files(dir: &Path) -> Result<Vec<String>> {
    let list = std::fs::read_dir(dir).and_then(|list| {
        list.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned())).collect()
    });
    list.with_context(|| format!("{}: cannot be read", dir.display()))
}

/// Bytes that a user may still write to a disk; `None` where the system does not say.
#[cfg(unix)]
fn free_bytes(dir: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(dir).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

#[cfg(not(unix))]
fn free_bytes(_: &Path) -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_files_of_the_same_work_are_kept() {
        let dir = tempfile::tempdir().unwrap();
        let at = dir.path().join("scratch");
        let first = Scratch::open(&at, "a").unwrap();
        first.write(KEPT, b"whole").unwrap();
        first.begin("tile-000001").unwrap();
        assert!(!first.resumed && !first.has("tile-000001"));
        assert!(Scratch::open(&at, "a").unwrap_err().to_string().contains("another run"));
        drop(first);
        let second = Scratch::open(&at, "a").unwrap();
        assert!(second.resumed && second.has(KEPT) && !second.has("tile-000001.part"));
        drop(second);
        let other = Scratch::open(&at, "b").unwrap();
        assert!(!other.resumed && !other.has(KEPT));
        let error = other.check_room(u64::MAX).unwrap_err().to_string();
        assert!(error.contains("--scratch"), "{error}");
        other.check_room(1000).unwrap();
        // An empty folder holds no work to go on with.
        drop(other);
        assert!(!at.exists());
        std::fs::create_dir(&at).unwrap();
        std::fs::write(at.join("thesis.tex"), "").unwrap();
        assert!(Scratch::open(&at, "a").unwrap_err().to_string().contains("thesis.tex"));
    }
}
