//! The paper's fine-tune: the means stay at the centres of the voxels, and bits have no price. As
//! `gsvx tune --profile paper`.

use crate::background::{Event, Line};
use crate::cameras::Cameras;
use crate::error::{Fault, Result};
use crate::tuning::{Options, Tuned};
use crate::views::Seen;
use finetune::backend::Backend;
use finetune::{FineTune, FineTuneOptions, RenderOptions, TrainView, metrics, photo_match, render};
use gs_model::Scene;
use gsvx::{EncodeOptions, Prepared};
use pyo3::prelude::*;
use std::sync::Arc;

/// A model of the photos shows them better than this, dB; photos of anything else rarely reach it.
const LEAST_MATCH: f64 = 15.0;
/// Photos that are compared with the model; more only take longer.
const MATCHED: usize = 8;

/// Options of this profile, as Python has them.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct PaperOptions {
    steps: u64,
    backend: String,
    /// Passes over the photos without improvement; 0 for never.
    patience: u32,
    past_input: bool,
    trim: bool,
    checkpoint_every: u64,
}

pub(crate) fn run(
    mut scene: Scene,
    (name, training): (&str, Vec<TrainView>),
    options: &Options,
    paper: &PaperOptions,
    line: &Line,
) -> Result<Tuned> {
    let quality = options.quality.unwrap_or(gsvx::DEFAULT_QUALITY);
    let mut choices = EncodeOptions::from_quality(quality)?;
    let mut warnings = Vec::new();
    warnings.extend(warning(&scene, &training, name));
    let list = training.iter().map(|v| v.camera.clone()).collect();
    let seen = Seen::of(&scene, &Cameras { name: name.into(), list }, line)?;
    warnings.extend(seen.warning);
    let mut importance = gsvx::importance::with_unseen(&scene, &seen.weights);
    let target = if paper.past_input { None } else { Some(quality_of(&scene, &training, line)?) };
    let split = if paper.trim { gsvx::split_outliers(&scene)? } else { None };
    let outliers = split.map(|split| {
        importance = split.inside.iter().map(|&i| importance[i]).collect();
        let outliers = scene.select(&split.outliers);
        scene = scene.select(&split.inside);
        outliers
    });
    let strategy = |found: &[f32], seen| gsvx::default_strategy(quality, found, seen);
    let Prepared { mut scene, voxels, importance } =
        gsvx::prepare(&scene, strategy, Some(&importance))?;
    // The means of Gaussians that are coded exactly stay where they are, as those of the leaves do.
    if let Some(outliers) = &outliers {
        scene.append(outliers);
    }
    let outcome = tune(scene, training, (target, options), paper, line)?;
    line.check()?;
    let mut tuned = outcome.scene;
    let outliers = tuned.split_off(voxels.len());
    choices.importance = Some(importance);
    let exact = (!outliers.is_empty()).then_some(&outliers);
    let encoded = gsvx::encode_voxels(&tuned, &voxels, exact, &choices)?;
    Ok(Tuned {
        encoded,
        outliers: outliers.len(),
        psnr: None,
        input_psnr: target,
        quality,
        steps: outcome.steps,
        seconds: outcome.seconds,
        reason: format!("{} (on the {})", outcome.reason, outcome.backend.used),
        missed: None,
        warnings,
    })
}

/// What is to be said of photos that the model does not show.
fn warning(scene: &Scene, training: &[TrainView], name: &str) -> Option<String> {
    let found = photo_match(scene, training, MATCHED, &RenderOptions::default())?;
    (found.mean_psnr < LEAST_MATCH).then(|| {
        format!(
            "{name}: the model shows these photos at {:.1} dB only (mean of {}); are they of this scene?",
            found.mean_psnr, found.views
        )
    })
}

/// Mean PSNR of the model at the training views, dB.
fn quality_of(scene: &Scene, views: &[TrainView], line: &Line) -> Result<f64> {
    let mut sum = 0.0;
    for (i, view) in views.iter().enumerate() {
        let image = render(scene, &view.camera, &RenderOptions::default());
        sum += metrics::psnr(&image, &view.photo);
        line.step("input model", i + 1, views.len())?;
    }
    Ok(sum / views.len() as f64)
}

fn tune(
    scene: Scene,
    training: Vec<TrainView>,
    (target, options): (Option<f64>, &Options),
    paper: &PaperOptions,
    line: &Line,
) -> Result<finetune::Outcome> {
    let backend: Backend = paper.backend.parse().map_err(Fault::Usage)?;
    let steps = paper.steps;
    let tuning = FineTuneOptions {
        steps,
        target_psnr: target,
        patience: (paper.patience > 0).then_some(paper.patience),
        checkpoint: options.checkpoint.clone(),
        checkpoint_every: paper.checkpoint_every,
        cancel: Some(Arc::clone(&line.cancel)),
        backend,
        report_every: (steps / 200).clamp(1, 50),
        ..Default::default()
    };
    let outcome = FineTune::new(scene, training, tuning)?.run(|p| {
        line.tell(Event {
            stage: "fine-tune".into(),
            done: p.step,
            total: p.steps,
            values: vec![("loss", p.loss), ("psnr", p.psnr), ("eta_seconds", p.eta_seconds)],
        });
    })?;
    Ok(outcome)
}
