//! Steps on the device: they are submitted without waiting, and their losses are fetched later.

use gs_model::Scene;

use super::device::Context;
use super::loops;
use super::passes::{Ends, GpuStage};
use super::program::Program;
use super::sizes::{LOSS_RING, Sizes, pages};
use super::uniform::StepUniform;
use super::workspace::Workspace;
use crate::error::{Error, Result};
use crate::optimiser::set_rows;
use crate::options::Loss;
use crate::stages::loss::ViewLoss;
use crate::stages::project::RenderView;
use crate::view_gradients::PreparedView;

/// A view on the device.
struct DeviceView {
    view: StepUniform,
    /// That of a training view.
    photo: Option<wgpu::Buffer>,
    /// Of the stage `loss`, by channel.
    groups: Vec<wgpu::BindGroup>,
    /// Bands of rows of tiles in which it is drawn: as many as its slots and splats need.
    bands: u32,
}

impl Workspace {
    /// The planes of a photo, a byte per value.
    pub(crate) fn photo(&self, planes: &[u8]) -> Result<wgpu::Buffer> {
        let mut words = planes.to_vec();
        words.resize(planes.len().next_multiple_of(4), 0);
        let photo = self.storage("photo", words.len() / 4)?;
        self.context.queue.write_buffer(&photo, 0, &words);
        // What is written waits in memory of the host until something is submitted.
        self.context.queue.submit([]);
        Ok(photo)
    }

    /// Bind groups of the stage `loss`, by channel.
    pub(crate) fn bind_photo(&self, photo: &wgpu::Buffer) -> Vec<wgpu::BindGroup> {
        let of = |channel| {
            let colour = self.constant("colour", &[channel, 0, 0, 0]);
            self.bind_group("loss", 0, &[], &[("photo", photo), ("colour", &colour)])
        };
        (0..3).map(of).collect()
    }
}

impl DeviceView {
    /// A view, with photo and weight if it is a training view.
    fn new(
        workspace: &Workspace,
        view: &RenderView,
        training: Option<&PreparedView>,
    ) -> Result<Self> {
        let photo = training.map(|v| workspace.photo(v.bytes())).transpose()?;
        let groups = photo.iter().flat_map(|photo| workspace.bind_photo(photo)).collect();
        let mut view = StepUniform::of_view(view);
        view.view_weight = training.map_or(1.0, |v| v.weight);
        if let Some(limit) = workspace.context.loop_limit {
            loops::check_view(limit, &view)?;
        }
        Ok(Self { view, photo, groups, bands: 1 })
    }
}

/// A step whose loss has not been fetched.
struct PendingStep {
    view: usize,
    u: StepUniform,
    ends: &'static Ends,
}

/// What moves the parameters of a scene on a device.
#[derive(Clone, Copy)]
pub(super) enum Mover<'a> {
    Nothing,
    ByAdam,
    ByKernels(&'a Program),
}

impl<'a> Mover<'a> {
    fn program(self) -> Option<&'a Program> {
        match self {
            Self::ByKernels(program) => Some(program),
            _ => None,
        }
    }
}

/// The sizes of a scene and its views on a device. A program's pages come first.
fn sizes(context: &Context, scene: &Scene, views: &[PreparedView], moved: Mover<'_>) -> Sizes {
    let of_program = moved.program().map_or(&[][..], |p| &p.pages).iter().map(|p| p.gaussians);
    let mut all: Vec<usize> = of_program.collect();
    let rest = scene.len().saturating_sub(all.iter().sum());
    all.extend(pages(rest, context.page));
    let [slots, splats] = Sizes::most(context.binding());
    let largest =
        |of: fn(&RenderView) -> usize| views.iter().map(|v| of(&v.view)).fold(1, usize::max);
    Sizes {
        pages: all,
        moments: matches!(moved, Mover::ByAdam),
        sh_len: scene.sh_len(),
        // Grows on demand: a step that needs more slots is repeated.
        capacity: (4 * scene.len()).max(1 << 14).min(slots),
        splats: scene.len().min(splats),
        tiles: largest(RenderView::tiles),
        pixels: largest(|v| v.width as usize * v.height as usize),
    }
}

pub(super) struct DeviceSteps {
    pub(super) workspace: Workspace,
    views: Vec<DeviceView>,
    /// What the uniforms of all steps share.
    base: StepUniform,
    pending: Vec<PendingStep>,
    losses: Vec<ViewLoss>,
}

impl DeviceSteps {
    /// For a scene of the size of `scene`, which is not uploaded.
    pub(super) fn new(
        context: Context,
        scene: &Scene,
        (views, loss): (&[PreparedView], Loss),
        moved: Mover<'_>,
    ) -> Result<Self> {
        let sizes = sizes(&context, scene, views, moved);
        let workspace = Workspace::new(context, sizes, moved.program())?;
        let one = |v: &PreparedView| DeviceView::new(&workspace, &v.view, Some(v));
        let views = views.iter().map(one).collect::<Result<_>>()?;
        workspace.context.check()?;
        let base = StepUniform::of_scene(scene, loss);
        let this = Self { workspace, views, base, pending: Vec::new(), losses: Vec::new() };
        this.reset();
        Ok(this)
    }

