//! A scene under study: what all stages of a run share.

use std::cell::OnceCell;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use finetune::TrainView;
use gs_model::{Dataset, View};
use serde::Serialize;

use super::options::CurveOptions;
use super::plan;
use super::record::{Coded, Original};
use crate::cache::{self, Cache};
use crate::manifest;
use crate::measure;
use crate::peers;
use crate::progress::Bar;
use crate::published::{self, Other};
use crate::round_trip::timed;
use crate::scenes::{self, TestScene};

/// What every stage depends on.
#[derive(Serialize)]
struct Inputs<'a> {
    program: &'a str,
    model: &'a str,
    views: &'a str,
}

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
    saliency: OnceCell<(Option<Vec<f32>>, f64)>,
}

impl Study {
    /// Reads the scene of `options`.
    pub(crate) fn open(options: &CurveOptions) -> Result<Self> {
        ensure!(options.views() > 0, "--views must be at least 1");
        let test = TestScene::open(&options.scene, options.views())?;
        let files = &test.files;
        let out = match &options.out {
            Some(out) => out.clone(),
            None => scenes::root().join("out/rd").join(&files.name),
        };
        fs::create_dir_all(&out).with_context(|| format!("create {}", out.display()))?;
        let program = cache::program_hash()?;
        let model = cache::hash_file(&files.dataset.model_path)?;
        let measured = scenes::spread(files.dataset.held_out().collect(), options.views());
        let views = hash_views(&files.dataset, &measured)?;
        let inputs = Inputs { program: &program, model: &model, views: &views };
        let cache = Cache::open(&out.join("stages"), &inputs, options.fresh)?;
        println!(
            "{}: {} Gaussians of SH degree {}, {} of {} held-out views",
            files.name,
            test.model.len(),
            test.model.sh_degree,
            test.held_out.len(),
            files.dataset.held_out().len()
        );
        let hashes = [program, model, views];
        let (photos, saliency) = (OnceCell::new(), OnceCell::new());
        let fresh = options.fresh;
        Ok(Self { test, out, cache, hashes, fresh, photos, saliency })
    }

    /// Records of what another program makes of model, cameras and photos.
    pub(super) fn cache_of(&self, program: &Path) -> Result<Cache> {
        let mut views = self.hashes[2].clone();
        for view in self.test.files.dataset.training().filter(|v| v.has_photo()) {
            views.push_str(&cache::hash_file(&view.image_path)?);
        }
        let program = cache::hash_file(program)?;
        let inputs = Inputs { program: &program, model: &self.hashes[1], views: &views };
        Cache::open(&self.out.join("stages"), &inputs, self.fresh)
    }

    /// Training cameras with their photos.
    pub(super) fn photos(&self) -> Result<&[TrainView]> {
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
    pub(super) fn importance(&self) -> &(Option<Vec<f32>>, f64) {
        self.saliency.get_or_init(|| {
            let TestScene { model, training, .. } = &self.test;
            let seen = || finetune::saliency(model, training).squared;
            timed(|| (!training.is_empty()).then(seen))
        })
    }

    /// Renders the uncompressed model and compares it with the photos.
    pub(crate) fn original(&self) -> Result<Original> {
        self.cache.run("original", &(), || {
            let TestScene { model, held_out, invalid, files, .. } = &self.test;
            let bar = Bar::new("render original", held_out.len() as u64);
            let (score, _) = measure::score(model, held_out, &bar);
            Ok(Original {
                gaussians: model.len(),
                invalid: *invalid,
                sh_degree: model.sh_degree,
                file_bytes: fs::metadata(&files.dataset.model_path).map_or(0, |m| m.len()),
                score,
                render_seconds: bar.done(),
            })
        })
    }

    /// Depth of the uniform octree: the given one, or the one that rendering asks for.
    pub(crate) fn depth(&self, given: Option<u8>) -> Result<u8> {
        let choose = || plan::choose_depth(&self.test.model, &self.test.training);
        given.map_or_else(|| self.cache.run("depth", &(), choose), Ok)
    }

    /// What is known of other codecs on the scene, and their formats as written here.
    pub(crate) fn others(&self) -> Result<Vec<Other>> {
        let files = &self.test.files;
        let mut all = published::others(&files.dataset.dir, &files.name)?;
        all.extend(peers::curves(&self.cache, &self.test, &all)?);
        Ok(all)
    }

    /// Provenance of a report.
    pub(crate) fn manifest(&self) -> Vec<(&'static str, String)> {
        manifest::of(&self.hashes)
    }

    /// Stages found done, and stages in all.
    pub(crate) fn tally(&self) -> (usize, usize) {
        let (skipped, ran) = self.cache.tally();
        (skipped.len(), skipped.len() + ran.len())
    }

    /// Writes the stream of a point; its name, relative to the report.
    pub(super) fn keep(&self, name: &str, extension: &str, bytes: &[u8]) -> Result<String> {
        let stream = format!("streams/{name}.{extension}");
        let path = self.out.join(&stream);
        fs::create_dir_all(self.out.join("streams")).context("create streams/")?;
        fs::write(&path, bytes).with_context(|| format!("write {}", path.display()))?;
        Ok(stream)
    }

    /// Whether the stream of a point is still there.
    pub(super) fn has_stream(&self, point: &Coded) -> bool {
        let size = fs::metadata(self.out.join(&point.stream)).map(|m| m.len());
        size.is_ok_and(|s| s == point.bytes)
    }
}

/// Hash of all cameras, and of the photos of the measured views.
fn hash_views(dataset: &Dataset, measured: &[&View]) -> Result<String> {
    let mut all: String = dataset.views.iter().map(|v| format!("{:?}", v.camera)).collect();
    for view in measured {
        all.push_str(&view.camera.name);
        all.push_str(&cache::hash_file(&view.image_path)?);
    }
    Ok(cache::hash_bytes(all.as_bytes()))
}
