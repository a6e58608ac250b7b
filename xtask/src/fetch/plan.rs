//! Which entries of an archive are wanted, and where each goes.

use std::collections::BTreeSet;
use std::path::{Component, Path};

use zip::read::OwnedZipFileEntry;
use zip::result::ZipError;
use zip::{CompressionMethod, ZipArchive};

use super::catalogue::{Archive, Want};
use super::error::{Error, Result, one_line};
use super::ranged::Ranged;

/// A wanted entry.
#[derive(Debug)]
pub(crate) struct Item {
    /// Path below the scene's folder, with `/`.
    pub(crate) path: String,
    /// Name in the archive.
    pub(crate) name: String,
    /// Bytes unpacked.
    pub(crate) size: u64,
    /// Bytes packed.
    pub(crate) packed: u64,
    /// CRC-32 of the bytes unpacked.
    pub(crate) crc32: u32,
    /// The entry lies within these bytes of the archive.
    pub(crate) start: u64,
    pub(crate) end: u64,
    /// The archive's own record of it.
    pub(crate) entry: OwnedZipFileEntry,
}

/// Reads the central directory and picks what `archive` is wanted for, in the order of the
/// archive's bytes. `folder` is where the scene is expected; elsewhere it is found by name.
pub(crate) fn items(reader: &mut Ranged, archive: &Archive, folder: &str) -> Result<Vec<Item>> {
    let url = reader.url().to_owned();
    let fail = |e| not_zip(&url, &e);
    let zip = match ZipArchive::new(&mut *reader) {
        Ok(zip) => zip,
        Err(e) => return Err(reader.failure().unwrap_or_else(|| not_zip(&url, &e))),
    };
    let mut names = Vec::with_capacity(zip.len());
    let mut starts = vec![zip.central_directory_start()];
    for i in 0..zip.len() {
        let entry = zip.by_index_data(i).map_err(fail)?;
        starts.push(entry.header_start());
        names.push(entry.name().map_err(fail)?.into_owned());
    }
    starts.sort_unstable();
    let folder = find_folder(&names, archive, folder).ok_or_else(|| Error::NoEntry {
        url: url.clone(),
        name: format!("{folder}{}", first(archive)),
    })?;

    let mut items = Vec::new();
    for (index, path) in picks(&names, archive, &folder, &url)? {
        let entry = OwnedZipFileEntry::from(zip.by_index_data(index).map_err(fail)?);
        let name = names[index].clone();
        let refuse = |why| Error::Refused { url: url.clone(), name: name.clone(), why };
        if !is_plain(&path) {
            return Err(refuse("its name leads out of the scene's folder"));
        }
        if !entry.is_file() || entry.is_symlink() {
            return Err(refuse("it is not a plain file"));
        }
        if entry.encrypted() {
            return Err(refuse("it is encrypted"));
        }
        if !matches!(entry.compression(), CompressionMethod::Stored | CompressionMethod::Deflated) {
            return Err(refuse("its compression is neither stored nor deflate"));
        }
        let start = entry.header_start();
        // Up to the next entry: the length of the local header is not known from here.
        let next = starts.partition_point(|&s| s <= start);
        let end = starts.get(next).copied().unwrap_or_else(|| zip.central_directory_start());
        if end.saturating_sub(start) < entry.compressed_size() {
            return Err(refuse("it is longer than its place in the archive"));
        }
        let (size, packed, crc32) = (entry.size(), entry.compressed_size(), entry.crc32());
        items.push(Item { path, name, size, packed, crc32, start, end, entry });
    }
    items.sort_by_key(|item| item.start);
    let mut paths = BTreeSet::new();
    if let Some(twice) = items.iter().find(|item| !paths.insert(item.path.to_lowercase())) {
        let name = twice.name.clone();
        return Err(Error::Refused { url, name, why: "another entry has the same name" });
    }
    Ok(items)
}

