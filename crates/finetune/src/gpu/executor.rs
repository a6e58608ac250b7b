//! [`DeviceOptimiser`]: the fine-tune's steps on the device.

use super::device::Context;
use super::passes::STEP;
use super::steps::DeviceSteps;
use super::uniform::StepUniform;
use crate::error::Result;
use crate::optimiser::{Adam, SceneOptimiser};
use crate::options::{LearningRates, Loss};
use crate::stages::loss::ViewLoss;
use crate::view_gradients::PreparedView;

/// A [`SceneOptimiser`] on a graphics adapter. Means stay where they are.
pub struct DeviceOptimiser {
    steps: DeviceSteps,
    rates: LearningRates,
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
        let steps = DeviceSteps::new(context, from.scene(), views, loss, None)?;
        let [rows, first, second] = &from.state();
        steps.workspace.upload([rows, first, second]);
        Ok(Self { steps, rates: *from.rates(), made: from.made.0 })
    }

    /// Submits step number `number`, counted from 1, at a view. It does not wait for the device.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn step(&mut self, view: usize, number: u64, decay: f32) -> Result<()> {
        let u = self.steps.uniform(view, number).with_adam(&self.rates, number, decay);
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
        out.set_state(self.steps.workspace.download()?, self.made);
        Ok(())
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
    pub(crate) fn with_adam(mut self, r: &LearningRates, number: u64, decay: f32) -> Self {
        let (inverse_bias1, inv_sqrt_bias2) = Adam::new(number).corrections();
        let rate = |r: f32| r * decay * inverse_bias1;
        self.rates = [r.sh_dc, r.sh_rest, r.opacity, r.log_scale].map(rate);
        (self.rotation_rate, self.inv_sqrt_bias2) = (rate(r.rotation), inv_sqrt_bias2);
        self
    }
}
