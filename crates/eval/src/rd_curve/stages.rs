//! The stages of one voxelization: voxelize, perhaps fine-tune, encode, decode, score. Each looks
//! for its record first.

use std::cell::OnceCell;

use anyhow::{Context, Result, ensure};
use gs_model::Scene;
use gsvx::{CodeOptions, PrepareOptions, Steps, VoxelScene};
use voxel::{Importance, Merge, Strategy};

use super::fine_tune::fine_tuned;
use super::options::Tuning;
use super::plan::{CameraUse, Coding, CurvePlan, Rule, Voxels};
use crate::measure;
use crate::process::timed;
use crate::record::{Curve, Record, VoxelizedRecord};
use crate::study::{StreamRecord, Study, slug};

/// The stages of one voxelization. The voxelized model is made when a stage first needs it.
pub(crate) struct Branch<'a> {
    study: &'a Study,
    plan: &'a Voxels,
    tuning: Option<Tuning>,
    model: OnceCell<Model>,
}

/// A voxelized and merged model.
struct Model {
    prepared: VoxelScene,
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
            prepared.scene = fine_tuned(self.study, &self.name(), &self.key(), &prepared, tuning)?;
        }
        Ok(self.model.get_or_init(|| Model { prepared, seconds }))
    }

    fn prepared(&self, scene: &Scene, importance: Option<Vec<f32>>) -> Result<VoxelScene> {
        match &self.plan.rule {
            Rule::Given(strategy, merge) => voxelized(scene, strategy, *merge, importance),
            &Rule::Default(quality, cameras) => {
                let importance = importance.as_deref().filter(|_| cameras != CameraUse::NoCameras);
                // The views measured are of the same capture as the cameras.
                let drop_unseen = cameras == CameraUse::DropUnseen;
                let options = PrepareOptions { drop_unseen, ..PrepareOptions::default() };
                Ok(gsvx::prepare(scene, importance, quality, &options)?)
            }
        }
    }

    /// Voxelizes, merges, perhaps fine-tunes, and scores the result.
    pub(crate) fn voxelized(&self) -> Result<VoxelizedRecord> {
        let name = self.name();
        self.study.cache.run(&format!("voxelize-{name}"), &self.key(), || {
            let Model { prepared: VoxelScene { scene, voxels, .. }, seconds } = self.model()?;
            Ok(VoxelizedRecord {
                name: name.clone(),
                what: self.plan.what.clone(),
                depth_histogram: voxels.octree().depth_histogram(),
                gaussians: scene.len(),
                score: measure::score(
                    &format!("{name}, voxelized"),
                    scene,
                    &self.study.test.held_out,
                ),
                voxelize_seconds: *seconds,
                importance_seconds: self.study.importance().1,
            })
        })
    }

    /// Encodes, decodes the bytes and scores what comes out.
    fn coded(&self, curve: &str, coding: Coding) -> Result<Record> {
        let name = format!("{}-{}", slug(curve), coding.name());
        let settings = (self.key(), format!("{coding:?}"));
        let encode = || {
            let VoxelScene { scene, voxels, importance, .. } = &self.model()?.prepared;
            StreamRecord::timed(|| match coding.paper(scene.len()) {
                None => {
                    let (steps, options) =
                        (Steps::of_quality(coding.quality)?, CodeOptions::default());
                    let (octree, given) = (voxels.octree(), Some(&importance[..]));
                    let encoded =
                        gsvx::encode_voxels(scene, octree, None, given, &steps, &options)?;
                    let parts = encoded.parts();
                    Ok((encoded.bytes, parts))
                }
                Some(options) => {
                    let importance = Some(&importance[..]);
                    let encoded = paper::encode(scene, voxels.octree(), importance, &options)?;
                    Ok((encoded.bytes, encoded.parts))
                }
            })
        };
        let decode = |bytes: &[u8]| {
            let decoded = match coding.paper {
                None => gsvx::decode(bytes)?,
                Some(_) => paper::decode(bytes)?,
            };
            let same = decoded.means == self.model()?.prepared.scene.means;
            ensure!(same, "decoded means are not the voxelized ones");
            Ok(decoded)
        };
        let extension = if coding.paper.is_some() { "paper" } else { "gsvx" };
        let study = self.study;
        let record = study.point(&study.cache, &name, extension, &settings, encode, decode)?;
        let (setting, voxels) = (coding.setting(), self.name());
        Ok(Record { setting, quality: coding.quality, voxels, ..record })
    }
}

/// The curve of a plan.
pub(crate) fn curve(study: &Study, plan: CurvePlan) -> Result<Curve> {
    let mut curve = Curve { name: plan.name.into(), what: plan.what, ..Curve::default() };
    // Several models may be coded at one quality.
    let several = plan.steps.iter().flat_map(|s| &s.1).any(|coding| coding.paper.is_some());
    for (voxels, codings) in &plan.steps {
        let branch = Branch::new(study, voxels, plan.tuning);
        curve.voxelized.push(branch.voxelized()?);
        let name = if several { branch.name() } else { plan.name.to_owned() };
        for &coding in codings {
            curve.points.push(branch.coded(&name, coding)?);
        }
    }
    Ok(curve)
}

/// Voxelizes and merges by any strategy, where [`gsvx::prepare`] knows only its own. Importances are guessed if there
/// are none; the paper's merging does not use them, its codebook does.
fn voxelized(
    scene: &Scene,
    strategy: &Strategy,
    merge: Merge,
    importance: Option<Vec<f32>>,
) -> Result<VoxelScene> {
    let importance = importance.unwrap_or_else(|| gsvx::importance::without_cameras(scene));
    let voxels = voxel::voxelize(scene, &voxel::cube_of(&scene.means)?, strategy)?;
    let of_leaves = voxels.sums(&importance);
    let weights = Importance::Given(importance);
    let merged = voxel::Merging::new(scene, &voxels, merge, &weights)?.scene();
    Ok(VoxelScene { scene: merged, voxels, importance: of_leaves, outliers: None })
}
