//! One entry: fetched, inflated, checked, put in its place.

use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use zip::ZipReadOptions;

use super::error::{Error, Result, one_line};
use super::plan::Item;
use super::ranged::Ranged;
use super::record::{hex, work_dir};

/// Where the packed bytes of `item` gather. The name tells apart every archive and entry, so
/// that pieces of two never mix.
pub(crate) fn spool_path(dir: &Path, archive_size: u64, item: &Item) -> PathBuf {
    let Item { name, size, packed, crc32, start, .. } = item;
    let key = format!("{archive_size} {name} {size} {packed} {crc32} {start}");
    let hash = hex(Sha256::new_with_prefix(key));
    work_dir(dir).join(format!("{}.part", &hash[..24]))
}

/// Fetches `item` into `dir` and returns its SHA-256. `pin` is what that must be.
///
/// # Errors
/// Those of the archive. After [`Error::Damaged`] and [`Error::Replaced`] nothing is kept.
pub(crate) fn unpack(
    reader: &mut Ranged,
    item: &Item,
    dir: &Path,
    pin: Option<&str>,
) -> Result<String> {
    let spool = spool_path(dir, reader.size(), item);
    loop {
        let resumed = reader.keep(&spool, item.start, item.end)? > 0;
        let done = attempt(reader, item, dir, pin);
        reader.release();
        let spent = matches!(&done, Ok(_) | Err(Error::Damaged { .. } | Error::Replaced { .. }));
        if spent {
            fs::remove_file(&spool).map_err(|e| Error::io(&spool, "remove", e))?;
        }
        match done {
            // A power cut may leave a damaged piece: that is not the archive's fault.
            Err(Error::Damaged { .. }) if resumed => {}
            done => return done,
        }
    }
}

fn attempt(reader: &mut Ranged, item: &Item, dir: &Path, pin: Option<&str>) -> Result<String> {
    let part = work_dir(dir).join("unpacked.part");
    let url = reader.url().to_owned();
    let damaged = |why: String| Error::Damaged { url: url.clone(), name: item.name.clone(), why };

    let mut file = File::create(&part).map_err(|e| Error::io(&part, "create", e))?;
    let mut sha = Sha256::new();
    let mut chunk = vec![0; 256 << 10];
    let mut size = 0;
    let read_error = match item.entry.as_ref().with_reader(reader, ZipReadOptions::new()) {
        Err(e) => Some(one_line(e)),
        Ok(mut entry) => loop {
            match entry.read(&mut chunk) {
                Ok(0) => break None,
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => break Some(one_line(e)),
                Ok(n) => {
                    size += n as u64;
                    if size > item.size {
                        break Some(format!("more than its {} bytes", item.size));
                    }
                    sha.update(&chunk[..n]);
                    file.write_all(&chunk[..n]).map_err(|e| Error::io(&part, "write", e))?;
                }
            }
        },
    };
    if let Some(why) = read_error {
        return Err(reader.failure().unwrap_or_else(|| damaged(why)));
    }
    if size != item.size {
        return Err(damaged(format!("{size} bytes, not {}", item.size)));
    }
    let sha256 = hex(sha);
    if let Some(pin) = pin.filter(|pin| **pin != sha256) {
        let (recorded, found) = (pin.to_owned(), sha256);
        let name = item.name.clone();
        return Err(Error::Replaced { url, name, what: "SHA-256", recorded, found });
    }
    file.sync_all().map_err(|e| Error::io(&part, "write", e))?;
    drop(file);
    let path = dir.join(&item.path);
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, "create", e))?;
    }
    fs::rename(&part, &path).map_err(|e| Error::io(&path, "write", e))?;
    Ok(sha256)
}
