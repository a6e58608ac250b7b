//! `fetch.toml`: what was fetched, with the SHA-256 of the first time.

use std::collections::BTreeMap;
use std::fs;
use std::io::Read as _;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::directory::is_plain;

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
        if !path.exists() {
            return Ok(Self::default());
        }
        let text = fs::read_to_string(&path).with_context(|| format!("read {}", path.display()))?;
        let bad = || format!("{}: not a record of fetched files; delete it", path.display());
        let record: Self =
            toml::from_str(&text).map_err(|e| anyhow!("{}: {}", bad(), e.message()))?;
        ensure!(record.files.keys().all(|name| is_plain(name)), bad());
        Ok(record)
    }

    /// Writes the record to `dir`, whole or not at all.
    pub(crate) fn store(&self, dir: &Path) -> Result<()> {
        let path = dir.join(NAME);
        let text = toml::to_string(self)?;
        let text =
            format!("# Written by `cargo xtask fetch`, which checks the files by it.\n{text}");
        let part = path.with_extension("toml.part");
        let write = || fs::write(&part, text).and_then(|()| fs::rename(&part, &path));
        write().with_context(|| format!("write {}", path.display()))
    }

    /// Checks the files against the record, and says whether all are there.
    pub(crate) fn verify(&self, dir: &Path) -> Result<bool> {
        let mut whole = true;
        for (name, fetched) in &self.files {
            let path = dir.join(name);
            if !path.exists() {
                whole = false;
                continue;
            }
            let (sha256, _) = digests(&path)?;
            if sha256 != fetched.sha256 {
                bail!(
                    "{}: changed since it was fetched: SHA-256 was {}, is {sha256}; delete it and \
                     run this again",
                    path.display(),
                    fetched.sha256
                );
            }
        }
        Ok(whole)
    }
}

/// SHA-256, in hexadecimal, and CRC-32 of a file.
pub(crate) fn digests(path: &Path) -> Result<(String, u32)> {
    let fail = || format!("read {}", path.display());
    let mut file = fs::File::open(path).with_context(fail)?;
    let (mut sha, mut crc) = (Sha256::new(), flate2::Crc::new());
    let mut chunk = vec![0; 1 << 20];
    loop {
        let n = file.read(&mut chunk).with_context(fail)?;
        if n == 0 {
            let hex = sha.finalize().iter().map(|b| format!("{b:02x}")).collect();
            return Ok((hex, crc.sum()));
        }
        sha.update(&chunk[..n]);
        crc.update(&chunk[..n]);
    }
}
