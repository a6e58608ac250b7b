//! Records of finished stages, kept beside the report. The name of a record has the hash of everything
//! that the stage depends on: inputs, settings and the program itself. A stage with a record is not
//! run again.

use std::cell::RefCell;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

/// Records of finished stages in one folder.
pub(crate) struct Cache {
    dir: PathBuf,
    /// Hash of what every stage depends on.
    base: String,
    /// Ignore old records.
    fresh: bool,
    skipped: RefCell<Vec<String>>,
    ran: RefCell<Vec<String>>,
}

/// SHA-256 of bytes, hexadecimal.
#[must_use]
pub fn hash_bytes(bytes: &[u8]) -> String {
    hex(Sha256::digest(bytes).as_slice())
}

/// SHA-256 of a file, hexadecimal.
pub(crate) fn hash_file(path: &Path) -> Result<String> {
    let open = || format!("read {}", path.display());
    let mut file = fs::File::open(path).with_context(open)?;
    let mut hasher = Sha256::new();
    let mut buffer = vec![0; 1 << 20];
    loop {
        let n = file.read(&mut buffer).with_context(open)?;
        if n == 0 {
            return Ok(hex(hasher.finalize().as_slice()));
        }
        hasher.update(&buffer[..n]);
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

impl Cache {
    /// Records in `dir` of stages that all depend on `inputs`.
    pub(crate) fn open(dir: &Path, inputs: &impl Serialize, fresh: bool) -> Result<Self> {
        fs::create_dir_all(dir).with_context(|| format!("create {}", dir.display()))?;
        let base = hash_bytes(&serde_json::to_vec(inputs).context("hash the inputs")?);
        let (skipped, ran) = (RefCell::default(), RefCell::default());
        Ok(Self { dir: dir.to_path_buf(), base, fresh, skipped, ran })
    }

    fn path(&self, stage: &str, settings: &impl Serialize) -> Result<PathBuf> {
        let key = serde_json::to_string(&(&self.base, stage, settings)).context("hash settings")?;
        Ok(self.dir.join(format!("{stage}-{}.json", &hash_bytes(key.as_bytes())[..16])))
    }

    /// The record of `stage` at `settings`, if it is done. `usable` says whether files it
    /// refers to are still there. An unreadable record counts as none.
    pub(crate) fn find<T: DeserializeOwned>(
        &self,
        stage: &str,
        settings: &impl Serialize,
        usable: impl FnOnce(&T) -> bool,
    ) -> Result<Option<T>> {
        if self.fresh {
            return Ok(None);
        }
        let Ok(text) = fs::read(self.path(stage, settings)?) else { return Ok(None) };
        let Ok(record) = serde_json::from_slice(&text) else { return Ok(None) };
        if !usable(&record) {
            return Ok(None);
        }
        // Curves share voxelizations. A stage counts once, and not as skipped if this run did it.
        let seen = |list: &RefCell<Vec<String>>| list.borrow().iter().any(|s| s == stage);
        if !seen(&self.ran) && !seen(&self.skipped) {
            self.skipped.borrow_mut().push(stage.to_owned());
        }
        Ok(Some(record))
    }

    /// Records `stage` as done.
    pub(crate) fn store<T: Serialize>(
        &self,
        stage: &str,
        settings: &impl Serialize,
        record: &T,
    ) -> Result<()> {
        let path = self.path(stage, settings)?;
        let text = serde_json::to_vec_pretty(record).context("write a record")?;
        // Through a temporary name: a record is whole or absent.
        let part = path.with_extension("part");
        fs::write(&part, text).with_context(|| format!("write {}", part.display()))?;
        fs::rename(&part, &path).with_context(|| format!("write {}", path.display()))?;
        self.ran.borrow_mut().push(stage.to_owned());
        Ok(())
    }

    /// The record of `stage`, made by `work` unless it is done.
    pub(crate) fn run<T: Serialize + DeserializeOwned>(
        &self,
        stage: &str,
        settings: &impl Serialize,
        work: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        if let Some(record) = self.find(stage, settings, |_: &T| true)? {
            return Ok(record);
        }
        let record = work()?;
        self.store(stage, settings, &record)?;
        Ok(record)
    }

    /// Stages found done, and stages in all.
    pub(crate) fn tally(&self) -> [usize; 2] {
        let (skipped, ran) = (self.skipped.borrow().len(), self.ran.borrow().len());
        [skipped, skipped + ran]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_runs_once_per_input_and_setting() {
        let dir = tempfile::tempdir().unwrap();
        let mut runs = 0;
        let mut go = |inputs: &str, setting: u32| {
            let cache = Cache::open(dir.path(), &inputs, false).unwrap();
            cache.run("stage", &setting, || {
                runs += 1;
                Ok(format!("{inputs}{setting}"))
            })
        };
        for (inputs, setting) in [("a", 1), ("a", 1), ("a", 2), ("b", 1), ("a", 1), ("b", 1)] {
            assert_eq!(go(inputs, setting).unwrap(), format!("{inputs}{setting}"));
        }
        assert_eq!(runs, 3);
    }

    #[test]
    fn fresh_and_unusable_and_broken_records_run_again() {
        let dir = tempfile::tempdir().unwrap();
        let cache = Cache::open(dir.path(), &"x", false).unwrap();
        cache.store("stage", &0, &5u32).unwrap();
        assert_eq!(cache.find("stage", &0, |_: &u32| true).unwrap(), Some(5));
        assert_eq!(cache.find("stage", &0, |_: &u32| false).unwrap(), None);
        let fresh = Cache::open(dir.path(), &"x", true).unwrap();
        assert_eq!(fresh.find("stage", &0, |_: &u32| true).unwrap(), None);
        fs::write(cache.path("stage", &0).unwrap(), "{").unwrap();
        assert_eq!(cache.find("stage", &0, |_: &u32| true).unwrap(), None);
    }
}
