//! `fetch.toml`: what was fetched, with SHA-256 as of the first time.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::error::{Error, Result, one_line};
use super::plan::is_plain;

/// File name of the record, in the scene's folder.
pub(crate) const NAME: &str = "fetch.toml";

/// One file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Fetched {
    /// Where it came from.
    pub(crate) archive: String,
    pub(crate) entry: String,
    pub(crate) bytes: u64,
    pub(crate) sha256: String,
}

/// All files of a scene.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Record {
    /// True once every wanted file was there.
    pub(crate) complete: bool,
    /// By path below the scene's folder.
    #[serde(default)]
    pub(crate) files: BTreeMap<String, Fetched>,
}

impl Record {
    /// The record in `dir`, empty if there is none.
    pub(crate) fn load(dir: &Path) -> Result<Self> {
        let path = dir.join(NAME);
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(e) => return Err(Error::io(&path, "read", e)),
        };
        let bad = |why: String| Error::Record { path: path.clone(), why };
        let record: Self = toml::from_str(&text).map_err(|e| bad(one_line(e.message())))?;
        if let Some(odd) = record.files.keys().find(|name| !is_plain(name)) {
            return Err(bad(format!("{odd:?} leads out of the folder")));
        }
        Ok(record)
    }

    /// Writes the record to `dir`, whole or not at all.
    pub(crate) fn store(&self, dir: &Path) -> Result<()> {
        let path = dir.join(NAME);
        let text = toml::to_string(self)
            .map_err(|e| Error::Record { path: path.clone(), why: one_line(e) })?;
        let text =
            format!("# Written by `cargo xtask fetch`, which checks the files by it.\n{text}");
        let part = path.with_extension("toml.part");
        fs::write(&part, text).map_err(|e| Error::io(&part, "write", e))?;
        fs::rename(&part, &path).map_err(|e| Error::io(&path, "write", e))
    }

    /// Checks the files against the record. Returns those that are missing.
    ///
    /// # Errors
    /// [`Error::Changed`] for the first that differs.
    pub(crate) fn verify(&self, dir: &Path) -> Result<Vec<String>> {
        let mut missing = Vec::new();
        for (name, fetched) in &self.files {
            let path = dir.join(name);
            let changed = |what, recorded: String, found: String| {
                Err(Error::Changed { path: path.clone(), what, recorded, found })
            };
            match fs::metadata(&path) {
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => missing.push(name.clone()),
                Err(e) => return Err(Error::io(&path, "read", e)),
                Ok(meta) if meta.len() != fetched.bytes => {
                    let (old, new) = (fetched.bytes, meta.len());
                    return changed("size", old.to_string(), new.to_string());
                }
                Ok(_) => {
                    let (sha256, _) = digests(&path)?;
                    if sha256 != fetched.sha256 {
                        return changed("SHA-256", fetched.sha256.clone(), sha256);
                    }
                }
            }
        }
        Ok(missing)
    }
}

/// SHA-256, in hexadecimal, and CRC-32 of a file.
pub(crate) fn digests(path: &Path) -> Result<(String, u32)> {
    let fail = |e| Error::io(path, "read", e);
    let mut file = fs::File::open(path).map_err(fail)?;
    let (mut sha, mut crc) = (Sha256::new(), flate2::Crc::new());
    let mut chunk = vec![0; 1 << 20];
    loop {
        let n = std::io::Read::read(&mut file, &mut chunk).map_err(fail)?;
        if n == 0 {
            return Ok((hex(sha), crc.sum()));
        }
        sha.update(&chunk[..n]);
        crc.update(&chunk[..n]);
    }
}

/// A finished SHA-256 in hexadecimal.
pub(crate) fn hex(sha: Sha256) -> String {
    sha.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

/// Where a scene's unfinished pieces are.
pub(crate) fn work_dir(dir: &Path) -> PathBuf {
    dir.join(".fetch")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one() -> Record {
        let sha256 = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad".to_owned();
        let (archive, entry) = ("http://x/a.zip".to_owned(), "s/a b.txt".to_owned());
        let fetched = Fetched { archive, entry, bytes: 3, sha256 };
        Record { complete: true, files: [("sub/a b.txt".to_owned(), fetched)].into() }
    }

    #[test]
    fn a_record_comes_back_and_checks_its_files() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(Record::load(dir.path()).unwrap(), Record::default());
        one().store(dir.path()).unwrap();
        assert_eq!(Record::load(dir.path()).unwrap(), one());
        assert_eq!(one().verify(dir.path()).unwrap(), ["sub/a b.txt"]);
        fs::create_dir(dir.path().join("sub")).unwrap();
        let file = dir.path().join("sub/a b.txt");
        fs::write(&file, "abc").unwrap();
        assert!(one().verify(dir.path()).unwrap().is_empty());
        for other in ["abd", "ab"] {
            fs::write(&file, other).unwrap();
            assert!(matches!(one().verify(dir.path()), Err(Error::Changed { .. })));
        }
    }

    #[test]
    fn a_record_that_leads_elsewhere_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let mut record = one();
        let fetched = record.files.pop_first().unwrap().1;
        record.files.insert("../x".to_owned(), fetched);
        record.store(dir.path()).unwrap();
        assert!(matches!(Record::load(dir.path()), Err(Error::Record { .. })));
    }

    #[test]
    fn the_crc_is_that_of_zip() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("x");
        fs::write(&file, "123456789").unwrap();
        assert_eq!(digests(&file).unwrap().1, 0xcbf4_3926);
    }
}
