//! Records the stages and submits them.

use super::sizes::Scan;
use super::uniform::StepUniform;
use super::workspace::Workspace;
#[cfg(test)]
use crate::forward::Forward;
use crate::shaders::{DISPATCH_ROW, LOSS_RUN};
use crate::stages::TILE;
#[cfg(test)]
use crate::stages::project::{CULLED, ProjectedSplat, Splat, TileBox};

/// A stage of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum GpuStage {
    Project,
    SortDepth,
    Rank,
    Emit,
    SortTile,
    Ranges,
    Blend,
    Loss,
    BlendAdjoint,
    Gather,
    /// What leaving out each Gaussian changes in the view.
    Removal,
    /// Adds it to that of the views before.
    Total,
    Adam,
    /// Kernels of another crate, which make the scene.
    Before,
    /// Kernels of another crate, which use the derivatives.
    After,
}

/// The stages that make the lists of a band.
pub(crate) const LISTS: [GpuStage; 6] = [
    GpuStage::Project,
    GpuStage::SortDepth,
    GpuStage::Rank,
    GpuStage::Emit,
    GpuStage::SortTile,
    GpuStage::Ranges,
];

/// The stages of a step beside the forward pass.
#[derive(Debug)]
pub(crate) struct Ends {
    before: &'static [GpuStage],
    /// Of the blended view.
    view: &'static [GpuStage],
    /// Of each band after that.
    bands: &'static [GpuStage],
    after: &'static [GpuStage],
}

/// A step of Adam.
pub(crate) static STEP: Ends = Ends {
    before: &[],
    view: &[GpuStage::Loss],
    bands: &[GpuStage::BlendAdjoint, GpuStage::Gather],
    after: &[GpuStage::Adam],
};
/// A step with kernels of another crate, which move the parameters. The scene is that of the step before.
pub(crate) static KERNEL_STEP: Ends = Ends { after: &[GpuStage::After], ..STEP };
/// Such a step, in which they make the scene.
pub(crate) static MAKING_STEP: Ends = Ends { before: &[GpuStage::Before], ..KERNEL_STEP };
/// What leaving out each Gaussian changes in a view. Nothing moves.
pub(crate) static REMOVAL: Ends =
    Ends { view: &[], bands: &[GpuStage::Removal, GpuStage::Total], after: &[], ..STEP };

impl Ends {
    /// All stages of a step at a view of so many bands: what is done in each band, one after the other. The lists of a
    /// band take the place of those of the band before, so the adjoint makes them again if there are several.
    pub(crate) fn plan(&self, bands: u32) -> Vec<(u32, Vec<GpuStage>)> {
        let mut plan = vec![(0, self.before.to_vec())];
        let mut add = |band: u32, stages: &[GpuStage]| match plan.last_mut() {
            Some(last) if last.0 == band => last.1.extend(stages),
            _ => plan.push((band, [&LISTS[..], stages].concat())),
        };
        add(0, &LISTS);
        (0..bands).for_each(|band| add(band, &[GpuStage::Blend]));
        add(bands - 1, self.view);
        (0..bands).for_each(|band| add(band, self.bands));
        add(bands - 1, self.after);
        plan
    }
}

