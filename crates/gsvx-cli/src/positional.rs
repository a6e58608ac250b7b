//! Reading and writing at a position of a file, from several threads at once.

use std::fs::File;
use std::io::{Read, Result, Write};
#[cfg(unix)]
use std::os::unix::fs::FileExt;
#[cfg(windows)]
use std::os::windows::fs::FileExt;

/// A position in a file, which moves behind what is read or written here. It is not the file's own: it does not
/// matter that Windows moves that too.
pub(crate) struct At<'a>(pub(crate) &'a File, pub(crate) u64);

impl Read for At<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize> {
        #[cfg(unix)]
        let n = self.0.read_at(bytes, self.1)?;
        #[cfg(windows)]
        let n = self.0.seek_read(bytes, self.1)?;
        self.1 += n as u64;
        Ok(n)
    }
}

impl Write for At<'_> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        #[cfg(unix)]
        let n = self.0.write_at(bytes, self.1)?;
        #[cfg(windows)]
        let n = self.0.seek_write(bytes, self.1)?;
        self.1 += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }
}
