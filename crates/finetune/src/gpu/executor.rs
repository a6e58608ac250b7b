//! The fine-tune's steps on the device.

use gs_model::Scene;

use super::device::Context;
use super::passes::{STEP, Stage};
use super::sizes::{CodecSizes, Sizes};
use super::steps::{DeviceSteps, DeviceView};
use super::uniform::StepUniform;
use super::workspace::Workspace;
use crate::error::Result;
use crate::gradients::planes_of;
use crate::options::RenderOptions;
use crate::stages::adam::{AdamStep, Moments};
use crate::stages::loss::LossValue;
use crate::stages::project::View;
use crate::train::executor::Executor;
use crate::train::options::FineTuneOptions;
use crate::train::view::TrainView;

pub(crate) struct GpuExecutor {
    steps: DeviceSteps,
    /// Host copy of what does not change: the means and the degree.
    scene: Scene,
    base: StepUniform,
}

/// The sizes of a scene and its views, without those of a codec.
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
        codec: CodecSizes::default(),
    }
}

impl GpuExecutor {
    pub(crate) fn new(
        context: Context,
        scene: Scene,
        moments: &Moments,
        views: &[TrainView],
        options: &FineTuneOptions,
    ) -> Result<Self> {
        let render = RenderOptions { background: options.background, ..Default::default() };
        let rendered: Vec<View> = views.iter().map(|v| View::new(&v.camera, &render)).collect();
        let workspace = Workspace::new(context, sizes(&scene, rendered.iter()))?;
        workspace.upload(&scene, moments);
        let mut base = StepUniform {
            count: scene.len() as u32,
            sh_len: scene.sh_len() as u32,
            seed: (options.seed ^ (options.seed >> 32)) as u32,
            ..Default::default()
        };
        base = base.with_loss(options.loss);
        if let Some(q) = options.quantization {
            base = base.with_quantization(&q);
        }
        let on_device = |(view, v): (&View, &TrainView)| {
            DeviceView::new(&workspace, view, &planes_of(&v.photo))
        };
        let views = rendered.iter().zip(views).map(on_device).collect::<Result<Vec<_>>>()?;
        Ok(Self { steps: DeviceSteps::new(workspace, views)?, scene, base })
    }

    #[cfg(test)]
    pub(crate) fn capacity(&self) -> usize {
        self.steps.workspace.sizes.capacity
    }

    /// Runs stages of the last step again, for benchmarks.
    pub(crate) fn repeat(&self, stages: &[Stage]) {
        let (workspace, view) = (&self.steps.workspace, &self.steps.views[0]);
        let mut u = view.view.merge(&self.base);
        u.capacity = workspace.sizes.capacity as u32;
        // Rates of zero: the scene stays what it is.
        u.inv_sqrt_bias2 = 1.0;
        workspace.run(stages, &u, Some(&view.group));
        std::hint::black_box(workspace.read::<u32>("state", 4).is_ok());
    }
}

impl Executor for GpuExecutor {
    fn step(&mut self, view: usize, step: u64, adam: &AdamStep) -> Result<()> {
        let mut u = self.steps.views[view].view.merge(&self.base).with_adam(adam);
        u.step = step as u32;
        self.steps.step(view, u, &STEP)
    }

    fn drain_losses(&mut self, out: &mut Vec<LossValue>) -> Result<()> {
        self.steps.settle()?;
        out.append(&mut self.steps.losses);
        Ok(())
    }

    fn take_state(&mut self) -> Result<(Scene, Moments)> {
        self.steps.settle()?;
        let mut scene = self.scene.clone();
        let mut moments = Moments::zeros(&scene);
        self.steps.workspace.download(&mut scene, &mut moments)?;
        Ok((scene, moments))
    }

    /// Nothing to do: the device still has the state.
    fn restore(&mut self, _: Scene, _: Moments) {}
}
