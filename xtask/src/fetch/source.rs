//! Bytes of an archive, from a server or from disk.

use std::fmt;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::fault::{Fault, Kind, Retry};
use super::server::Server;

/// An archive that is read in parts.
pub(crate) struct Source {
    place: Place,
    retry: Retry,
}

enum Place {
    Server(Server),
    Disk { path: PathBuf, size: u64 },
}

impl Source {
    /// The archive at an `http://` or `https://` address, a `file://` address or a path. `timeout`
    /// is the longest silence of a server.
    pub(crate) fn open(address: &str, timeout: Duration, retry: Retry) -> Result<Self, Fault> {
        let place = if address.starts_with("http://") || address.starts_with("https://") {
            Place::Server(retry.run(|| (false, Server::connect(address, timeout)))?)
        } else {
            let path = Path::new(address.strip_prefix("file://").unwrap_or(address)).to_path_buf();
            let fault = |e| Fault::new(Kind::Unusable, format!("{}: {e}", path.display()));
            let size = std::fs::metadata(&path).map_err(fault)?.len();
            Place::Disk { path, size }
        };
        Ok(Self { place, retry })
    }

    /// Where the archive is.
    pub(crate) fn address(&self) -> String {
        match &self.place {
            Place::Server(server) => server.url.clone(),
            Place::Disk { path, .. } => path.display().to_string(),
        }
    }

    /// Size of the archive.
    pub(crate) fn size(&self) -> u64 {
        match &self.place {
            Place::Server(server) => server.size,
            Place::Disk { size, .. } => *size,
        }
    }

    /// Gives bytes `from..to` to `put`, piece by piece and in order. Where a connection breaks, it
    /// goes on behind the last byte that came.
    pub(crate) fn copy(
        &self,
        from: u64,
        to: u64,
        mut put: impl FnMut(&[u8]) -> std::io::Result<()>,
    ) -> Result<(), Fault> {
        let (mut at, mut chunk) = (from, vec![0; 1 << 16]);
        self.retry.run(|| {
            let began = at;
            let done = self.copy_once(&mut at, to, &mut chunk, &mut put);
            (at > began, done)
        })
    }

    fn copy_once(
        &self,
        at: &mut u64,
        to: u64,
        chunk: &mut [u8],
        put: &mut dyn FnMut(&[u8]) -> std::io::Result<()>,
    ) -> Result<(), Fault> {
        if *at >= to {
            return Ok(());
        }
        let mut body = self.body(*at, to)?;
        while *at < to {
            let broken = |why: &dyn fmt::Display| {
                let what = format!("{}: broke at byte {at}: {why}", self.address());
                Fault::new(Kind::Interrupted, what)
            };
            let n = match body.read(chunk) {
                Ok(0) => return Err(broken(&"it ended early")),
                Ok(n) => n,
                Err(e) => return Err(broken(&e)),
            };
            put(&chunk[..n]).map_err(|e| Fault::new(Kind::Local, format!("write: {e}")))?;
            *at += n as u64;
        }
        Ok(())
    }

    fn body(&self, from: u64, to: u64) -> Result<Box<dyn Read>, Fault> {
        match &self.place {
            Place::Server(server) => server.body(from, to),
            Place::Disk { path, .. } => {
                let open = || {
                    let mut file = File::open(path)?;
                    file.seek(SeekFrom::Start(from))?;
                    Ok(file.take(to - from))
                };
                let fault = |e: std::io::Error| {
                    Fault::new(Kind::Unusable, format!("{}: {e}", path.display()))
                };
                Ok(Box::new(open().map_err(fault)?))
            }
        }
    }
}
