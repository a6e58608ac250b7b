//! [`StepUniform`].

use gs_model::Scene;

use crate::options::Loss;
use crate::stages::project::RenderView;

/// `StepUniform` of `stages/step.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct StepUniform {
    pub(crate) rotation: [[f32; 4]; 3],
    pub(crate) eye: [f32; 4],
    pub(crate) lens: [f32; 4],
    pub(crate) limits: [f32; 4],
    pub(crate) background: [f32; 4],
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) tiles_x: u32,
    pub(crate) tiles_y: u32,
    pub(crate) count: u32,
    pub(crate) sh_len: u32,
    pub(crate) reference: u32,
    pub(crate) capacity: u32,
    pub(crate) loss_slot: u32,
    pub(crate) step: u32,
    pub(crate) antialiased: u32,
    pub(crate) extra: f32,
    pub(crate) rates: [f32; 4],
    pub(crate) rotation_rate: f32,
    pub(crate) inv_sqrt_bias2: f32,
    pub(crate) most_splats: u32,
    pub(crate) view_weight: f32,
    pub(crate) first_row: u32,
    pub(crate) end_row: u32,
    pub(crate) l1: f32,
    pub(crate) mse: f32,
    pub(crate) ssim: f32,
    pub(crate) blur: f32,
    pub(crate) mean_rate: f32,
    /// The size is a multiple of 16 bytes.
    pub(crate) padding: u32,
}

impl StepUniform {
    /// Everything about `view`; the rest zero.
    pub(crate) fn of_view(view: &RenderView) -> Self {
        let v = |a: [f32; 3]| [a[0], a[1], a[2], 0.0];
        let l = &view.lens;
        let (rows, eye) = view.pose();
        Self {
            rotation: rows.map(v),
            eye: [eye[0], eye[1], eye[2], l.near],
            lens: [l.fx, l.fy, l.cx, l.cy],
            limits: [l.lo_x, l.hi_x, l.lo_y, l.hi_y],
            background: v(view.background),
            width: view.width,
            height: view.height,
            tiles_x: view.tiles_x,
            tiles_y: view.tiles_y,
            end_row: view.tiles_y,
            reference: u32::from(view.reference),
            blur: l.blur,
            view_weight: 1.0,
            ..Default::default()
        }
    }

    /// The numbers of `scene`, and the loss; the rest zero.
    pub(crate) fn of_scene(scene: &Scene, loss: Loss) -> Self {
        let Loss { l1, mse, ssim } = loss;
        let (count, sh_len) = (scene.len() as u32, scene.sh_len() as u32);
        let antialiased = u32::from(scene.antialiased);
        Self { count, sh_len, l1, mse, ssim, antialiased, ..Self::default() }
    }

    /// The view of `self` with the scene and loss of `base`.
    pub(crate) fn merge(mut self, base: &Self) -> Self {
        (self.count, self.sh_len) = (base.count, base.sh_len);
        self.antialiased = base.antialiased;
        (self.l1, self.mse, self.ssim) = (base.l1, base.mse, base.ssim);
        self
    }

    /// Band number `band` of `bands` of the view, from top to bottom.
    pub(crate) fn of_band(mut self, band: u32, bands: u32) -> Self {
        let edge = |k: u32| (u64::from(self.tiles_y) * u64::from(k) / u64::from(bands)) as u32;
        (self.first_row, self.end_row) = (edge(band), edge(band + 1));
        self
    }

    pub(crate) fn has_ssim(&self) -> bool {
        self.ssim > 0.0
    }
}
