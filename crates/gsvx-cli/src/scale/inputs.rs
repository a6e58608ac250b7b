//! Several files as one scene, read some Gaussians at a time.

use crate::content::transparent;
use crate::exit::note;
use crate::input::{Reading, cannot_read, name, open, say_notes};
use crate::output::is_stdio;
use crate::progress::Meter;
use anyhow::{Context, Result, anyhow, bail};
use gs_model::Scene;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// Bytes of a step of progress: about what a part is read from.
const STEP: u64 = 1 << 20;

/// One file of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SceneFile {
    pub(crate) path: PathBuf,
    /// Length of the file.
    pub(crate) bytes: u64,
    /// Gaussians that count.
    pub(crate) gaussians: u64,
    /// Valid ones that do not: no rasterizer draws them.
    pub(crate) transparent: u64,
    /// The tiles that they are in, ascending.
    pub(crate) tiles: Vec<u32>,
}

impl SceneFile {
    /// The input at `path`, of which nothing is read yet.
    pub(crate) fn new(path: &Path) -> Result<Self> {
        if is_stdio(path) {
            bail!("standard input can be read only once; encode from files");
        }
        let bytes = length(path)?;
        Ok(Self { path: path.into(), bytes, gaussians: 0, transparent: 0, tiles: Vec::new() })
    }

    /// Reads the Gaussians that count, and counts them.
    pub(crate) fn survey(
        &mut self,
        reading: &Reading,
        bar: &Meter,
        look: impl FnMut(&Scene, usize) -> Result<()>,
        take: impl FnMut(Scene) -> Result<()>,
    ) -> Result<()> {
        (self.gaussians, self.transparent) = self.each(reading, true, bar, look, take)?;
        if self.transparent > 0 {
            note(format_args!("{}: {}", name(&self.path), transparent(self.transparent as usize)));
        }
        Ok(())
    }

    /// Reads the Gaussians again, as they were counted.
    pub(crate) fn read(
        &self,
        reading: &Reading,
        bar: &Meter,
        take: impl FnMut(Scene) -> Result<()>,
    ) -> Result<()> {
        self.check()?;
        let found = self.each(reading, false, bar, |_, _| Ok(()), take)?;
        if found == (self.gaussians, self.transparent) { Ok(()) } else { Err(changed(&self.path)) }
    }

    /// Reads the Gaussians that rasterizers draw. Returns how many there are, and how many others. `look` gets all, and
    /// the number of the first in the file. Says what was skipped if `say`.
    fn each(
        &self,
        reading: &Reading,
        say: bool,
        bar: &Meter,
        mut look: impl FnMut(&Scene, usize) -> Result<()>,
        mut take: impl FnMut(Scene) -> Result<()>,
    ) -> Result<(u64, u64)> {
        let (mut all, mut transparent) = (0, 0);
        let mut take = |scene: Scene| {
            look(&scene, all as usize)?;
            all += scene.len() as u64;
            let Some(drawn) = scene.drawn() else { return take(scene) };
            transparent += (scene.len() - drawn.len()) as u64;
            take(scene.select(&drawn))
        };
        let Some(mut parts) = reading.parts(&self.path)? else {
            // Formats that are read whole.
            take(reading.model(&self.path, say)?.scene)?;
            (0..self.bytes / STEP).for_each(|_| bar.inc());
            return Ok((all - transparent, transparent));
        };
        while let Some(scene) = parts.next_part()? {
            take(scene)?;
            bar.inc();
        }
        if say {
            say_notes(&self.path, &parts.report());
        }
        Ok((all - transparent, transparent))
    }

    /// Refuses a file of another length.
    fn check(&self) -> Result<()> {
        if length(&self.path)? == self.bytes { Ok(()) } else { Err(changed(&self.path)) }
    }

    /// What tells this file from others of the same name.
    pub(crate) fn key(&self) -> String {
        let changed = std::fs::metadata(&self.path).and_then(|m| m.modified()).ok();
        let since = changed.and_then(|t| t.duration_since(UNIX_EPOCH).ok()).unwrap_or_default();
        format!("{} {} {}\n", self.path.display(), self.bytes, since.as_nanos())
    }
}

/// Progress of reading these files.
pub(crate) fn progress<'a>(
    what: &'static str,
    files: impl Iterator<Item = &'a SceneFile>,
) -> Meter {
    Meter::new(what, files.map(|file| (file.bytes / STEP) as usize).sum())
}

/// An error for a file that is not what it was.
pub(crate) fn changed(path: &Path) -> anyhow::Error {
    anyhow!("{}: has changed since the plan was made; make the plan anew", name(path))
}

fn length(path: &Path) -> Result<u64> {
    Ok(open(path)?.metadata().with_context(|| cannot_read(path))?.len())
}
