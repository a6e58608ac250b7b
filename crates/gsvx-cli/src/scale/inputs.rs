//! Several files as one scene, read some Gaussians at a time.

use crate::exit::note;
use crate::input::{Reading, name};
use crate::output::is_stdio;
use crate::progress::Steps;
use anyhow::{Context, Result, bail};
use gs_model::Scene;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// Bytes of a step of progress: about what a part is read from.
const STEP: u64 = 1 << 20;

/// One file of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Input {
    pub(crate) path: PathBuf,
    /// Length of the file.
    pub(crate) bytes: u64,
    /// Gaussians that count.
    pub(crate) gaussians: u64,
    /// The tiles that they are in, ascending.
    pub(crate) tiles: Vec<u32>,
}

impl Input {
    /// The input at `path`, of which nothing is read yet.
    pub(crate) fn new(path: &Path) -> Result<Self> {
        if is_stdio(path) {
            bail!("standard input can be read only once; encode from files");
        }
        let bytes = length(path)?;
        Ok(Self { path: path.into(), bytes, gaussians: 0, tiles: Vec::new() })
    }

    /// Reads the Gaussians. Says what was skipped if `say`.
    pub(crate) fn each(
        &self,
        reading: &Reading,
        say: bool,
        steps: &Steps,
        mut take: impl FnMut(Scene) -> Result<()>,
    ) -> Result<u64> {
        let mut all = 0;
        let Some(mut parts) = reading.parts(&self.path)? else {
            // Formats that are read whole.
            let scene = reading.model(&self.path)?.scene;
            all += scene.len() as u64;
            take(scene)?;
            (0..self.bytes / STEP).for_each(|_| steps.inc());
            return Ok(all);
        };
        while let Some(scene) = parts.next_part()? {
            all += scene.len() as u64;
            take(scene)?;
            steps.inc();
        }
        let skipped = parts.gaussians_in_file() as u64 - all;
        if say && skipped > 0 {
            note(format_args!("skipped: {skipped} invalid Gaussians of {}", name(&self.path)));
        }
        Ok(all)
    }

    /// An error for a file that is not what it was.
    pub(crate) fn changed(&self) -> anyhow::Error {
        anyhow::anyhow!(
            "{}: has changed since the plan was made; make the plan anew",
            name(&self.path)
        )
    }

    /// Refuses a file of another length.
    pub(crate) fn check(&self) -> Result<()> {
        if length(&self.path)? == self.bytes { Ok(()) } else { Err(self.changed()) }
    }

    /// What tells this file from others of the same name.
    pub(crate) fn key(&self) -> String {
        let changed = std::fs::metadata(&self.path).and_then(|m| m.modified()).ok();
        let since = changed.and_then(|t| t.duration_since(UNIX_EPOCH).ok()).unwrap_or_default();
        format!("{} {} {}\n", self.path.display(), self.bytes, since.as_nanos())
    }
}

/// Progress of reading these files.
pub(crate) fn steps<'a>(what: &'static str, inputs: impl Iterator<Item = &'a Input>) -> Steps {
    Steps::new(what, inputs.map(|i| i.bytes / STEP).sum())
}

fn length(path: &Path) -> Result<u64> {
    let found =
        std::fs::metadata(path).with_context(|| format!("{}: cannot be read", name(path)))?;
    if found.is_dir() {
        bail!("{}: is a folder; name the model in it", name(path));
    }
    Ok(found.len())
}
