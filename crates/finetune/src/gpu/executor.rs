//! [`DeviceOptimiser`]: the fine-tune's steps on the device.

use gs_model::Scene;

use super::device::Context;
use super::passes::STEP;
use super::steps::{DeviceSteps, Mover};
use super::uniform::StepUniform;
use crate::error::Result;
use crate::optimiser::{Adam, SceneOptimiser};
use crate::options::{LearningRates, Loss};
use crate::stages::loss::ViewLoss;
use crate::view_gradients::PreparedView;

/// A [`SceneOptimiser`] on a graphics adapter. Each step moves every row, so none has to catch up.
pub struct DeviceOptimiser {
    steps: DeviceSteps,
    rates: LearningRates,
    mean_rate: f32,
    /// Number of the last step.
    made: u64,
}

impl DeviceOptimiser {
    pub(crate) fn new(
        context: Context,
        from: &SceneOptimiser,
        views: &[PreparedView],
        loss: Loss,
    ) -> Result<Self> {
        let steps = DeviceSteps::new(context, from.scene(), (views, loss), Mover::ByAdam)?;
        let [rows, first, second] = &from.state();
        steps.workspace.upload(&[rows, first, second]);
        Ok(Self { steps, rates: from.rates, mean_rate: from.mean_rate, made: from.made.0 })
    }

    /// Submits step number `number`, counted from 1, at a view. It does not wait for the device.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn step(&mut self, view: usize, number: u64, decay: f32) -> Result<()> {
        let rates = (&self.rates, self.mean_rate);
        let u = self.steps.uniform(view, number).with_adam(rates, number, decay);
        self.made = number;
        self.steps.step(view, u, &STEP)
    }

    /// The losses of the steps since the last call, in order. Waits for the device.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn losses(&mut self) -> Result<Vec<ViewLoss>> {
        self.steps.losses()
    }

    /// Puts parameters and moments into `out`, which the steps began with. Waits for the device.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn fetch(&mut self, out: &mut SceneOptimiser) -> Result<()> {
        self.steps.settle()?;
        let [rows, first, second] = [0, 1, 2].map(|which| self.steps.workspace.download(which));
        out.set_state([rows?, first?, second?], self.made);
        Ok(())
    }

    /// The scene as it is, with the lengths of `like`. Waits for the device.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn scene(&mut self, like: Scene) -> Result<Scene> {
        self.steps.scene(like)
    }

    /// Bytes of all buffers on the device.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.steps.bytes()
    }

    #[cfg(test)]
    pub(crate) fn capacity(&self) -> usize {
        self.steps.workspace.sizes.capacity
    }

    #[cfg(test)]
    pub(crate) fn bands(&self) -> Vec<u32> {
        self.steps.bands()
    }
}

impl StepUniform {
    /// With Adam's rates at a step.
    pub(crate) fn with_adam(
        mut self,
        (r, mean_rate): (&LearningRates, f32),
        number: u64,
        decay: f32,
    ) -> Self {
        let (inverse_bias1, inv_sqrt_bias2) = Adam::new(number).corrections();
        let rate = |r: f32| r * decay * inverse_bias1;
        self.rates = [r.sh_dc, r.sh_rest, r.opacity, r.log_scale].map(rate);
        (self.rotation_rate, self.mean_rate) = (rate(r.rotation), rate(mean_rate));
        self.inv_sqrt_bias2 = inv_sqrt_bias2;
        self
    }
}
