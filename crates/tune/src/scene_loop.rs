//! Steps on the arrays of a scene: the recovery between two rounds of pruning, with means that move, and the
//! paper's fine-tune, with means that stay.

#[cfg(feature = "gpu")]
use finetune::DeviceOptimiser;
use finetune::optimiser::{AdamMoments, SceneOptimiser};
use finetune::{LearningRates, ViewGradients, ViewLoss};
use gs_model::{Camera, Scene};

use crate::checkpoint::{StateReader, StateWriter};
use crate::error::Result;

/// Rate of the means where they move, over the extent of the cameras.
const MEAN_RATE: f32 = 2e-5;
/// The losses of a device are heard once in this many steps.
#[cfg(feature = "gpu")]
const HEARD: u64 = 48;
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
    /// PSNR of the last step whose loss is known, dB.
    pub(crate) psnr: f64,
    /// Makes the steps on a GPU, if there is one. The scene of `optimiser` is an older one then.
    #[cfg(feature = "gpu")]
    device: Option<DeviceOptimiser>,
}

impl SceneLoop {
    /// `steps` steps on `scene`. Means stay where they are if their rate is zero.
    pub(crate) fn new(scene: Scene, mean_rate: f32, steps: u64) -> Self {
        let optimiser = SceneOptimiser::new(scene, LearningRates::default(), mean_rate);
        Self {
            optimiser,
            steps,
            done: 0,
            held: 0,
            psnr: 0.0,
            #[cfg(feature = "gpu")]
            device: None,
        }
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

    /// One step at a view. The losses that are known since the last call: on a device, of many steps or of none.
    pub(crate) fn step(&mut self, views: &mut ViewGradients, view: usize) -> Result<Vec<ViewLoss>> {
        let decay = self.decay();
        self.done += 1;
        #[cfg(feature = "gpu")]
        if let Some(device) = &mut self.device {
            device.step(view, self.done, decay)?;
            let hear = self.psnr == 0.0 || self.done.is_multiple_of(HEARD);
            return if hear { self.losses() } else { Ok(Vec::new()) };
        }
        let loss = self.optimiser.step(views, view, self.done, decay);
        self.psnr = loss.psnr();
        Ok(vec![loss])
    }

    /// Moves the following steps to a graphics adapter, unless they are there.
    #[cfg(feature = "gpu")]
    pub(crate) fn place(&mut self, on: finetune::Adapter, views: &ViewGradients) -> Result<()> {
        if self.device.is_none() {
            self.device = Some(views.scene_on_device(on, &self.optimiser)?);
        }
        Ok(())
    }

    /// Whether a device makes the steps.
    #[cfg(feature = "gpu")]
    pub(crate) fn on_device(&self) -> bool {
        self.device.is_some()
    }

    #[cfg(not(feature = "gpu"))]
    pub(crate) fn on_device(&self) -> bool {
        false
    }

    /// The losses of the steps that a device has made since they were last told.
    pub(crate) fn losses(&mut self) -> Result<Vec<ViewLoss>> {
        #[cfg(feature = "gpu")]
        if let Some(device) = &mut self.device {
            let losses = device.losses()?;
            self.psnr = losses.last().map_or(self.psnr, ViewLoss::psnr);
            return Ok(losses);
        }
        Ok(Vec::new())
    }

    /// Fetches what a device has made of scene and moments.
    pub(crate) fn fetch(&mut self) -> Result<()> {
        #[cfg(feature = "gpu")]
        if let Some(device) = &mut self.device {
            device.fetch(&mut self.optimiser)?;
        }
        Ok(())
    }

    /// Moves the following steps back to the processor.
    pub(crate) fn leave_device(&mut self) -> Result<()> {
        self.fetch()?;
        #[cfg(feature = "gpu")]
        drop(self.device.take());
        Ok(())
    }

    /// Takes the scene out, after the last step.
    pub(crate) fn take_scene(&mut self) -> Result<Scene> {
        let scene = self.optimiser.take_scene();
        #[cfg(feature = "gpu")]
        if let Some(mut device) = self.device.take() {
            return Ok(device.scene(scene)?);
        }
        Ok(scene)
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
