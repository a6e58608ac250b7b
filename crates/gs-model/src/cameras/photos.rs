//! Where the photo of a camera is: camera files often name another file than the one that is there.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use crate::error::Result;
use crate::fs;

/// What the names of photo files end with.
const READABLE: [&str; 4] = ["png", "jpg", "jpeg", "webp"];
/// What the names of photos end with that are not read.
const OTHER: [&str; 17] = [
    "heic", "heif", "tif", "tiff", "bmp", "dng", "ppm", "exr", "avif", "jxl", "gif", "tga", "jp2",
    "cr2", "cr3", "nef", "arw",
];
/// Endings of the folders with the photos at full size, and at a half, a quarter and an eighth of it.
const SIZES: [&str; 4] = ["", "_2", "_4", "_8"];

/// Finds photos, and lists each folder once.
#[derive(Default)]
pub(crate) struct Finder {
    folders: BTreeMap<PathBuf, Names>,
}

/// The photos of a folder; the first in sorted order wins.
#[derive(Default)]
struct Names {
    by_stem: BTreeMap<String, PathBuf>,
    /// By the name up to its first dot: so does Inria's trainer name them.
    by_start: BTreeMap<String, PathBuf>,
}

impl Finder {
    /// The photo that a camera file in `dir` names. The file of that name, or else one of its stem with any
    /// extension, in capitals or not; in its folder, or else in that with `_2`, `_4` or `_8` at the end of its name.
    pub(crate) fn find(&mut self, dir: &Path, photo: &Path) -> Result<Option<PathBuf>> {
        for file in in_all_sizes(photo) {
            let exact = dir.join(file);
            if exact.is_file() {
                return Ok(Some(exact));
            }
            let (Some(folder), Some(name)) = (exact.parent(), exact.file_name()) else { continue };
            let stem = stem(&name.to_string_lossy());
            if let Some(found) = self.names(folder)?.find(&stem) {
                return Ok(Some(found.clone()));
            }
        }
        Ok(None)
    }

    /// The same for the photo of a name in a folder, which may have another size.
    pub(crate) fn find_in(&mut self, folder: &Path, name: &str) -> Result<Option<PathBuf>> {
        let above = folder.parent().unwrap_or(Path::new(""));
        self.find(above, &Path::new(folder.file_name().unwrap_or_default()).join(name))
    }

    /// The same for a name that may be a path on the machine where the cameras were made: then its end is looked for.
    pub(crate) fn find_named(&mut self, dir: &Path, name: &str) -> Result<Option<PathBuf>> {
        let found = self.find(dir, Path::new(name))?;
        let absolute = name.starts_with('/') || name.get(1..2) == Some(":");
        if found.is_some() || !absolute {
            return Ok(found);
        }
        let parts: Vec<&str> = name.split('/').collect();
        for kept in (1..=3.min(parts.len())).rev() {
            let end: PathBuf = parts[parts.len() - kept..].iter().collect();
            if let Some(found) = self.find(dir, &end)? {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    fn names(&mut self, folder: &Path) -> Result<&Names> {
        if !self.folders.contains_key(folder) {
            self.folders.insert(folder.to_owned(), Names::list(folder)?);
        }
        Ok(&self.folders[folder])
    }
}

impl Names {
    fn list(folder: &Path) -> Result<Self> {
        let mut out = Self::default();
        for file in photos_in(folder, &READABLE)? {
            let Some(name) = file.file_name().map(|n| n.to_string_lossy().to_lowercase()) else {
                continue;
            };
            let start = name.split('.').next().unwrap_or_default().to_owned();
            out.by_start.entry(start).or_insert_with(|| file.clone());
            out.by_stem.entry(stem(&name)).or_insert(file);
        }
        Ok(out)
    }

    fn find(&self, stem: &str) -> Option<&PathBuf> {
        self.by_stem.get(stem).or_else(|| self.by_start.get(stem))
    }
}

/// The photos in the folder of an expected photo, and in those of smaller sizes.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn photos_beside(expected: &Path) -> Result<Vec<PathBuf>> {
    beside(expected, &READABLE)
}

/// The photos in the same folders that are of a format that is not read.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn unread_photos_beside(expected: &Path) -> Result<Vec<PathBuf>> {
    beside(expected, &OTHER)
}

fn beside(expected: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>> {
    let folder = expected.parent().unwrap_or(Path::new(""));
    let mut all = Vec::new();
    for ending in SIZES {
        let mut sized = folder.as_os_str().to_owned();
        sized.push(ending);
        all.extend(photos_in(Path::new(&sized), extensions)?);
    }
    Ok(all)
}

/// The photos in a folder with these extensions, sorted; none if there is no such folder.
fn photos_in(folder: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>> {
    let mut names = fs::names(folder)?;
    names.retain(|name| {
        let extension = Path::new(name).extension().unwrap_or_default();
        extensions.iter().any(|known| extension.eq_ignore_ascii_case(known))
    });
    Ok(names.iter().map(|name| folder.join(name)).collect())
}

/// A relative path, and the same with endings to its first folder.
fn in_all_sizes(photo: &Path) -> Vec<PathBuf> {
    let mut parts = photo.components();
    let rest = match parts.next() {
        Some(Component::Normal(folder)) if parts.clone().next().is_some() => Some(folder),
        _ => None,
    };
    let Some(folder) = rest else { return vec![photo.to_owned()] };
    let sized = SIZES.iter().map(|ending| {
        let mut name = folder.to_owned();
        name.push(ending);
        Path::new(&name).join(parts.as_path())
    });
    sized.collect()
}

/// The name in small letters, without an extension of photos.
fn stem(name: &str) -> String {
    let name = name.to_lowercase();
    match name.rsplit_once('.') {
        Some((stem, end)) if READABLE.contains(&end) || OTHER.contains(&end) => stem.to_owned(),
        _ => name,
    }
}
