//! The stages of a run. Each looks for its record first.

use std::cell::OnceCell;
use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use finetune::TrainView;
use gs_model::dataset::View;
use gs_model::{Camera, Scene};
use gsvx::Prepared;

use super::plan::{Coding, Rule, Voxels};
use super::record::{Coded, Original, Voxelized};
use super::tune::{self, Tuning};
use crate::cache::Cache;
use crate::measure::{self, Shot};
use crate::pictures;
use crate::progress::Bar;

/// Views whose renders are kept as pictures.
pub(crate) const PICTURE_VIEWS: usize = 2;

/// What every stage needs.
pub(crate) struct Study<'a> {
    pub(crate) cache: &'a Cache,
    /// Folder of the report.
    pub(crate) out: &'a Path,
    /// The valid Gaussians of the model.
    pub(crate) scene: &'a Scene,
    /// Held-out views that are measured.
    pub(crate) shots: &'a [Shot],
    /// Training cameras (no photos) from which importances are found.
    pub(crate) cameras: &'a [Camera],
    /// Training views, whose photos are read when a fine-tune first needs them.
    training: Vec<View>,
    photos: OnceCell<Vec<TrainView>>,
    saliency: OnceCell<(Option<Vec<f32>>, f64)>,
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let value = work();
    (value, start.elapsed().as_secs_f64())
}

impl<'a> Study<'a> {
    /// Nothing is computed yet.
    pub(crate) fn new(
        cache: &'a Cache,
        out: &'a Path,
        scene: &'a Scene,
        shots: &'a [Shot],
        cameras: &'a [Camera],
        training: Vec<View>,
    ) -> Self {
        let (photos, saliency) = (OnceCell::new(), OnceCell::new());
        Self { cache, out, scene, shots, cameras, training, photos, saliency }
    }

    /// Training cameras and photos.
    pub(super) fn photos(&self) -> Result<&[TrainView]> {
        if let Some(photos) = self.photos.get() {
            return Ok(photos);
        }
        let shots = measure::load(&self.training)?;
        let views = shots.into_iter().map(|s| TrainView { camera: s.view.camera, photo: s.photo });
        Ok(self.photos.get_or_init(|| views.collect()))
    }

    /// What each Gaussian of the model contributes to the training views, and the seconds to
    /// find it. None without training cameras: the codec then has its own estimate.
    fn importance(&self) -> &(Option<Vec<f32>>, f64) {
        self.saliency.get_or_init(|| {
            let some = !self.cameras.is_empty();
            timed(|| some.then(|| finetune::saliency_per_view(self.scene, self.cameras).squared))
        })
    }

    /// Renders and scores the model as it is.
    pub(crate) fn original(&self, invalid: usize, file_bytes: u64) -> Result<Original> {
        let renders = self.render_names("original");
        let usable = |_: &Original| self.all_there(&renders);
        if let Some(record) = self.cache.find("original", &(), usable)? {
            return Ok(record);
        }
        let bar = Bar::new("render original", self.shots.len() as u64);
        let (score, images) = measure::score(self.scene, self.shots, &bar);
        let render_seconds = bar.done();
        self.save(&renders, &images)?;
        let record = Original {
            gaussians: self.scene.len(),
            invalid,
            sh_degree: self.scene.sh_degree,
            file_bytes,
            score,
            render_seconds,
        };
        self.cache.store("original", &(), &record)?;
        Ok(record)
    }

    /// File names of the renders of the model called `name`, relative to the report.
    pub(crate) fn render_names(&self, name: &str) -> Vec<String> {
        let shots = self.shots.iter().take(PICTURE_VIEWS);
        shots
            .map(|s| format!("renders/{name}-{}.png", pictures::stem(&s.view.camera.name)))
            .collect()
    }

    fn all_there(&self, files: &[String]) -> bool {
        files.iter().all(|f| self.out.join(f).is_file())
    }

    fn save(&self, names: &[String], images: &[finetune::Image]) -> Result<()> {
        let dir = self.out.join("renders");
        fs::create_dir_all(&dir).with_context(|| format!("create {}", dir.display()))?;
        names.iter().zip(images).try_for_each(|(n, i)| pictures::write(&self.out.join(n), i))
    }
}

/// The stages of one voxelization; the voxelized model is made when first needed.
pub(crate) struct Branch<'a> {
    study: &'a Study<'a>,
    plan: &'a Voxels,
    tuning: Option<Tuning>,
    made: OnceCell<Made>,
}

struct Made {
    prepared: Prepared,
    seconds: f64,
}

impl<'a> Branch<'a> {
    /// Nothing is computed yet.
    pub(crate) fn new(study: &'a Study<'a>, plan: &'a Voxels, tuning: Option<Tuning>) -> Self {
        Self { study, plan, tuning, made: OnceCell::new() }
    }

