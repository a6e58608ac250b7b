//! A scene under study: what all measurements of it share, and the record of each.

use std::cell::OnceCell;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use finetune::TrainView;
use gs_model::{Scene, View};
use serde::Serialize;

use crate::cache::{self, Cache};
use crate::manifest;
use crate::measure;
use crate::process::{self, Usage, timed};
use crate::record::Record;
use crate::scenes::{self, TestScene};

/// A scene, the folder of its results, and what stages compute once for all.
pub(crate) struct Study {
    pub(crate) test: TestScene,
    /// Folder of finished stages and streams.
    pub(crate) out: PathBuf,
    /// Finished stages.
    pub(crate) cache: Cache,
    /// Hashes of program, model, and cameras with photos.
    hashes: [String; 3],
    /// Ignore old records.
    fresh: bool,
    /// Training photos, read when a fine-tune first needs them.
    photos: OnceCell<Vec<TrainView>>,
    /// What each Gaussian contributes to the training views, and the seconds to find it.
    importance: OnceCell<(Option<Vec<f32>>, f64)>,
}

/// A stream.
pub(crate) struct StreamRecord {
    pub(crate) bytes: Vec<u8>,
    /// Bytes by what they are for.
    pub(crate) parts: Vec<(String, u64)>,
    /// What encoding needed.
    pub(crate) usage: Usage,
}

impl StreamRecord {
    /// What an encoder in this process returns, with its seconds.
    pub(crate) fn timed(
        encode: impl FnOnce() -> Result<(Vec<u8>, Vec<(&'static str, u64)>)>,
    ) -> Result<Self> {
        let (encoded, wall) = timed(encode);
        let (bytes, parts) = encoded?;
        let parts = parts.into_iter().map(|(part, bytes)| (part.to_owned(), bytes)).collect();
        Ok(Self { bytes, parts, usage: Usage { wall, ..Usage::default() } })
    }
}

/// A name as a part of file names and links.
pub(crate) fn slug(name: &str) -> String {
    let words = name.split(|c: char| !c.is_ascii_alphanumeric() && c != '=');
    words.filter(|w| !w.is_empty() && *w != "s").collect::<Vec<_>>().join("-")
}

impl Study {
    /// A scene with all its held-out views, with results where `rd-curve` has them.
    pub(crate) fn of(scene: &str) -> Result<Self> {
        Self::open(scene, usize::MAX, None, false)
    }

    /// Reads a scene with `most` held-out views or fewer. Results go to `out`; old ones are ignored if they are to be
    /// `fresh`.
    pub(crate) fn open(scene: &str, most: usize, out: Option<&Path>, fresh: bool) -> Result<Self> {
        let test = TestScene::open(scene, most)?;
        let dataset = &test.files.dataset;
        let default = || scenes::root().join("out/rd").join(&test.files.name);
        let out = out.map_or_else(default, Path::to_owned);
        fs::create_dir_all(&out).with_context(|| format!("create {}", out.display()))?;
        let mut views: String = dataset.views.iter().map(|v| format!("{:?}", v.camera)).collect();
        let measured = scenes::spread(dataset.held_out().collect(), most);
        for view in dataset.training().filter(|v| v.has_photo()).chain(measured) {
            views += &cache::hash_file(&view.image_path)?;
        }
        let hashes = [
            cache::hash_file(&process::own_path()?)?,
            cache::hash_file(&dataset.model_path)?,
            cache::hash_bytes(views.as_bytes()),
        ];
        let cache = Cache::open(&out.join("stages"), &hashes, fresh)?;
        println!(
            "{}: {} Gaussians of SH degree {}, {} of {} held-out views",
            test.files.name,
            test.model.len(),
            test.model.sh_degree,
            test.held_out.len(),
            dataset.held_out().len()
        );
        let (photos, importance) = (OnceCell::new(), OnceCell::new());
        Ok(Self { test, out, cache, hashes, fresh, photos, importance })
    }

    /// Records of what another program makes of the scene.
    pub(crate) fn cache_of(&self, program: &Path) -> Result<Cache> {
        let [_, model, views] = &self.hashes;
        let inputs = [&cache::hash_file(program)?, model, views];
        Cache::open(&self.out.join("stages"), &inputs, self.fresh)
    }

    /// Training cameras with their photos.
    pub(crate) fn photos(&self) -> Result<&[TrainView]> {
        if let Some(photos) = self.photos.get() {
            return Ok(photos);
        }
        let dataset = &self.test.files.dataset;
        let training: Vec<View> = dataset.training().cloned().collect();
        let mut found = tune::photos(&dataset.dir, &training)?;
        found.check(&self.test.model, false)?;
        found.warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));
        Ok(self.photos.get_or_init(|| found.views))
    }

