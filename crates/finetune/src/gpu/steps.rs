//! Steps on the device: they are submitted without waiting, and their losses are fetched later.

use super::loops;
use super::passes::Stage;
use super::sizes::LOSS_RING;
use super::uniform::StepUniform;
use super::workspace::Workspace;
use crate::error::Result;
use crate::stages::project::View;
use crate::view_gradients::ViewLoss;

/// A training view and its photo on the device.
pub(super) struct DeviceView {
    pub(super) view: StepUniform,
    photo: wgpu::Buffer,
    pub(super) group: wgpu::BindGroup,
}

impl DeviceView {
    /// A view with the planes of its photo.
    pub(super) fn new(workspace: &Workspace, view: &View, planes: &[f32]) -> Result<Self> {
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
    stages: &'static [Stage],
}

pub(super) struct DeviceSteps {
    pub(super) workspace: Workspace,
    pub(super) views: Vec<DeviceView>,
    pending: Vec<Pending>,
    losses: Vec<ViewLoss>,
}

impl DeviceSteps {
    pub(super) fn new(workspace: Workspace, views: Vec<DeviceView>) -> Result<Self> {
        workspace.context.check()?;
        workspace.write("state", &[workspace.sizes.count as u32, 0, 0, 0]);
        Ok(Self { workspace, views, pending: Vec::new(), losses: Vec::new() })
    }

    /// Submits the stages of a step at a view; `u` is its uniform.
    pub(super) fn step(
        &mut self,
        view: usize,
        u: StepUniform,
        stages: &'static [Stage],
    ) -> Result<()> {
        self.submit(Pending { view, u, stages })?;
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
                let lists = step.stages.iter().take_while(|s| **s != Stage::Blend).count();
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
            self.losses.extend(
                values[..failed]
                    .iter()
                    .map(|v| ViewLoss { loss: f64::from(v[0]), mse: f64::from(v[1]) }),
            );
            let again: Vec<_> = self.pending.drain(..).skip(failed).collect();
            if again.is_empty() {
                break;
            }
            let needed = state[3] as usize;
            self.workspace.grow(needed + needed / 4)?;
            for v in &mut self.views {
                v.group = self.workspace.bind_group("loss", &[], &[("photo", &v.photo)]);
            }
            self.workspace.write("state", &[self.workspace.sizes.count as u32, 0, 0, 0]);
            for step in again {
                self.submit(step)?;
            }
        }
        Ok(())
    }
}
