//! Fits the sampled model to the training photos.

use anyhow::{Context, Result};
use finetune::{Backend, FineTune, FineTuneOptions, TrainView};
use gs_model::Scene;
use gs_model::dataset::Dataset;

use crate::measure;
use crate::progress::Bar;

/// Runs `steps` optimiser steps on the training views of `dataset`, on the Rust executor: the
/// fixture is the same on a machine with a GPU.
pub(crate) fn fit(scene: Scene, dataset: &Dataset, steps: u64, seed: u64) -> Result<Scene> {
    let views = measure::load(dataset.training())?;
    let views = views.into_iter().map(|s| TrainView { camera: s.camera, photo: s.photo });
    let options = FineTuneOptions { steps, seed, backend: Backend::Cpu, ..Default::default() };
    let tune = FineTune::new(scene, views.collect(), options).context("fit the model")?;
    let bar = Bar::new("fit to photos", steps);
    let mut done = 0;
    let outcome = tune.run(|p| {
        bar.step(p.step - done);
        done = p.step;
    });
    bar.done();
    Ok(outcome.context("fit the model")?.scene)
}
