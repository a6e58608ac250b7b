//! The stages of one voxelization: voxelize, perhaps fine-tune, encode, decode, score. Each looks
//! for its record first.

use std::cell::OnceCell;

use anyhow::{Context, Result, ensure};
use gs_model::Scene;
use gsvx::{EncodeOptions, Prepared};
use voxel::{Importance, Merge, Strategy};

use super::options::Tuning;
use super::plan::{Coding, Rule, Sight, Voxels, slug};
use super::record::{Coded, VoxelizedRecord};
use super::study::Study;
use super::tune;
use crate::measure;
use crate::progress::Bar;
use crate::round_trip::{round_trip, timed};

/// The stages of one voxelization. The voxelized model is made when a stage first needs it.
pub(crate) struct Branch<'a> {
    study: &'a Study,
    plan: &'a Voxels,
    tuning: Option<Tuning>,
    model: OnceCell<Model>,
}

/// A voxelized and merged model.
struct Model {
    prepared: Prepared,
    /// Seconds to voxelize and merge.
    seconds: f64,
}

impl<'a> Branch<'a> {
    /// Nothing is computed yet.
    pub(crate) fn new(study: &'a Study, plan: &'a Voxels, tuning: Option<Tuning>) -> Self {
        Self { study, plan, tuning, model: OnceCell::new() }
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

    /// The model: voxelized, merged, and fine-tuned if the branch asks for it.
    fn model(&self) -> Result<&Model> {
        if let Some(model) = self.model.get() {
            return Ok(model);
        }
        let (importance, _) = self.study.importance();
        let (scene, importance) = (&self.study.test.model, importance.clone());
        let (prepared, seconds) = timed(|| self.prepared(scene, importance));
        let mut prepared = prepared.with_context(|| format!("voxelize ({})", self.plan.name))?;
        if let Some(tuning) = self.tuning {
            let record = tune::tuned(self.study, &self.name(), &self.key(), &prepared, tuning)?;
            let path = self.study.out.join(&record.file);
            let (scene, _) = gs_model::ply::read(&path)?;
            ensure!(scene.means == prepared.scene.means, "{}: other means", path.display());
            prepared.scene = scene;
        }
        Ok(self.model.get_or_init(|| Model { prepared, seconds }))
    }

    fn prepared(&self, scene: &Scene, importance: Option<Vec<f32>>) -> Result<Prepared> {
        match &self.plan.rule {
            Rule::Fixed(strategy) => voxelized(scene, strategy, Merge::Moments, importance),
            Rule::Paper(strategy) => voxelized(scene, strategy, Merge::Paper, importance),
            &Rule::Default(quality, sight) => {
                let mut options = EncodeOptions::from_quality(quality)?;
                options.importance = importance.filter(|_| sight != Sight::NoCameras);
                // The views measured are of the same capture as the cameras.
                options.drop_unseen = sight == Sight::DropUnseen;
                Ok(gsvx::prepare(scene, &options)?)
            }
        }
    }

    /// Voxelizes, merges, perhaps fine-tunes, and scores the result.
    pub(crate) fn voxelized(&self) -> Result<VoxelizedRecord> {
        let name = self.name();
        self.study.cache.run(&format!("voxelize-{name}"), &self.key(), || {
            let Model { prepared: Prepared { scene, voxels, .. }, seconds } = self.model()?;
            let bar = Bar::new(
                &format!("render {name}, voxelized"),
                self.study.test.held_out.len() as u64,
            );
            let (score, _) = measure::score(scene, &self.study.test.held_out, &bar);
            let tuned = self.tuning.map(|_| tune::find(self.study, &name, &self.key()));
            Ok(VoxelizedRecord {
                name: name.clone(),
                what: self.plan.what.clone(),
                j_high: voxels.octree().depth(),
                depth_histogram: voxels.octree().depth_histogram(),
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
        let name = format!("{}-{}", slug(curve), coding.name());
        let stage = format!("code-{name}");
        let settings = (self.key(), format!("{coding:?}"));
        let extension = if coding.paper_setting().is_some() { "paper" } else { "gsvx" };
        if let Some(record) = study.cache.find(&stage, &settings, |r| study.has_stream(r))? {
            return Ok(record);
        }

        let Prepared { scene: merged, voxels, importance, .. } = &self.model()?.prepared;
        let mut parts = Vec::new();
        let encode = || match coding.paper(merged.len()) {
            None => {
                let mut options = EncodeOptions::from_quality(coding.quality())?;
                options.importance = Some(importance.clone());
                let encoded = gsvx::encode_voxels(merged, voxels.octree(), None, &options)?;
                parts = encoded.parts();
                Ok(encoded.bytes)
            }
            Some(options) => {
                let encoded = paper::encode(merged, voxels.octree(), Some(importance), &options)?;
                parts = encoded.parts;
                Ok(encoded.bytes)
            }
        };
        let decode = |bytes: &[u8]| match coding {
            Coding::Quality(_) => Ok(gsvx::decode(bytes)?),
            Coding::Paper { .. } => Ok(paper::decode(bytes)?),
        };
        let trip = round_trip(&name, &study.test.held_out, encode, decode)?;
        let means = &trip.decoded.means;
        ensure!(*means == merged.means, "{name}: decoded means are not the voxelized ones");

        let stream = study.keep(&name, extension, &trip.stream)?;
        let record = Coded {
            voxels: self.name(),
            quality: coding.quality(),
            paper: coding.paper_setting(),
            ..Coded::of(trip, stream, parts)
        };
        study.cache.store(&stage, &settings, &record)?;
        Ok(record)
    }
}

/// Voxelizes and merges by any strategy, where [`gsvx::prepare`] knows only its own. Importances are guessed if there
/// are none; the paper's merging does not use them, its codebook does.
fn voxelized(
    scene: &Scene,
    strategy: &Strategy,
    merge: Merge,
    importance: Option<Vec<f32>>,
) -> Result<Prepared> {
    let importance = importance.unwrap_or_else(|| gsvx::importance::without_cameras(scene));
    let voxels = voxel::voxelize(scene, &voxel::cube_of(&scene.means)?, strategy)?;
    let of_leaves = voxels.sums(&importance);
    let weights = Importance::Given(importance);
    let merged = voxel::Merging::new(scene, &voxels, merge, &weights)?.scene();
    Ok(Prepared { scene: merged, voxels, importance: of_leaves, outliers: None })
}
