//! [`DeviceOptimiser`]: the fine-tune's steps on the device.

use gs_model::Scene;

use super::device::Context;
use super::passes::STEP;
use super::sizes::Sizes;
use super::steps::{DeviceSteps, DeviceView};
use super::uniform::StepUniform;
use super::workspace::Workspace;
use crate::error::Result;
use crate::optimiser::{Adam, SceneOptimiser};
use crate::options::{LearningRates, Loss};
use crate::stages::project::View;
use crate::view_gradients::{PreparedView, ViewLoss};

/// A [`SceneOptimiser`] on a graphics adapter. Means stay where they are.
pub struct DeviceOptimiser {
    steps: DeviceSteps,
    base: StepUniform,
    rates: LearningRates,
}

/// The sizes of a scene and its views.
pub(super) fn sizes<'a>(scene: &Scene, views: impl Iterator<Item = &'a View>) -> Sizes {
    let one = |v: &View| (v.tiles(), v.width as usize * v.height as usize);
    let largest = views.map(one).fold((1, 1), |a, b| (a.0.max(b.0), a.1.max(b.1)));
    Sizes {
        count: scene.len(),
        sh_len: scene.sh_len(),
        // Grows on demand: a step that needs more slots is repeated.
        capacity: (4 * scene.len()).max(1 << 14),
        tiles: largest.0,
        pixels: largest.1,
    }
}

/// The views and their photos on the device.
pub(super) fn on_device(workspace: &Workspace, views: &[PreparedView]) -> Result<Vec<DeviceView>> {
    let mut planes = Vec::new();
    let one = |prepared: &PreparedView| {
        prepared.planes(&mut planes);
        DeviceView::new(workspace, &prepared.view, &planes)
    };
    views.iter().map(one).collect()
}

impl DeviceOptimiser {
    pub(crate) fn new(
        context: Context,
        from: &SceneOptimiser,
        views: &[PreparedView],
        loss: Loss,
    ) -> Result<Self> {
        let scene = from.scene();
        let workspace = Workspace::new(context, sizes(scene, views.iter().map(|v| &v.view)), None)?;
        workspace.upload(from.state());
        let base = StepUniform {
            count: scene.len() as u32,
            sh_len: scene.sh_len() as u32,
            ..StepUniform::default()
        };
        let on_device = on_device(&workspace, views)?;
        let steps = DeviceSteps::new(workspace, on_device)?;
        Ok(Self { steps, base: base.with_loss(loss), rates: *from.rates() })
    }

    /// Submits step number `number`, counted from 1, at a view. It does not wait for the device.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn step(&mut self, view: usize, number: u64, decay: f32) -> Result<()> {
        let view = view % self.steps.views.len();
        let mut u =
            self.steps.views[view].view.merge(&self.base).with_adam(&self.rates, number, decay);
        u.step = number as u32;
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
        out.set_state(self.steps.workspace.download()?);
        Ok(())
    }

    #[cfg(test)]
    pub(crate) fn capacity(&self) -> usize {
        self.steps.workspace.sizes.capacity
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
