//! Records the stages and submits them.

use super::sizes::Scan;
use super::uniform::StepUniform;
use super::workspace::Workspace;
#[cfg(test)]
use crate::forward::Forward;
use crate::shaders::{DISPATCH_ROW, GROUP_TILES, LOSS_RUN};
use crate::stages::TILE;

/// A stage of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum GpuStage {
    Project,
    SortDepth,
    Emit,
    SortTile,
    Ranges,
    Blend,
    Loss,
    BlendAdjoint,
    Gather,
    Adam,
    /// Kernels of another crate, which make the scene.
    Before,
    /// Kernels of another crate, which use the derivatives.
    After,
}

/// All stages, in order. A step without kernels of another crate has nothing to do in [`GpuStage::Before`] and
/// [`GpuStage::After`].
pub(crate) static STEP: [GpuStage; 12] = [
    GpuStage::Before,
    GpuStage::Project,
    GpuStage::SortDepth,
    GpuStage::Emit,
    GpuStage::SortTile,
    GpuStage::Ranges,
    GpuStage::Blend,
    GpuStage::Loss,
    GpuStage::BlendAdjoint,
    GpuStage::Gather,
    GpuStage::After,
    GpuStage::Adam,
];

/// The stages of a step with kernels of another crate, which move the parameters. Without the first, the scene is
/// that of the step before.
pub(crate) static KERNEL_STEP: &[GpuStage] = STEP.split_at(11).0;

impl Workspace {
    /// Records and submits stages for the view in `u`. `photo` is the loss stage's bind group.
    pub(crate) fn run(
        &self,
        stages: &[GpuStage],
        u: &StepUniform,
        photo: Option<&wgpu::BindGroup>,
    ) {
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
        let (projected, lists) = (&forward.projected, &forward.lists);
        let mut counts = vec![0u32; projected.splats.len()];
        for &i in &lists.ids {
            counts[i as usize] += 1;
        }
        self.write("keys", &projected.keys);
        self.write("splats", &projected.splats);
        self.write("boxes", &projected.boxes);
        self.write("counts", &counts);
        self.write("state", &[counts.len() as u32, lists.ids.len() as u32, 0, 0]);
        self.run(
            &[GpuStage::SortDepth, GpuStage::Emit, GpuStage::SortTile, GpuStage::Ranges],
            u,
            None,
        );
        self.write("ids", &lists.ids);
        self.write("offsets", &lists.offsets);
    }

    fn record(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        stage: GpuStage,
        u: &StepUniform,
        photo: Option<&wgpu::BindGroup>,
    ) {
        let gaussians = (u.count + 1).div_ceil(64);
        let tiles = u.tiles_x * u.tiles_y;
        let single = |pass: &mut wgpu::ComputePass<'_>, shader, groups| {
            self.dispatch(pass, shader, shader, self.group(shader), groups, 1);
        };
        match stage {
            GpuStage::Project => single(pass, "project", gaussians),
            GpuStage::SortDepth => {
                let blocks = self.sizes.depth_blocks() as u32;
                // The number of pairs is in `state`; `check_capacity` writes it, and the host
                // wrote it before the first step.
                self.sort(pass, &self.depth_passes, Scan::DepthHistogram, blocks);
            }
            GpuStage::Emit => {
                let group = self.group("emit");
                self.dispatch(pass, "emit", "rank_counts", group, gaussians, 1);
                self.scan(pass, Scan::Starts);
                self.dispatch(pass, "emit", "check_capacity", group, 1, 1);
                self.dispatch(pass, "emit", "emit", group, gaussians, 1);
            }
            GpuStage::SortTile => {
                let blocks = self.sizes.tile_blocks() as u32;
                self.sort(pass, &self.tile_passes, Scan::TileHistogram, blocks);
            }
            GpuStage::Ranges => {
                let n = (self.sizes.capacity as u32).max(tiles + 1);
                single(pass, "ranges", n.div_ceil(64));
                single(pass, "reach", (self.sizes.capacity as u32).div_ceil(4 * 64));
            }
            GpuStage::Blend => single(pass, "blend", tiles.div_ceil(GROUP_TILES)),
            GpuStage::Loss => {
                let Some(group) = photo else { return };
                let pixels = u.width * u.height;
                let lanes = |n: u32| n.div_ceil(64);
                if u.is_l1_ssim() {
                    let rows = lanes(u.width.div_ceil(LOSS_RUN) * u.height);
                    let columns = lanes(u.width * u.height.div_ceil(LOSS_RUN));
                    self.dispatch(pass, "loss", "ssim_rows", group, rows, 3);
                    self.dispatch(pass, "loss", "ssim_values", group, columns, 3);
                    self.dispatch(pass, "loss", "ssim_spread", group, rows, 3);
                }
                let every = lanes(tiles * TILE * TILE / LOSS_RUN);
                self.dispatch(pass, "loss", "loss_gradient", group, every, 3);
                self.dispatch(pass, "loss", "loss_blocks", group, (3 * pixels).div_ceil(4096), 1);
                self.dispatch(pass, "loss", "loss_total", group, 1, 1);
            }
            GpuStage::BlendAdjoint => single(pass, "blend_adjoint", tiles.div_ceil(GROUP_TILES)),
            GpuStage::Gather => single(pass, "gather", gaussians),
            GpuStage::Adam => single(pass, "adam", gaussians),
            GpuStage::Before => self.calls(pass, &self.before),
            GpuStage::After => self.calls(pass, &self.after),
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
            self.dispatch(pass, "sort", "sort_count", group, blocks, 1);
            self.scan(pass, scan);
            self.dispatch(pass, "sort", "sort_scatter", group, blocks, 1);
        }
    }

    fn scan(&self, pass: &mut wgpu::ComputePass<'_>, scan: Scan) {
        let levels = self.scan_levels(scan);
        for level in levels {
            self.dispatch(pass, "scan", "scan_local", &level.group, level.blocks, 1);
        }
        // The last level has one workgroup, so its total is not added to anything.
        for level in levels.iter().rev().skip(1) {
            self.dispatch(pass, "scan", "scan_add", &level.group, level.blocks, 1);
        }
    }

    pub(super) fn dispatch(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        shader: &'static str,
        entry: &'static str,
        group: &wgpu::BindGroup,
        groups: u32,
        depth: u32,
    ) {
        pass.set_pipeline(self.pipeline(shader, entry));
        pass.set_bind_group(0, group, &[]);
        let (x, y) = fold(groups);
        pass.dispatch_workgroups(x, y, depth);
    }
}

/// Workgroups as rows of at most [`DISPATCH_ROW`]: a dimension has at most 65535.
pub(crate) fn fold(groups: u32) -> (u32, u32) {
    (groups.min(DISPATCH_ROW), groups.div_ceil(DISPATCH_ROW).max(1))
}
