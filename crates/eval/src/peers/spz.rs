//! Niantic's SPZ, by its own two commands.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result};
use gs_model::Scene;

use super::tool;
use crate::codec::Codec;
use crate::scenes::TestScene;

/// SPZ at its default setting.
pub struct Spz {
    encoder: PathBuf,
    decoder: PathBuf,
    limit: Duration,
}

impl Spz {
    /// The tools in the folder `given`, or on the PATH. `limit` is the longest run of either.
    ///
    /// # Errors
    /// Says what is missing.
    pub fn find(given: Option<&Path>, limit: Duration) -> Result<Self, String> {
        let [encoder, decoder] = tool::pair(given, ["ply_to_spz", "spz_to_ply"])?;
        Ok(Self { encoder, decoder, limit })
    }

    /// The program that encodes.
    #[must_use]
    pub fn program(&self) -> &Path {
        &self.encoder
    }
}

impl Codec for Spz {
    fn name(&self) -> String {
        "SPZ".into()
    }

    fn encode(&self, scene: &TestScene, _quality: f32) -> Result<Vec<u8>> {
        let model = scene.files.dataset.model_path.canonicalize().context("find the model")?;
        let run = |dir: &Path, stream: &Path| {
            tool::run(&self.encoder, &[model.as_path(), stream], dir, self.limit)
        };
        Ok(tool::written("model.spz", run)?.0)
    }

    fn decode(&self, stream: &[u8]) -> Result<Scene> {
        tool::decoded(stream, "model.spz", |dir, stream, back| {
            tool::run(&self.decoder, &[stream, back], dir, self.limit)
        })
    }
}
