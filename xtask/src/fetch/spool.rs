//! What has arrived of one archive entry, on disk: a fetch that ends early goes on from there.

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::error::{Error, Result};

/// A growing copy of bytes `start..end` of an archive, from `start` on.
pub(crate) struct Spool {
    path: PathBuf,
    file: File,
    start: u64,
    end: u64,
    held: u64,
}

impl Spool {
    /// Opens the copy at `path`, with what is already in it.
    pub(crate) fn open(path: &Path, start: u64, end: u64) -> Result<Self> {
        let fail = |e| Error::io(path, "open", e);
        let mut options = OpenOptions::new();
        let file =
            options.read(true).write(true).create(true).truncate(false).open(path).map_err(fail)?;
        let held = file.metadata().map_err(fail)?.len();
        let mut spool = Self { path: path.to_path_buf(), file, start, end, held };
        if held > end - start {
            spool.clear()?;
        }
        Ok(spool)
    }

    /// True if the copy is meant to hold the byte at `pos`.
    pub(crate) fn covers(&self, pos: u64) -> bool {
        (self.start..self.end).contains(&pos)
    }

    /// Position behind the last byte held.
    pub(crate) fn reach(&self) -> u64 {
        self.start + self.held
    }

    /// How many bytes are still to come.
    pub(crate) fn room(&self) -> u64 {
        self.end - self.reach()
    }

    /// Reads held bytes from `pos`, which is within `start..reach`.
    pub(crate) fn read(&mut self, pos: u64, buf: &mut [u8]) -> Result<usize> {
        let n = buf.len().min(usize::try_from(self.reach() - pos).unwrap_or(usize::MAX));
        let fail = |e| Error::io(&self.path, "read", e);
        self.file.seek(SeekFrom::Start(pos - self.start)).map_err(fail)?;
        self.file.read(&mut buf[..n]).map_err(fail)
    }

    /// Holds the bytes behind [`Spool::reach`].
    pub(crate) fn append(&mut self, bytes: &[u8]) -> Result<()> {
        let fail = |e| Error::io(&self.path, "write", e);
        self.file.seek(SeekFrom::Start(self.held)).map_err(fail)?;
        self.file.write_all(bytes).map_err(fail)?;
        self.held += bytes.len() as u64;
        Ok(())
    }

    /// Forgets what is held.
    pub(crate) fn clear(&mut self) -> Result<()> {
        self.file.set_len(0).map_err(|e| Error::io(&self.path, "clear", e))?;
        self.held = 0;
        Ok(())
    }
}
