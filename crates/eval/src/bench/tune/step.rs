//! What a step with the codec in the loop costs beside a plain step of fine-tune on the same Gaussians, and
//! what memory the commands take.

use std::path::Path;

use anyhow::{Context, Result};
use finetune::{Loss, TrainView};
use gs_model::Scene;
use serde::{Deserialize, Serialize};
use tune::{FineTune, FineTuneOptions, Options, Plan, Target, Tune};

use crate::rd_curve::study::Study;
use crate::{command, measure, usage};

/// Quality of the loop.
const QUALITY: f32 = 58.0;
/// Steps from the first that counts to the last. Between them the codec runs at each fourth, and the predictions are
/// fitted, the bytes counted and the views kept aside rendered five times, once in 48 steps.
const STEPS: (u64, u64) = (50, 290);
/// Each kind of step is measured so many times, in turns. The medians count: the speed of a machine varies.
const TIMES: usize = 3;

/// Processor seconds of a step.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Cost {
    /// Gaussians of both.
    pub(super) gaussians: usize,
    /// Plain, against mean squared error as the loop.
    pub(super) plain: f64,
    /// With the codec in the loop.
    pub(super) in_loop: f64,
}

/// Measures both kinds of steps in this process.
pub(super) fn cost(study: &Study) -> Result<Cost> {
    study.cache.run("tune-step", &(QUALITY, STEPS, TIMES), || {
        let views = measure::load(study.test.files.dataset.training())?;
        let (mut gaussians, mut costs) = (0, [[0.0; TIMES]; 2]);
        for time in 0..TIMES {
            let (scene, seconds) = in_loop(study.test.model.clone(), views.clone())?;
            gaussians = scene.len();
            (costs[0][time], costs[1][time]) = (plain(scene, views.clone())?, seconds);
        }
        costs.iter_mut().for_each(|c| c.sort_by(f64::total_cmp));
        let [plain, in_loop] = costs.map(|c| c[TIMES / 2]);
        Ok(Cost { gaussians, plain, in_loop })
    })
}

/// Seconds of a step of the loop, and the scene at its end.
fn in_loop(scene: Scene, views: Vec<TrainView>) -> Result<(Scene, f64)> {
    let mut options = Options::new(Target::Quality(QUALITY));
    let (rounds, round_steps, loop_steps) = (1, 0, STEPS.1);
    options.plan = Some(Plan { quality: QUALITY, fraction: 0.0, rounds, round_steps, loop_steps });
    let mut clock = Clock::default();
    let outcome = Tune::new(scene, views, options)?.run(|p| clock.at(p.step))?;
    Ok((outcome.scene, clock.seconds()))
}

/// Seconds of a step without the codec.
fn plain(scene: Scene, views: Vec<TrainView>) -> Result<f64> {
    let options = FineTuneOptions { steps: STEPS.1, loss: Loss::Mse, ..FineTuneOptions::default() };
    let mut clock = Clock::default();
    FineTune::new(scene, views, options)?.run(|p| clock.at(p.step))?;
    Ok(clock.seconds())
}

/// Processor seconds at the first and the last step that count.
#[derive(Default)]
struct Clock([f64; 2]);

impl Clock {
    fn at(&mut self, step: u64) {
        let now = usage::cpu_seconds();
        if step == STEPS.0 {
            self.0[0] = now;
        } else if step == STEPS.1 {
            self.0[1] = now;
        }
    }

    fn seconds(&self) -> f64 {
        (self.0[1] - self.0[0]) / (STEPS.1 - STEPS.0) as f64
    }
}

/// Greatest memory of the command that tunes as the paper does, MB.
pub(super) fn plain_peak_mb(study: &Study, gsvx: &Path) -> Result<f64> {
    study.cache.run("tune-plain-memory", &gsvx, || {
        let dataset = &study.test.files.dataset;
        let folder = tempfile::tempdir().context("make a temporary folder")?;
        let words = ["tune", "--profile", "paper", "--steps", "10", "--cameras"];
        let mut words: Vec<std::ffi::OsString> = words.iter().map(Into::into).collect();
        words.push(dataset.dir.clone().into());
        let out = folder.path().join("plain.gsvx");
        Ok(command::measure(gsvx, &words, &dataset.model_path, &out)?.peak_mb)
    })
}
