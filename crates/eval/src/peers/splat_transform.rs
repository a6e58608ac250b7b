//! PlayCanvas' splat-transform: its own compressed PLY and SOG, and its SPZ.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result};
use gs_model::Scene;

use super::tool;
use crate::codec::Codec;
use crate::scenes::TestScene;

/// A format that splat-transform writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// PlayCanvas' compressed PLY.
    CompressedPly,
    /// SPZ, version 4.
    Spz,
    /// PlayCanvas' SOG. Without a GPU it takes hours.
    Sog,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::CompressedPly, Self::Spz, Self::Sog];

    /// Its name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::CompressedPly => "compressed PLY",
            Self::Spz => "SPZ v4",
            Self::Sog => "SOG, CPU",
        }
    }

    fn file(self) -> &'static str {
        match self {
            Self::CompressedPly => "model.compressed.ply",
            Self::Spz => "model.spz",
            Self::Sog => "model.sog",
        }
    }

    fn options(self) -> &'static [&'static str] {
        if self == Self::Sog { &["-g", "cpu", "-q", "-w"] } else { &["-q", "-w"] }
    }
}

/// splat-transform, writing one format.
pub struct SplatTransform {
    program: PathBuf,
    format: Format,
    limit: Duration,
}

impl SplatTransform {
    /// The program `given`, or the one on the PATH. `limit` is its longest run.
    ///
    /// # Errors
    /// Says what is missing.
    pub fn find(given: Option<&Path>, format: Format, limit: Duration) -> Result<Self, String> {
        Ok(Self { program: tool::find(given, "splat-transform")?, format, limit })
    }

    /// The program.
    #[must_use]
    pub fn program(&self) -> &Path {
        &self.program
    }

    fn convert(&self, options: &[&str], from: &Path, to: &Path, dir: &Path) -> Result<tool::Done> {
        let mut args: Vec<&OsStr> = options.iter().map(OsStr::new).collect();
        args.extend([from.as_os_str(), to.as_os_str()]);
        tool::run(&self.program, &args, dir, self.limit)
    }
}

impl Codec for SplatTransform {
    fn name(&self) -> String {
        format!("splat-transform, {}", self.format.name())
    }

    fn encode(&self, scene: &TestScene, _quality: f32) -> Result<Vec<u8>> {
        let model = scene.files.dataset.model_path.canonicalize().context("find the model")?;
        let run =
            |dir: &Path, stream: &Path| self.convert(self.format.options(), &model, stream, dir);
        Ok(tool::written(self.format.file(), run)?.0)
    }

    fn decode(&self, stream: &[u8]) -> Result<Scene> {
        tool::decoded(stream, self.format.file(), |dir, stream, back| {
            self.convert(&["-q", "-w"], stream, back, dir)
        })
    }
}