    /// What each Gaussian of the model contributes to the training views, and the seconds to find
    /// it. None without training cameras: the codec then has its own estimate.
    pub(crate) fn importance(&self) -> &(Option<Vec<f32>>, f64) {
        self.importance.get_or_init(|| {
            let TestScene { model, training, .. } = &self.test;
            let seen = || finetune::Visibility::of_all(model, training).squared;
            timed(|| (!training.is_empty()).then(seen))
        })
    }

    /// The uncompressed model, compared with the photos.
    pub(crate) fn original(&self) -> Result<Record> {
        self.cache.run("original", &(), || {
            let TestScene { model, held_out, files, .. } = &self.test;
            Ok(Record {
                setting: "-".into(),
                bytes: fs::metadata(&files.dataset.model_path).map_or(0, |m| m.len()),
                gaussians: model.len(),
                score: measure::score("original", model, held_out),
                ..Record::default()
            })
        })
    }

    /// A stream, encoded, decoded, and compared with the photos, unless `cache` has its record and the file is still
    /// there. The caller fills in what the stream is.
    pub(crate) fn point(
        &self,
        cache: &Cache,
        name: &str,
        extension: &str,
        settings: &impl Serialize,
        encode: impl FnOnce() -> Result<StreamRecord>,
        decode: impl FnOnce(&[u8]) -> Result<Scene>,
    ) -> Result<Record> {
        let stage = format!("code-{name}");
        if let Some(record) = cache.find(&stage, settings, |r| self.has_stream(r))? {
            return Ok(record);
        }
        let StreamRecord { bytes, parts, usage } =
            encode().with_context(|| format!("encode {name}"))?;
        let (decoded, decode_seconds) = timed(|| decode(&bytes));
        let decoded = decoded.with_context(|| format!("decode {name}"))?;
        let stream = self.stream(name, extension)?;
        let path = self.out.join(&stream);
        fs::write(&path, &bytes).with_context(|| format!("write {}", path.display()))?;
        let record = Record {
            bytes: bytes.len() as u64,
            parts,
            gaussians: decoded.len(),
            score: measure::score(name, &decoded, &self.test.held_out),
            encode: usage,
            decode_seconds,
            stream,
            ..Record::default()
        };
        cache.store(&stage, settings, &record)?;
        Ok(record)
    }

    /// Provenance of a report.
    pub(crate) fn manifest(&self) -> Vec<(&'static str, String)> {
        manifest::of(&self.hashes)
    }

    /// The place of a stream, relative to the report.
    pub(crate) fn stream(&self, name: &str, extension: &str) -> Result<String> {
        fs::create_dir_all(self.out.join("streams")).context("create streams/")?;
        Ok(format!("streams/{name}.{extension}"))
    }

    /// Whether the stream of a point is still there.
    pub(crate) fn has_stream(&self, point: &Record) -> bool {
        let size = fs::metadata(self.out.join(&point.stream)).map(|m| m.len());
        size.is_ok_and(|s| s == point.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_curves_become_parts_of_links() {
        assert_eq!(slug("paper's criteria"), "paper-criteria");
        assert_eq!(slug("paper, not tuned"), "paper-not-tuned");
    }
}
