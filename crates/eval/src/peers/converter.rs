//! Codecs whose own tools turn a PLY into their file, and their file into a PLY.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result};
use gs_model::Scene;

use super::tool;
use crate::codec::Codec;
use crate::scenes::TestScene;

/// One format of one tool, or a pair of tools.
pub(super) struct Converter {
    pub(super) name: &'static str,
    pub(super) format: &'static str,
    encoder: PathBuf,
    decoder: PathBuf,
    /// Before the two files.
    encode_words: &'static [&'static str],
    decode_words: &'static [&'static str],
    /// Name of its file: the tools go by the ending.
    file: &'static str,
    limit: Duration,
}

/// Formats that splat-transform writes: name, file, words.
type Format = (&'static str, &'static str, &'static [&'static str]);
pub(super) const COMPRESSED_PLY: Format = ("compressed PLY", "model.compressed.ply", &["-q", "-w"]);
pub(super) const SPZ: Format = ("SPZ v4", "model.spz", &["-q", "-w"]);
/// Without a GPU it takes hours.
pub(super) const SOG: Format = ("SOG, CPU", "model.sog", &["-g", "cpu", "-q", "-w"]);

impl Converter {
    /// Niantic's SPZ, by its own two commands in the folder `given`, or on the PATH; or what is missing.
    pub(super) fn spz(given: Option<&Path>, limit: Duration) -> Result<Self, String> {
        let [encoder, decoder] = tool::pair(given, ["ply_to_spz", "spz_to_ply"])?;
        let (encode_words, decode_words): (&[_], &[_]) = (&[], &[]);
        let (name, format, file) = ("SPZ", "default", "model.spz");
        Ok(Self { name, format, encoder, decoder, encode_words, decode_words, file, limit })
    }

    /// PlayCanvas' splat-transform, `given` or on the PATH, writing one format; or what is missing.
    pub(super) fn splat_transform(
        given: Option<&Path>,
        (format, file, encode_words): Format,
        limit: Duration,
    ) -> Result<Self, String> {
        let encoder = tool::find(given, "splat-transform")?;
        let (name, decoder, decode_words) = ("splat-transform", encoder.clone(), &["-q", "-w"]);
        Ok(Self { name, format, encoder, decoder, encode_words, decode_words, file, limit })
    }

    pub(super) fn program(&self) -> &Path {
        &self.encoder
    }
}

impl Codec for Converter {
    fn name(&self) -> String {
        format!("{}, {}", self.name, self.format)
    }

    fn encode(&self, scene: &TestScene, _quality: f32) -> Result<Vec<u8>> {
        let model = scene.files.dataset.model_path.canonicalize().context("find the model")?;
        let dir = tempfile::tempdir().context("make a folder for a tool")?;
        let stream = dir.path().join(self.file);
        let words: Vec<&Path> = self.encode_words.iter().map(Path::new).collect();
        let words = [&words[..], &[&model, &stream]].concat();
        tool::run(&self.encoder, &words, dir.path(), self.limit)?;
        tool::contents(&stream)
    }

    fn decode(&self, stream: &[u8]) -> Result<Scene> {
        let dir = tempfile::tempdir().context("make a folder for a tool")?;
        let (path, back) = (dir.path().join(self.file), dir.path().join("back.ply"));
        std::fs::write(&path, stream).with_context(|| format!("write {}", path.display()))?;
        let words: Vec<&Path> = self.decode_words.iter().map(Path::new).collect();
        let words = [&words[..], &[&path, &back]].concat();
        tool::run(&self.decoder, &words, dir.path(), self.limit)?;
        tool::contents(&back)?;
        super::read(&back)
    }
}
