//! Steps on the arrays of a scene: the recovery between two rounds of pruning, with means that move, and the
//! paper's fine-tune, with means that stay.

use finetune::optimiser::{AdamMoments, SceneOptimiser};
use finetune::{LearningRates, ViewGradients, ViewLoss};
use gs_model::{Camera, Scene};

use crate::checkpoint::{StateReader, StateWriter};
use crate::error::Result;

/// Rate of the means where they move, over the extent of the cameras.
const MEAN_RATE: f32 = 2e-5;
/// Rates fall to this fraction in a loop.
const FINAL_RATE: f64 = 0.1;

/// The factor of all rates after `done` of `steps` steps. It is 1 for the first `held`, then it falls to `last`.
pub(crate) fn decay(last: f64, held: u64, done: u64, steps: u64) -> f32 {
    let (done, steps) = (done.saturating_sub(held), steps.saturating_sub(held + 1));
    libm::pow(last, done as f64 / steps.max(1) as f64) as f32
}

/// Rate of the means that move.
pub(crate) fn mean_rate(cameras: &[Camera]) -> f32 {
    MEAN_RATE * extent(cameras)
}

/// The greatest distance of a camera from their mean, and a tenth.
pub(crate) fn extent(cameras: &[Camera]) -> f32 {
    let centres = || cameras.iter().map(Camera::position);
    let Some(sum) = centres().reduce(|a, b| a + b) else { return 0.0 };
    let mean = sum / cameras.len() as f64;
    (1.1 * centres().map(|c| c.distance(mean)).fold(0.0, f64::max)) as f32
}

/// The steps on a scene.
pub(crate) struct SceneLoop {
    pub(crate) optimiser: SceneOptimiser,
    pub(crate) steps: u64,
    pub(crate) done: u64,
    /// Rates fall only after so many steps.
    pub(crate) held: u64,
}

impl SceneLoop {
    /// `steps` steps on `scene`. Means stay where they are if their rate is zero.
    pub(crate) fn new(scene: Scene, mean_rate: f32, steps: u64) -> Self {
        let optimiser = SceneOptimiser::new(scene, LearningRates::default(), mean_rate);
        Self { optimiser, steps, done: 0, held: 0 }
    }

    /// What the rates of the next step are multiplied by.
    pub(crate) fn decay(&self) -> f32 {
        decay(FINAL_RATE, self.held, self.done, self.steps)
    }

    /// Changes scene and moments together.
    pub(crate) fn change(&mut self, change: impl FnOnce(&mut Scene, &mut AdamMoments)) {
        let old = &mut self.optimiser;
        let mut scene = old.take_scene();
        let mut moments = std::mem::take(&mut old.moments);
        change(&mut scene, &mut moments);
        let mut new = SceneOptimiser::new(scene, LearningRates::default(), 0.0);
        new.last[..old.last.len()].copy_from_slice(&old.last);
        (new.moments, new.made) = (moments, old.made);
        *old = new;
    }

    /// Number of the next step, counted from 1, and what its rates are multiplied by. Counts it as done.
    pub(crate) fn next(&mut self) -> (u64, f32) {
        let decay = self.decay();
        self.done += 1;
        (self.done, decay)
    }

    /// One step at a view.
    pub(crate) fn step(&mut self, views: &mut ViewGradients, view: usize) -> ViewLoss {
        let (number, decay) = self.next();
        self.optimiser.step(views, view, number, decay)
    }

    /// Adds what a run needs to go on from here.
    pub(crate) fn write(&self, out: &mut StateWriter) {
        out.integers(&[self.done]);
        out.scene(self.optimiser.scene());
        out.moments(&self.optimiser.moments);
        out.steps(&self.optimiser.last);
        out.floats(&[self.optimiser.made.1]);
    }

    /// Undoes [`SceneLoop::write`].
    pub(crate) fn read(input: &mut StateReader<'_>, mean_rate: f32, steps: u64) -> Result<Self> {
        let [done] = input.integers()?[..] else { return Err(input.error("steps")) };
        let mut this = Self::new(input.scene()?, mean_rate, steps);
        let optimiser = &mut this.optimiser;
        optimiser.moments = input.moments(optimiser.moments.first.len())?;
        optimiser.last = input.steps(optimiser.scene().len())?;
        let [decay] = input.floats()?[..] else { return Err(input.error("rates")) };
        optimiser.made = (done, decay);
        this.done = done;
        Ok(this)
    }
}