/// Index and path on disk of every wanted entry.
fn picks(
    names: &[String],
    archive: &Archive,
    folder: &str,
    url: &str,
) -> Result<Vec<(usize, String)>> {
    let mut picks = Vec::new();
    for want in archive.wants {
        match want {
            Want::File { from, to } => {
                let found = from.iter().zip(*to).find_map(|(from, to)| {
                    let name = format!("{folder}{from}");
                    Some((names.iter().position(|n| *n == name)?, (*to).to_owned()))
                });
                picks.push(found.ok_or_else(|| {
                    let name = format!("{folder}{}", from.first().unwrap_or(&""));
                    Error::NoEntry { url: url.to_owned(), name }
                })?);
            }
            Want::Photos { folder: photos } => {
                let prefix = format!("{folder}{photos}");
                let before = picks.len();
                for (index, name) in names.iter().enumerate() {
                    let rest = name.strip_prefix(&prefix).filter(|rest| is_photo(rest));
                    picks.extend(rest.map(|rest| (index, format!("{photos}{rest}"))));
                }
                if picks.len() == before {
                    return Err(Error::NoEntry { url: url.to_owned(), name: prefix + "*.jpg" });
                }
            }
        }
    }
    Ok(picks)
}

/// The entry by which a scene's folder is found.
fn first(archive: &Archive) -> &'static str {
    match archive.wants.first() {
        Some(Want::File { from, .. }) => from.first().unwrap_or(&""),
        _ => "",
    }
}

/// The scene's folder: the expected one, or else the one of that name with the shortest path.
fn find_folder(names: &[String], archive: &Archive, expected: &str) -> Option<String> {
    let Some(Want::File { from, .. }) = archive.wants.first() else { return None };
    let scene = expected.trim_end_matches('/').rsplit('/').next().unwrap_or(expected);
    let mut found = BTreeSet::new();
    for name in names {
        for anchor in *from {
            let Some(folder) = name.strip_suffix(anchor) else { continue };
            if folder == expected {
                return Some(folder.to_owned());
            }
            if folder.strip_suffix('/').is_some_and(|f| f.rsplit('/').next() == Some(scene)) {
                found.insert((folder.len(), folder.to_owned()));
            }
        }
    }
    found.pop_first().map(|(_, folder)| folder)
}

fn is_photo(name: &str) -> bool {
    let hidden = name.rsplit('/').next().is_some_and(|file| file.starts_with("._"));
    let lower = name.to_lowercase();
    !hidden && ["jpg", "jpeg", "png"].iter().any(|e| lower.ends_with(&format!(".{e}")))
}

/// True if `path` stays below the folder that it is joined to, on every system.
pub(crate) fn is_plain(path: &str) -> bool {
    let odd =
        |c: char| c.is_control() || matches!(c, '\\' | ':' | '*' | '?' | '"' | '<' | '>' | '|');
    let parts_are_names = path.split('/').all(|p| !p.is_empty() && p != "." && p != "..");
    let components = Path::new(path).components().all(|c| matches!(c, Component::Normal(_)));
    !path.contains(odd) && parts_are_names && components
}

fn not_zip(url: &str, error: &ZipError) -> Error {
    Error::Archive { url: url.to_owned(), why: one_line(error) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_below_the_folder_are_plain() {
        for good in ["a", "images/DSC_1.jpg", "images/a/b.png", "..a", "a..b"] {
            assert!(is_plain(good), "{good}");
        }
        for bad in
            ["", "/a", "a/../b", "..", "../a", "a//b", "./a", "a/", "c:\\a", "a\\..\\b", "a\0"]
        {
            assert!(!is_plain(bad), "{bad}");
        }
    }

    #[test]
    fn a_folder_is_found_where_it_is_expected_or_by_name() {
        let [(photos, folder), _] = super::super::catalogue::SCENES[0].archives();
        let names = |list: &[&str]| list.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>();
        let find = |list: &[&str]| find_folder(&names(list), photos, &folder);
        let (a, b) = ("x/y/playroom/sparse/0/cameras.bin", "z/playroom/sparse/0/cameras.bin");
        assert_eq!(find(&[a, b, "db/playroom/sparse/0/cameras.bin"]).unwrap(), "db/playroom/");
        assert_eq!(find(&[a, b]).unwrap(), "z/playroom/");
        assert_eq!(find(&["playroom/sparse/0/cameras.txt"]).unwrap(), "playroom/");
        assert_eq!(find(&["db/ballroom/sparse/0/cameras.bin"]), None);
    }
}
