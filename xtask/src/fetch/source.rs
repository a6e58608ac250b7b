//! Archives that are read in parts: on a server or on disk.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::error::{Error, Result};

/// Bytes that can be read from any position.
pub(crate) trait Source {
    /// Where they are.
    fn url(&self) -> &str;
    /// How many there are.
    fn size(&self) -> u64;
    /// Opens bytes `from..to`, `from < to <= size`. The reader may end early: ask again.
    ///
    /// # Errors
    /// Those of the network or file, and [`Error::Moved`] if the bytes are no longer those
    /// that were there at first.
    fn open(&mut self, from: u64, to: u64) -> Result<Box<dyn Read>>;
}

/// An archive on disk.
pub(crate) struct LocalFile {
    path: PathBuf,
    url: String,
    size: u64,
}

impl LocalFile {
    /// The archive at `path`.
    pub(crate) fn at(path: &Path) -> Result<Self> {
        let meta = std::fs::metadata(path).map_err(|e| Error::io(path, "read", e))?;
        let url = path.display().to_string();
        if !meta.is_file() {
            return Err(Error::Address { url, why: "not a file".to_owned() });
        }
        Ok(Self { path: path.to_path_buf(), url, size: meta.len() })
    }
}

impl Source for LocalFile {
    fn url(&self) -> &str {
        &self.url
    }

    fn size(&self) -> u64 {
        self.size
    }

    fn open(&mut self, from: u64, to: u64) -> Result<Box<dyn Read>> {
        let fail = |e| Error::io(&self.path, "read", e);
        let mut file = File::open(&self.path).map_err(fail)?;
        let size = file.metadata().map_err(fail)?.len();
        if size != self.size {
            let why = format!("{} bytes were {}", size, self.size);
            return Err(Error::Moved { url: self.url.clone(), why });
        }
        file.seek(SeekFrom::Start(from)).map_err(fail)?;
        Ok(Box::new(file.take(to - from)))
    }
}