impl Workspace {
    /// Records and submits stages for the view in `u`. `photo` has the loss stage's bind groups.
    pub(crate) fn run(&self, stages: &[GpuStage], u: &StepUniform, photo: &[wgpu::BindGroup]) {
        let queue = &self.context.queue;
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(u));
        let mut encoder = self.context.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            for stage in stages {
                self.record(&mut pass, *stage, u, photo);
            }
        }
        queue.submit([encoder.finish()]);
    }

    /// Uploads the projected splats of the Rust executor and repeats the stages that make the lists,
    /// so that `blend` and its adjoint have the same inputs in both executors.
    #[cfg(test)]
    pub(crate) fn upload_lists(&self, forward: &Forward, u: &StepUniform) {
        let (lists, projected) = (&forward.lists, &forward.projected);
        self.write("keys", 0, &projected.spread(&projected.seen.keys, CULLED));
        self.write("page_splats", 0, &projected.spread(&packed(projected), [0; 12]));
        let state = [projected.places.len() as u32, lists.ids.len() as u32, 0, 0];
        self.write("state", 0, &state);
        self.run(&LISTS[1..], u, &[]);
        let mut ranks = vec![0; forward.order.len()];
        forward.order.iter().zip(0..).for_each(|(&i, rank)| ranks[i as usize] = rank);
        let ids: Vec<u32> = lists.ids.iter().map(|&i| ranks[i as usize]).collect();
        self.write("ids", 0, &ids);
        self.write("offsets", 0, &lists.offsets);
    }

    fn record(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        stage: GpuStage,
        u: &StepUniform,
        photo: &[wgpu::BindGroup],
    ) {
        let ranks = (u.count + 1).div_ceil(64);
        let band = (u.end_row - u.first_row) * u.tiles_x;
        // Once for each page, if the shader has pages.
        let single = |pass: &mut wgpu::ComputePass<'_>, shader, groups| {
            for group in self.groups(shader) {
                self.dispatch(pass, shader, shader, group, groups);
            }
        };
        match stage {
            GpuStage::Project => self.of_pages(pass, "project"),
            GpuStage::SortDepth => {
                let blocks = self.sizes.depth_blocks() as u32;
                // The number of pairs is in `state`; `check_capacity` writes it, and the host
                // wrote it before the first step.
                self.sort(pass, &self.depth_passes, Scan::DepthHistogram, blocks);
            }
            GpuStage::Rank => single(pass, "rank", ranks),
            GpuStage::Emit => {
                let (counts, writes) = (&self.emits[0], &self.emits[1]);
                self.dispatch(pass, "emit", "emit", counts, ranks);
                self.scan(pass, Scan::Starts);
                self.dispatch(pass, "emit", "check_capacity", writes, 1);
                self.dispatch(pass, "emit", "emit", writes, ranks);
            }
            GpuStage::SortTile => {
                let blocks = self.sizes.tile_blocks() as u32;
                self.sort(pass, &self.tile_passes, Scan::TileHistogram, blocks);
            }
            GpuStage::Ranges => {
                let n = (self.sizes.capacity as u32).max(u.tiles_x * u.tiles_y + 1);
                single(pass, "ranges", n.div_ceil(64));
                single(pass, "reach", (self.sizes.capacity as u32).div_ceil(4 * 64));
            }
            GpuStage::Blend => single(pass, "blend", band),
            GpuStage::Loss => self.loss(pass, u, photo),
            GpuStage::BlendAdjoint => single(pass, "blend_adjoint", band),
            GpuStage::Gather => single(pass, "gather", ranks),
            GpuStage::Removal => single(pass, "removal", band),
            GpuStage::Total => {
                let pages = self.groups("total").iter();
                pages.for_each(|group| self.dispatch(pass, "total", "gather", group, ranks));
            }
            GpuStage::Adam => self.of_pages(pass, "adam"),
            GpuStage::Before => self.calls(pass, &self.before),
            GpuStage::After => self.calls(pass, &self.after),
        }
    }

    /// A shader with a lane per Gaussian of a page.
    fn of_pages(&self, pass: &mut wgpu::ComputePass<'_>, shader: &'static str) {
        for (group, &n) in self.groups(shader).iter().zip(&self.sizes.pages) {
            self.dispatch(pass, shader, shader, group, (n as u32).div_ceil(64));
        }
    }

    /// The loss, channel by channel; `photo` has a bind group of each.
    fn loss(&self, pass: &mut wgpu::ComputePass<'_>, u: &StepUniform, photo: &[wgpu::BindGroup]) {
        let lanes = |n: u32| n.div_ceil(64);
        let rows = lanes(u.width.div_ceil(LOSS_RUN) * u.height);
        let columns = lanes(u.width * u.height.div_ceil(LOSS_RUN));
        let every = lanes(u.tiles_x * u.tiles_y * TILE * TILE / LOSS_RUN);
        for group in photo {
            if u.has_ssim() {
                self.dispatch(pass, "loss", "ssim_rows", group, rows);
                self.dispatch(pass, "loss", "ssim_values", group, columns);
                self.dispatch(pass, "loss", "ssim_spread", group, rows);
            }
            self.dispatch(pass, "loss", "loss_gradient", group, every);
            let blocks = (u.width * u.height).div_ceil(4096);
            self.dispatch(pass, "loss", "loss_blocks", group, blocks);
        }
        if let Some(group) = photo.last() {
            self.dispatch(pass, "loss", "loss_total", group, 1);
        }
    }

    fn sort(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        passes: &[wgpu::BindGroup],
        scan: Scan,
        blocks: u32,
    ) {
        for group in passes {
            self.dispatch(pass, "sort", "sort_count", group, blocks);
            self.scan(pass, scan);
            self.dispatch(pass, "sort", "sort_scatter", group, blocks);
        }
    }

    fn scan(&self, pass: &mut wgpu::ComputePass<'_>, scan: Scan) {
        let levels = self.scan_levels(scan);
        for level in levels {
            self.dispatch(pass, "scan", "scan_local", &level.group, level.blocks);
        }
        // The last level has one workgroup, so its total is not added to anything.
        for level in levels.iter().rev().skip(1) {
            self.dispatch(pass, "scan", "scan_add", &level.group, level.blocks);
        }
    }

    pub(super) fn dispatch(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        shader: &'static str,
        entry: &'static str,
        group: &wgpu::BindGroup,
        groups: u32,
    ) {
        pass.set_pipeline(self.pipeline(shader, entry));
        pass.set_bind_group(0, group, &[]);
        let (x, y) = fold(groups);
        pass.dispatch_workgroups(x, y, 1);
    }
}

/// Splats as the device has them: with the box of tiles instead of the rows of pixels.
#[cfg(test)]
pub(crate) fn packed(projected: &ProjectedSplat) -> Vec<[u32; 12]> {
    let all = projected.seen.splats.iter().zip(&projected.seen.boxes);
    let pack = |(splat, b): (&Splat, &TileBox)| {
        let mut words: [u32; 12] = bytemuck::cast(*splat);
        (words[7], words[11]) = (b.x0 | b.x1 << 16, b.y0 | b.y1 << 16);
        words
    };
    all.map(pack).collect()
}

/// Workgroups as rows of at most [`DISPATCH_ROW`]: a dimension has at most 65535.
pub(crate) fn fold(groups: u32) -> (u32, u32) {
    (groups.min(DISPATCH_ROW), groups.div_ceil(DISPATCH_ROW).max(1))
}
