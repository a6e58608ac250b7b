//! The central directory of a ZIP archive: which entries are wanted, and where each is.

use std::io::{self, Read, Seek, SeekFrom};

use anyhow::{Context, Result, anyhow, bail, ensure};
use zip::{CompressionMethod, ZipArchive};

use super::catalogue::Archive;
use super::fault::Fault;
use super::source::Source;

/// A wanted entry.
#[derive(Clone, Debug)]
pub(crate) struct Item {
    /// Path below the scene's folder, with `/`.
    pub(crate) path: String,
    /// Name in the archive.
    pub(crate) name: String,
    /// Bytes unpacked.
    pub(crate) size: u64,
    /// Bytes packed.
    pub(crate) packed: u64,
    /// Whether they are packed by deflate, or stored.
    pub(crate) deflated: bool,
    /// CRC-32 of the bytes unpacked.
    pub(crate) crc32: u32,
    /// The entry lies within these bytes of the archive, local header first.
    pub(crate) start: u64,
    pub(crate) end: u64,
}

/// Reads the central directory and picks what `archive` is wanted for out of `folder`, in the order
/// of the archive's bytes.
pub(crate) fn items(source: &Source, archive: &Archive, folder: &str) -> Result<Vec<Item>> {
    let address = source.address();
    let zip = ZipArchive::new(Tail::read(source)?)
        .map_err(|e| anyhow!("{address}: not a usable ZIP archive: {e}"))?;
    let mut entries = Vec::with_capacity(zip.len());
    for i in 0..zip.len() {
        let entry = zip.by_index_data(i).with_context(|| address.clone())?;
        entries.push((entry.name().with_context(|| address.clone())?.into_owned(), entry));
    }
    let mut starts: Vec<u64> = entries.iter().map(|(_, e)| e.header_start()).collect();
    starts.push(zip.central_directory_start());
    starts.sort_unstable();

    let names: Vec<&str> = entries.iter().map(|(name, _)| name.as_str()).collect();
    let mut items = Vec::new();
    for (index, path) in picks(&names, archive, folder).with_context(|| address.clone())? {
        let (name, entry) = &entries[index];
        ensure!(is_plain(&path), "{address}: entry {name:?} leads out of the scene's folder");
        let deflated = match entry.compression() {
            CompressionMethod::Stored => false,
            CompressionMethod::Deflated => true,
            other => bail!("{address}: entry {name:?} is packed by {other}"),
        };
        let start = entry.header_start();
        // Up to the next entry: the length of the local header is not known from here.
        let end = starts[starts.partition_point(|&s| s <= start).min(starts.len() - 1)];
        let packed = entry.compressed_size();
        let fits = !entry.encrypted() && end.saturating_sub(start) >= packed;
        ensure!(fits, "{address}: entry {name:?} is encrypted or longer than its place");
        let (size, crc32) = (entry.size(), entry.crc32());
        items.push(Item { path, name: name.clone(), size, packed, deflated, crc32, start, end });
    }
    items.sort_by_key(|item| item.start);
    Ok(items)
}

/// Index and path on disk of every wanted entry.
fn picks(names: &[&str], archive: &Archive, folder: &str) -> Result<Vec<(usize, String)>> {
    let mut picks = Vec::new();
    for choices in archive.files {
        let found = choices.iter().find_map(|(from, to)| {
            let at = names.iter().position(|n| n.strip_prefix(folder) == Some(from))?;
            Some((at, (*to).to_owned()))
        });
        let first = choices.first().map_or("", |c| c.0);
        picks.push(found.with_context(|| format!("there is no entry {folder}{first}"))?);
    }
    if let Some(photos) = archive.photos {
        let before = picks.len();
        for (index, name) in names.iter().enumerate() {
            let path = name.strip_prefix(folder).filter(|p| p.starts_with(photos) && is_photo(p));
            picks.extend(path.map(|p| (index, p.to_owned())));
        }
        ensure!(picks.len() > before, "there is no entry {folder}{photos}*.jpg");
    }
    Ok(picks)
}

fn is_photo(path: &str) -> bool {
    // macOS puts a second file beside each, with this prefix.
    let hidden = path.rsplit('/').next().is_some_and(|file| file.starts_with("._"));
    let lower = path.to_lowercase();
    !hidden && [".jpg", ".jpeg", ".png"].iter().any(|e| lower.ends_with(e))
}

/// True if `path` stays below the folder that it is joined to, on every system.
pub(crate) fn is_plain(path: &str) -> bool {
    let odd = |c: char| c.is_control() || "\\:*?\"<>|".contains(c);
    !path.contains(odd) && path.split('/').all(|p| !p.is_empty() && p != "." && p != "..")
}

/// Bytes from the end of an archive that hold its central directory, of ten thousand entries or so.
const TAIL: u64 = 1 << 20;

/// The end of an archive as a file of the archive's size.
struct Tail {
    /// Position of the first byte.
    start: u64,
    bytes: Vec<u8>,
    at: u64,
}

impl Tail {
    fn read(source: &Source) -> Result<Self, Fault> {
        let start = source.size().saturating_sub(TAIL);
        let mut bytes = Vec::new();
        source.copy(start, source.size(), |piece| {
            bytes.extend_from_slice(piece);
            Ok(())
        })?;
        Ok(Self { start, bytes, at: 0 })
    }
}

impl Read for Tail {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        let at = self.at.checked_sub(self.start).ok_or_else(|| {
            io::Error::other(format!("its directory is not within the last {TAIL} bytes"))
        })?;
        let mut rest = self.bytes.get(at as usize..).unwrap_or_default();
        let n = rest.read(buf)?;
        self.at += n as u64;
        Ok(n)
    }
}

impl Seek for Tail {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let (base, by) = match to {
            SeekFrom::Start(at) => (at, 0),
            SeekFrom::End(by) => (self.start + self.bytes.len() as u64, by),
            SeekFrom::Current(by) => (self.at, by),
        };
        self.at = base.checked_add_signed(by).ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_below_the_folder_are_plain() {
        for good in ["a", "images/DSC_1.jpg", "images/a/b.png", "..a", "a..b"] {
            assert!(is_plain(good), "{good}");
        }
        for bad in ["", "/a", "a/../b", "..", "../a", "a//b", "./a", "a/", "c:\\a", "a\\..\\b"] {
            assert!(!is_plain(bad), "{bad}");
        }
    }
}
