//! The fine-tune's steps on the device.

use gs_model::Scene;

use super::device::Context;
use super::loops;
use super::passes::{STEP, Stage};
use super::sizes::{LOSS_RING, Sizes};
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
    workspace: Workspace,
    /// Host copy of what does not change: the means and the degree.
    scene: Scene,
    views: Vec<DeviceView>,
    base: StepUniform,
    /// Steps whose losses have not been fetched.
    pending: Vec<StepUniform>,
    pending_views: Vec<usize>,
    losses: Vec<LossValue>,
}

/// A training view and its photo on the device.
struct DeviceView {
    view: StepUniform,
    photo: wgpu::Buffer,
    group: wgpu::BindGroup,
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
        let sizes = |v: &TrainView| {
            let view = View::new(&v.camera, &render);
            (view.tiles(), view.width as usize * view.height as usize)
        };
        let largest = views.iter().map(sizes).fold((1, 1), |a, b| (a.0.max(b.0), a.1.max(b.1)));
        let sizes = Sizes {
            count: scene.len(),
            sh_len: scene.sh_len(),
            // Grows on demand: a step that needs more slots is repeated.
            capacity: (4 * scene.len()).max(1 << 14),
            tiles: largest.0,
            pixels: largest.1,
        };
        let workspace = Workspace::new(context, sizes)?;
        workspace.upload(&scene, moments);
        workspace.write("state", &[scene.len() as u32, 0, 0, 0]);
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
        let views = views
            .iter()
            .map(|v| {
                let photo = workspace.storage("photo", v.photo.rgb.len())?;
                let planes = planes_of(&v.photo);
                workspace.context.queue.write_buffer(&photo, 0, bytemuck::cast_slice(&planes));
                let group = workspace.bind_group("loss", &[], &[("photo", &photo)]);
                let view = StepUniform::of_view(&View::new(&v.camera, &render));
                if let Some(limit) = workspace.context.loop_limit {
                    loops::check_view(limit, &view)?;
                }
                Ok(DeviceView { view, photo, group })
            })
            .collect::<Result<Vec<_>>>()?;
        workspace.context.check()?;
        let (pending, pending_views, losses) = (Vec::new(), Vec::new(), Vec::new());
        Ok(Self { workspace, scene, views, base, pending, pending_views, losses })
    }

    #[cfg(test)]
    pub(crate) fn capacity(&self) -> usize {
        self.workspace.sizes.capacity
    }

    /// Runs stages of the last step again, for benchmarks.
    pub(crate) fn repeat(&self, stages: &[super::passes::Stage]) {
        let mut u = self.views[0].view.merge(&self.base);
        u.capacity = self.workspace.sizes.capacity as u32;
        // Rates of zero: the scene stays what it is.
        u.inv_sqrt_bias2 = 1.0;
        self.workspace.run(stages, &u, Some(&self.views[0].group));
        std::hint::black_box(self.workspace.read::<u32>("state", 4).is_ok());
    }

    fn submit(&mut self, view: usize, mut u: StepUniform) -> Result<()> {
        u.capacity = self.workspace.sizes.capacity as u32;
        u.loss_slot = self.pending.len() as u32;
        let group = Some(&self.views[view].group);
        match self.workspace.context.loop_limit {
            None => self.workspace.run(&STEP, &u, group),
            // Slower, but only a software adapter has a limit.
            Some(limit) => {
                let lists = STEP.iter().take_while(|s| **s != Stage::Blend).count();
                self.workspace.run(&STEP[..lists], &u, group);
                let tiles = (u.tiles_x * u.tiles_y) as usize;
                loops::check_lists(limit, &self.workspace.read::<u32>("offsets", tiles + 1)?)?;
                self.workspace.run(&STEP[lists..], &u, group);
            }
        }
        self.pending.push(u);
        self.pending_views.push(view);
        Ok(())
    }

    /// Fetches the losses of all pending steps. If one of them did not have enough slots, it and
    /// those after it did nothing: makes room and repeats them.
    fn settle(&mut self) -> Result<()> {
        while !self.pending.is_empty() {
            let state: Vec<u32> = self.workspace.read("state", 4)?;
            let values: Vec<[f32; 2]> = self.workspace.read("losses", self.pending.len())?;
            let failed = match state[2] {
                0 => self.pending.len(),
                step => self.pending.iter().position(|u| u.step == step).unwrap_or(0),
            };
            self.losses.extend(
                values[..failed]
                    .iter()
                    .map(|v| LossValue { loss: f64::from(v[0]), mse: f64::from(v[1]) }),
            );
            let steps: Vec<_> = self.pending.drain(..).skip(failed).collect();
            let views: Vec<_> = self.pending_views.drain(..).skip(failed).collect();
            if steps.is_empty() {
                break;
            }
            let needed = state[3] as usize;
            self.workspace.grow(needed + needed / 4)?;
            for v in &mut self.views {
                v.group = self.workspace.bind_group("loss", &[], &[("photo", &v.photo)]);
            }
            self.workspace.write("state", &[self.scene.len() as u32, 0, 0, 0]);
            for (view, u) in views.into_iter().zip(steps) {
                self.submit(view, u)?;
            }
        }
        Ok(())
    }
}

impl Executor for GpuExecutor {
    fn step(&mut self, view: usize, step: u64, adam: &AdamStep) -> Result<()> {
        let mut u = self.views[view].view.merge(&self.base).with_adam(adam);
        u.step = step as u32;
        self.submit(view, u)?;
        if self.pending.len() == LOSS_RING {
            self.settle()?;
        }
        Ok(())
    }

    fn drain_losses(&mut self, out: &mut Vec<LossValue>) -> Result<()> {
        self.settle()?;
        out.append(&mut self.losses);
        Ok(())
    }

    fn take_state(&mut self) -> Result<(Scene, Moments)> {
        self.settle()?;
        let mut scene = self.scene.clone();
        let mut moments = Moments::zeros(&scene);
        self.workspace.download(&mut scene, &mut moments)?;
        Ok((scene, moments))
    }

    /// Nothing to do: the device still has the state.
    fn restore(&mut self, _: Scene, _: Moments) {}
}
