//! The stages of a run. Each looks for its record first.

use std::cell::OnceCell;
use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use gs_model::Scene;
use voxel::{Cube, Voxelization};

use super::plan::Config;
use super::record::{Coded, Original, Voxelized};
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
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let value = work();
    (value, start.elapsed().as_secs_f64())
}

impl Study<'_> {
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
    pub(crate) context: &'a Study<'a>,
    pub(crate) config: &'a Config,
    merged: OnceCell<(Scene, Voxelization, f64)>,
}

impl<'a> Branch<'a> {
    /// Nothing is computed yet.
    pub(crate) fn new(context: &'a Study<'a>, config: &'a Config) -> Self {
        Self { context, config, merged: OnceCell::new() }
    }

    fn merged(&self) -> Result<&(Scene, Voxelization, f64)> {
        if let Some(done) = self.merged.get() {
            return Ok(done);
        }
        let scene = self.context.scene;
        let (made, seconds) = timed(|| -> Result<_> {
            let cube = Cube::of(&scene.means)?;
            let voxels = voxel::voxelize(scene, &cube, &self.config.strategy)?;
            Ok((voxel::merge(scene, &voxels, self.config.merge)?, voxels))
        });
        let (merged, voxels) = made.with_context(|| format!("voxelize ({})", self.config.what))?;
        Ok(self.merged.get_or_init(|| (merged, voxels, seconds)))
    }

    /// Voxelizes, merges and scores the result.
    pub(crate) fn voxelized(&self) -> Result<Voxelized> {
        let stage = format!("voxelize-{}", self.config.name);
        self.context.cache.run(&stage, &self.config.key(), || {
            let (merged, voxels, voxelize_seconds) = self.merged()?;
            let bar = Bar::new(&format!("render {}", self.config.name), self.shots().len() as u64);
            let (score, _) = measure::score(merged, self.shots(), &bar);
            Ok(Voxelized {
                j_high: voxels.j_high,
                depth_histogram: voxels.depth_histogram(),
                gaussians: merged.len(),
                score,
                voxelize_seconds: *voxelize_seconds,
                render_seconds: bar.done(),
            })
        })
    }

    fn shots(&self) -> &'a [Shot] {
        self.context.shots
    }

    /// Encodes at `quality`, decodes the bytes and scores what comes out.
    pub(crate) fn coded(&self, quality: f32) -> Result<Coded> {
        let config = self.config;
        let name = format!("{}-q{quality:.0}", config.name);
        let settings = (config.key(), quality);
        let stream = format!("streams/{name}.gsvx");
        let renders = self.context.render_names(&name);
        let out = self.context.out;
        let usable = |record: &Coded| {
            let size = fs::metadata(out.join(&record.stream)).map(|m| m.len());
            size.is_ok_and(|s| s == record.bytes) && self.context.all_there(&record.renders)
        };
        if let Some(record) = self.context.cache.find(&format!("code-{name}"), &settings, usable)? {
            return Ok(record);
        }

        let (merged, voxels, _) = self.merged()?;
        let options = gsvx::EncodeOptions::from_quality(quality)?;
        let (encoded, encode_seconds) = timed(|| gsvx::encode(merged, voxels, &options));
        let encoded = encoded.with_context(|| format!("encode {name}"))?;
        let path = out.join(&stream);
        fs::create_dir_all(out.join("streams")).context("create streams/")?;
        fs::write(&path, &encoded.bytes).with_context(|| format!("write {}", path.display()))?;

        // From the file, not from memory: what is measured is what anyone can decode.
        let bytes = fs::read(&path).with_context(|| format!("read {}", path.display()))?;
        let (decoded, decode_seconds) =
            timed(|| gsvx::decode(&bytes, &gsvx::DecodeOptions::default()));
        let decoded = decoded.with_context(|| format!("decode {}", path.display()))?.scene;
        ensure!(decoded.means == merged.means, "{name}: decoded means are not the voxelized ones");

        let bar = Bar::new(&format!("render {name}"), self.shots().len() as u64);
        let (score, images) = measure::score(&decoded, self.shots(), &bar);
        let render_seconds = bar.done();
        self.context.save(&renders, &images)?;
        let record = Coded {
            quality,
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
        self.context.cache.store(&format!("code-{name}"), &settings, &record)?;
        Ok(record)
    }
}
