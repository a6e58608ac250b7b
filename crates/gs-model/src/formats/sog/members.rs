//! The files that make a SOG: members of a zip archive, or files in a folder.

use std::io::{Cursor, Read};
use std::path::Path;

use zip::ZipArchive;

use super::malformed;
use crate::error::Result;
use crate::formats::foreign;
use crate::fs;

/// Largest ratio of a member's length to the archive's. WebP images hardly compress.
const MAX_RATIO: u64 = 64;

/// The name of the file of a SOG that names the others.
pub const META: &str = "meta.json";

pub(super) enum Members<'a> {
    /// With the folder that holds the files, and the most bytes of a member.
    Archive(Box<ZipArchive<Cursor<&'a [u8]>>>, String, u64),
    Folder(&'a Path),
}

impl<'a> Members<'a> {
    pub(super) fn archive(file: &Path, bytes: &'a [u8]) -> Result<Self> {
        let broken = |_| malformed(file, "the zip archive", "broken or cut short; get it again");
        let archive = ZipArchive::new(Cursor::new(bytes)).map_err(broken)?;
        // Some tools zip the folder rather than the files in it.
        let names: Vec<_> = archive.file_names().filter_map(|name| name.ok()).collect();
        let holds_meta = |front: &&str| front.is_empty() || front.ends_with('/');
        let folders = names.iter().filter_map(|n| n.strip_suffix(META)).filter(holds_meta);
        let Some(folder) = folders.min_by_key(|front| front.len()).map(str::to_owned) else {
            return Err(foreign::zip(file, &names));
        };
        drop(names);
        Ok(Self::Archive(Box::new(archive), folder, MAX_RATIO * bytes.len() as u64))
    }

    /// The bytes of a member. `file` is what was opened, for messages.
    pub(super) fn read(&mut self, file: &Path, name: &str) -> Result<Vec<u8>> {
        let bad = |reason: &str| malformed(file, name, reason);
        // A name with folders could lead anywhere.
        if name.is_empty() || name.contains(['/', '\\', ':']) || name.starts_with("..") {
            return Err(bad("not the name of a file beside meta.json"));
        }
        match self {
            Self::Folder(folder) => fs::read(&folder.join(name)),
            Self::Archive(archive, folder, most) => {
                let mut member =
                    archive.by_name(&format!("{folder}{name}")).map_err(|e| match e {
                        zip::result::ZipError::FileNotFound => bad("it is not in the archive"),
                        _ => bad("it cannot be unpacked"),
                    })?;
                if member.size() > *most {
                    return Err(bad("it is far larger than the archive"));
                }
                let mut data = Vec::new();
                let read = member.by_ref().take(*most).read_to_end(&mut data);
                read.map_err(|_| bad("it cannot be unpacked: its data is broken"))?;
                Ok(data)
            }
        }
    }
}
