//! Steps on the device: they are submitted without waiting, and their losses are fetched later.

use gs_model::Scene;

use super::device::Context;
use super::loops;
use super::passes::GpuStage;
use super::program::Program;
use super::sizes::{LOSS_RING, Sizes};
use super::uniform::StepUniform;
use super::workspace::Workspace;
use crate::error::Result;
use crate::options::Loss;
use crate::stages::loss::ViewLoss;
use crate::stages::project::RenderView;
use crate::view_gradients::PreparedView;

/// A training view and its photo on the device.
struct DeviceView {
    view: StepUniform,
    photo: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl DeviceView {
    /// A view with the planes of its photo.
    fn new(workspace: &Workspace, view: &RenderView, planes: &[f32]) -> Result<Self> {
        let photo = workspace.storage("photo", planes.len())?;
        workspace.context.queue.write_buffer(&photo, 0, bytemuck::cast_slice(planes));
        let group = workspace.bind_group("loss", &[], &[("photo", &photo)]);
        let view = StepUniform::of_view(view);
        if let Some(limit) = workspace.context.loop_limit {
            loops::check_view(limit, &view)?;
        }
        Ok(Self { view, photo, group })
    }
}

/// A step whose loss has not been fetched.
struct Pending {
    view: usize,
    u: StepUniform,
    stages: &'static [GpuStage],
}

/// The sizes of a scene and its views.
fn sizes(scene: &Scene, views: &[PreparedView]) -> Sizes {
    let largest =
        |of: fn(&RenderView) -> usize| views.iter().map(|v| of(&v.view)).fold(1, usize::max);
    Sizes {
        count: scene.len(),
        sh_len: scene.sh_len(),
        // Grows on demand: a step that needs more slots is repeated.
        capacity: (4 * scene.len()).max(1 << 14),
        tiles: largest(RenderView::tiles),
        pixels: largest(|v| v.width as usize * v.height as usize),
    }
}

pub(super) struct DeviceSteps {
    pub(super) workspace: Workspace,
    views: Vec<DeviceView>,
    /// What the uniforms of all steps share.
    base: StepUniform,
    pending: Vec<Pending>,
    losses: Vec<ViewLoss>,
}

impl DeviceSteps {
    /// For a scene of the size of `scene`, which is not uploaded.
    pub(super) fn new(
        context: Context,
        scene: &Scene,
        views: &[PreparedView],
        loss: Loss,
        program: Option<&Program>,
    ) -> Result<Self> {
        let workspace = Workspace::new(context, sizes(scene, views), program)?;
        let mut planes = Vec::new();
        let one = |prepared: &PreparedView| {
            prepared.planes(&mut planes);
            DeviceView::new(&workspace, &prepared.view, &planes)
        };
        let views = views.iter().map(one).collect::<Result<_>>()?;
        workspace.context.check()?;
        let base = StepUniform::of_scene(scene, loss);
        let this = Self { workspace, views, base, pending: Vec::new(), losses: Vec::new() };
        this.reset();
        Ok(this)
    }

    /// The number of Gaussians; no step has failed.
    fn reset(&self) {
        self.workspace.write("state", &[self.base.count, 0, 0, 0]);
    }

    /// The uniform of step number `number` at a view, modulo their number.
    pub(super) fn uniform(&self, view: usize, number: u64) -> StepUniform {
        let view = &self.views[view % self.views.len()].view;
        StepUniform { step: number as u32, ..view.merge(&self.base) }
    }

    /// Submits the stages of a step at a view; `u` is its uniform.
    pub(super) fn step(
        &mut self,
        view: usize,
        u: StepUniform,
        stages: &'static [GpuStage],
    ) -> Result<()> {
        self.submit(Pending { view: view % self.views.len(), u, stages })?;
        if self.pending.len() == LOSS_RING { self.settle() } else { Ok(()) }
    }

    fn submit(&mut self, mut step: Pending) -> Result<()> {
        let u = &mut step.u;
        u.capacity = self.workspace.sizes.capacity as u32;
        u.loss_slot = self.pending.len() as u32;
        let group = Some(&self.views[step.view].group);
        match self.workspace.context.loop_limit {
            None => self.workspace.run(step.stages, u, group),
            // Slower, but only a software adapter has a limit.
            Some(limit) => {
                let lists = step.stages.iter().take_while(|s| **s != GpuStage::Blend).count();
                self.workspace.run(&step.stages[..lists], u, group);
                let tiles = (u.tiles_x * u.tiles_y) as usize;
                loops::check_lists(limit, &self.workspace.read::<u32>("offsets", tiles + 1)?)?;
                self.workspace.run(&step.stages[lists..], u, group);
            }
        }
        self.pending.push(step);
        Ok(())
    }

    /// The losses of the steps since the last call, in order.
    pub(super) fn losses(&mut self) -> Result<Vec<ViewLoss>> {
        self.settle()?;
        Ok(std::mem::take(&mut self.losses))
    }

    /// Fetches the losses of all pending steps. If one of them did not have enough slots, it and
    /// those after it did nothing: makes room and repeats them.
    pub(super) fn settle(&mut self) -> Result<()> {
        while !self.pending.is_empty() {
            let state: Vec<u32> = self.workspace.read("state", 4)?;
            let values: Vec<[f32; 2]> = self.workspace.read("losses", self.pending.len())?;
            let failed = match state[2] {
                0 => self.pending.len(),
                step => self.pending.iter().position(|p| p.u.step == step).unwrap_or(0),
            };
            let of = |v: &[f32; 2]| ViewLoss { loss: v[0].into(), mse: v[1].into() };
            self.losses.extend(values[..failed].iter().map(of));
            let again: Vec<_> = self.pending.drain(..).skip(failed).collect();
            if again.is_empty() {
                break;
            }
            let needed = state[3] as usize;
            self.workspace.grow(needed + needed / 4)?;
            for v in &mut self.views {
                v.group = self.workspace.bind_group("loss", &[], &[("photo", &v.photo)]);
            }
            self.reset();
            for step in again {
                self.submit(step)?;
            }
        }
        Ok(())
    }
}
