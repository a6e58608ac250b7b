//! Steps on the arrays of a scene: the recovery between two rounds of pruning, with means that move, and the
//! paper's fine-tune, with means that stay.

use finetune::optimiser::SceneOptimiser;
use finetune::{LearningRates, ViewGradients, ViewLoss};
use gs_model::{Camera, Scene};

use crate::checkpoint::{CheckpointReader, CheckpointWriter};
use crate::error::Result;

/// Rate of the means where they move, over the extent of the cameras.
const MEAN_RATE: f32 = 2e-5;
/// Rates fall to this fraction in a loop.
const FINAL_RATE: f64 = 0.1;

/// Rate of the means that move: in proportion to half of the extent of the cameras, which is the greatest
/// distance of one from their mean, and a tenth.
pub(crate) fn mean_rate(cameras: &[Camera]) -> f32 {
    let centres: Vec<[f64; 3]> =
        cameras.iter().map(|c| (c.rotation.transpose() * -c.translation).to_array()).collect();
    let n = centres.len().max(1) as f64;
    let mean = [0, 1, 2].map(|k| centres.iter().map(|c| c[k]).sum::<f64>() / n);
    let distance =
        |c: &[f64; 3]| (0..3).map(|k| (c[k] - mean[k]) * (c[k] - mean[k])).sum::<f64>().sqrt();
    MEAN_RATE * (1.1 * centres.iter().map(distance).fold(0.0, f64::max)) as f32
}

/// The steps on a scene.
pub(crate) struct SceneLoop {
    pub(crate) optimiser: SceneOptimiser,
    pub(crate) steps: u64,
    pub(crate) done: u64,
}

impl SceneLoop {
    /// `steps` steps on `scene`. Means stay where they are if their rate is zero.
    pub(crate) fn new(scene: Scene, mean_rate: f32, steps: u64) -> Self {
        let optimiser = SceneOptimiser::new(scene, LearningRates::default(), mean_rate);
        Self { optimiser, steps, done: 0 }
    }

    pub(crate) fn scene(&self) -> &Scene {
        self.optimiser.scene()
    }

    /// Takes the scene out, after the last step.
    pub(crate) fn take_scene(&mut self) -> Scene {
        self.optimiser.take_scene()
    }

    /// Number of the next step, counted from 1, and what its rates are multiplied by. Counts it as done.
    pub(crate) fn next(&mut self) -> (u64, f32) {
        let share = self.done as f64 / self.steps.saturating_sub(1).max(1) as f64;
        self.done += 1;
        (self.done, libm::pow(FINAL_RATE, share) as f32)
    }

    /// One step at a view.
    pub(crate) fn step(&mut self, views: &mut ViewGradients, view: usize) -> ViewLoss {
        let (number, decay) = self.next();
        self.optimiser.step(views, view, number, decay)
    }

    /// Adds what a run needs to go on from here.
    pub(crate) fn write(&self, out: &mut CheckpointWriter) {
        out.integers(&[self.done]);
        out.scene(self.scene());
        out.moments(&self.optimiser.moments);
    }

    /// Undoes [`SceneLoop::write`].
    pub(crate) fn read(
        input: &mut CheckpointReader<'_>,
        mean_rate: f32,
        steps: u64,
    ) -> Result<Self> {
        let [done] = input.integers()?[..] else { return Err(input.error("steps")) };
        let scene = input.scene()?;
        scene.validate().map_err(|e| input.refused("a scene that is not valid", e))?;
        let mut this = Self::new(scene, mean_rate, steps);
        this.optimiser.moments = input.moments(&this.optimiser.moments)?;
        this.done = done;
        Ok(this)
    }
}