    /// Adds a view without a photo, and makes room for it.
    pub(super) fn add_view(&mut self, view: &RenderView) -> Result<usize> {
        let (tiles, pixels) = (view.tiles(), view.width as usize * view.height as usize);
        let Sizes { tiles: most_tiles, pixels: most_pixels, .. } = self.workspace.sizes;
        if tiles > most_tiles || pixels > most_pixels {
            self.settle()?;
            self.grow(|s| (s.tiles, s.pixels) = (tiles.max(s.tiles), pixels.max(s.pixels)))?;
        }
        self.views.push(DeviceView::new(&self.workspace, view, None)?);
        Ok(self.views.len() - 1)
    }

    /// The number of Gaussians; no step has failed.
    fn reset(&self) {
        self.workspace.write("state", 0, &[self.base.count, 0, 0, 0, 0]);
    }

    /// The uniform of step number `number` at a view, modulo their number.
    pub(super) fn uniform(&self, view: usize, number: u64) -> StepUniform {
        let view = &self.views[view % self.views.len()].view;
        StepUniform { step: number as u32, ..view.merge(&self.base) }
    }

    /// Submits a step at a view; `u` is its uniform.
    pub(super) fn step(&mut self, view: usize, u: StepUniform, ends: &'static Ends) -> Result<()> {
        self.submit(PendingStep { view: view % self.views.len(), u, ends })?;
        if self.pending.len() == LOSS_RING { self.settle() } else { Ok(()) }
    }

    fn submit(&mut self, mut step: PendingStep) -> Result<()> {
        let u = &mut step.u;
        u.capacity = self.workspace.sizes.capacity as u32;
        u.most_splats = self.workspace.sizes.splats as u32;
        u.loss_slot = self.pending.len() as u32;
        let DeviceView { groups, bands, .. } = &self.views[step.view];
        for (band, stages) in step.ends.plan(*bands) {
            let u = u.of_band(band, *bands);
            let mut rest = &stages[..];
            let blend = stages.iter().position(|s| *s == GpuStage::Blend);
            // Blending in parts is slower, but only software adapters have a limit.
            if let (Some(limit), Some(blend)) = (self.workspace.context.loop_limit, blend) {
                self.workspace.run(&stages[..blend], &u, groups);
                let tiles = (u.tiles_x * u.tiles_y) as usize;
                loops::check_lists(limit, &self.workspace.read::<u32>("offsets", 0, tiles + 1)?)?;
                rest = &stages[blend..];
            }
            self.workspace.run(rest, &u, groups);
        }
        self.pending.push(step);
        Ok(())
    }

    /// The losses of the steps since the last call, in order.
    pub(super) fn losses(&mut self) -> Result<Vec<ViewLoss>> {
        self.settle()?;
        Ok(std::mem::take(&mut self.losses))
    }

    /// The scene as it is, with the lengths of `like`. Waits for the device.
    pub(super) fn scene(&mut self, mut like: Scene) -> Result<Scene> {
        self.settle()?;
        set_rows(&mut like, &self.workspace.download(0)?);
        Ok(like)
    }

    /// Fetches the losses of all pending steps. If one of them did not have enough slots or splats, it and
    /// those after it did nothing: makes room and repeats them.
    pub(super) fn settle(&mut self) -> Result<()> {
        while !self.pending.is_empty() {
            let state: Vec<u32> = self.workspace.read("state", 0, 5)?;
            let values: Vec<[f32; 2]> = self.workspace.read("losses", 0, self.pending.len())?;
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
            self.make_room(again[0].view, [state[3] as usize, state[4] as usize])?;
            self.reset();
            for step in again {
                self.submit(step)?;
            }
        }
        Ok(())
    }

    fn grow(&mut self, change: impl FnOnce(&mut Sizes)) -> Result<()> {
        self.workspace.grow(change)?;
        for v in &mut self.views {
            v.groups = v.photo.iter().flat_map(|p| self.workspace.bind_photo(p)).collect();
        }
        Ok(())
    }

    /// Room for a view of which a band needs so many slots and splats: larger buffers, or more bands if no binding
    /// holds them.
    fn make_room(&mut self, view: usize, [slots, splats]: [usize; 2]) -> Result<()> {
        let [most_slots, most_splats] = Sizes::most(self.workspace.context.binding());
        if slots <= most_slots && splats <= most_splats {
            return self.grow(|s| s.capacity = (slots + slots / 4).min(most_slots));
        }
        let DeviceView { view: u, bands, .. } = &mut self.views[view];
        if *bands == u.tiles_y {
            let reason = format!(
                "view {view}: a row of tiles shows {splats} Gaussians, {slots} with their tiles, at most {most_splats} \
                 and {most_slots} fit a binding: make the photos smaller, or use the CPU"
            );
            return Err(Error::Gpu { reason });
        }
        *bands = (2 * *bands).min(u.tiles_y);
        Ok(())
    }

    /// Bytes of all buffers on the device.
    pub(super) fn bytes(&self) -> u64 {
        self.workspace.bytes()
            + self.views.iter().flat_map(|v| &v.photo).map(wgpu::Buffer::size).sum::<u64>()
    }

    #[cfg(test)]
    pub(super) fn bands(&self) -> Vec<u32> {
        self.views.iter().map(|v| v.bands).collect()
    }
}