    /// Name of the model, for files and tables.
    pub(crate) fn name(&self) -> String {
        match &self.tuning {
            Some(tuning) => format!("{}-{}", self.plan.name, tuning.name()),
            None => self.plan.name.clone(),
        }
    }

    /// What identifies the model in a record's key.
    fn key(&self) -> String {
        format!("{:?}, {:?}", self.plan, self.tuning)
    }

    /// Voxelized, merged, and tuned if the branch says so.
    fn made(&self) -> Result<&Made> {
        if let Some(made) = self.made.get() {
            return Ok(made);
        }
        let (importance, _) = self.study.importance();
        let strategy = |found: &[f32], seen| match &self.plan.rule {
            Rule::Fixed(strategy) => Ok(strategy.clone()),
            &Rule::Default(quality) => gsvx::default_strategy(quality, found, seen),
        };
        let (prepared, seconds) =
            timed(|| gsvx::prepare(self.study.scene, strategy, importance.as_deref()));
        let mut prepared = prepared.with_context(|| format!("voxelize ({})", self.plan.name))?;
        if let Some(tuning) = self.tuning {
            let record = tune::tuned(self.study, &self.name(), &self.key(), &prepared, tuning)?;
            let path = self.study.out.join(&record.file);
            let (scene, _) = gs_model::ply::read(&path)?;
            ensure!(scene.means == prepared.scene.means, "{}: other means", path.display());
            prepared.scene = scene;
        }
        Ok(self.made.get_or_init(|| Made { prepared, seconds }))
    }

    /// Voxelizes, merges, perhaps fine-tunes, and scores the result.
    pub(crate) fn voxelized(&self) -> Result<Voxelized> {
        let name = self.name();
        self.study.cache.run(&format!("voxelize-{name}"), &self.key(), || {
            let Made { prepared: Prepared { scene, voxels, .. }, seconds } = self.made()?;
            let bar = Bar::new(&format!("render {name}"), self.study.shots.len() as u64);
            let (score, _) = measure::score(scene, self.study.shots, &bar);
            let tuned = self.tuning.map(|_| tune::find(self.study, &name, &self.key()));
            Ok(Voxelized {
                name: name.clone(),
                what: self.plan.what.clone(),
                j_high: voxels.j_high,
                depth_histogram: voxels.depth_histogram(),
                gaussians: scene.len(),
                score,
                voxelize_seconds: *seconds,
                importance_seconds: self.study.importance().1,
                render_seconds: bar.done(),
                tuned: tuned.transpose()?.flatten(),
            })
        })
    }

    /// Encodes, decodes the bytes and scores what comes out.
    pub(crate) fn coded(&self, curve: &str, coding: Coding) -> Result<Coded> {
        let study = self.study;
        let name = format!("{curve}-{}", coding.name());
        let stage = format!("code-{name}");
        let settings = (self.key(), format!("{coding:?}"));
        let stream = format!("streams/{name}.gsvx");
        let usable = |record: &Coded| {
            let size = fs::metadata(study.out.join(&record.stream)).map(|m| m.len());
            size.is_ok_and(|s| s == record.bytes) && study.all_there(&record.renders)
        };
        if let Some(record) = study.cache.find(&stage, &settings, usable)? {
            return Ok(record);
        }

        let Prepared { scene: merged, voxels, importance } = &self.made()?.prepared;
        let mut options = coding.options()?;
        options.importance = Some(importance.clone());
        let (encoded, encode_seconds) = timed(|| gsvx::encode(merged, voxels, &options));
        let encoded = encoded.with_context(|| format!("encode {name}"))?;
        let path = study.out.join(&stream);
        fs::create_dir_all(study.out.join("streams")).context("create streams/")?;
        fs::write(&path, &encoded.bytes).with_context(|| format!("write {}", path.display()))?;

        // From the file, not from memory: what is measured is what anyone can decode.
        let bytes = fs::read(&path).with_context(|| format!("read {}", path.display()))?;
        let (decoded, decode_seconds) =
            timed(|| gsvx::decode(&bytes, &gsvx::DecodeOptions::default()));
        let decoded = decoded.with_context(|| format!("decode {}", path.display()))?.scene;
        ensure!(decoded.means == merged.means, "{name}: decoded means are not the voxelized ones");

        let bar = Bar::new(&format!("render {name}"), study.shots.len() as u64);
        let (score, images) = measure::score(&decoded, study.shots, &bar);
        let render_seconds = bar.done();
        let renders = study.render_names(&name);
        study.save(&renders, &images)?;
        let record = Coded {
            voxels: self.name(),
            quality: coding.quality(),
            paper: coding.paper_setting(),
            bytes: bytes.len() as u64,
            sections: encoded.sections.iter().map(|(k, n)| (format!("{k:?}"), *n as u64)).collect(),
            gaussians: decoded.len(),
            score,
            encode_seconds,
            decode_seconds,
            render_seconds,
            stream,
            renders,
        };
        study.cache.store(&stage, &settings, &record)?;
        Ok(record)
    }
}
