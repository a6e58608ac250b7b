//! The forward and the backward pass of the Rust executor.

use gs_model::Scene;

use crate::forward::Forward;
use crate::options::Loss;
use crate::stages::blend_adjoint::{FROZEN, MOVING, TileGradient, blend_adjoint};
use crate::stages::gather::gather;
use crate::stages::loss::{SsimScratch, ViewLoss, per_pixel, to_planes, to_tiles, with_ssim};
use crate::stages::project::RenderView;

/// Interleaved pixels as three planes.
pub(crate) fn planes_of<T: Copy>(rgb: &[T]) -> Vec<T> {
    (0..3).flat_map(|channel| rgb.iter().skip(channel).step_by(3)).copied().collect()
}

/// Buffers of a forward and backward pass up to `gather`.
pub(crate) struct Backward<const N: usize> {
    pub(crate) forward: Forward,
    planes: Vec<f32>,
    gradient: Vec<f32>,
    scratch: SsimScratch,
    pub(crate) tiles: Vec<TileGradient>,
    pub(crate) records: Vec<[f32; N]>,
    pub(crate) sums: Vec<[f32; N]>,
}

impl<const N: usize> Default for Backward<N> {
    fn default() -> Self {
        const { assert!(N == FROZEN || N == MOVING) };
        Self {
            forward: Forward::default(),
            planes: Vec::new(),
            gradient: Vec::new(),
            scratch: SsimScratch::default(),
            tiles: Vec::new(),
            records: Vec::new(),
            sums: Vec::new(),
        }
    }
}

impl<const N: usize> Backward<N> {
    /// Runs project .. gather; `photo` as planes.
    pub(crate) fn run(
        &mut self,
        scene: &Scene,
        view: &RenderView,
        photo: &[f32],
        loss: Loss,
    ) -> ViewLoss {
        self.forward.run(scene, view);
        let value = self.loss(view, photo, loss);
        let f = &self.forward;
        blend_adjoint(view, f, &self.tiles, &mut self.records);
        let splats = &f.projected.seen.splats;
        gather(&f.lists, &self.records, splats.len(), &mut self.sums, |i, sum| {
            // The gradient of a colour that was clamped at zero is zero.
            for (v, shown) in sum.iter_mut().zip([splats[i].red, splats[i].green, splats[i].blue]) {
                *v = if shown > 0.0 { *v } else { 0.0 };
            }
        });
        value
    }

    /// What `gather` found for Gaussian `i`; `None` if it reaches no pixel.
    #[inline(always)]
    pub(crate) fn sum(&self, i: usize) -> Option<&[f32; N]> {
        let place = self.forward.projected.place(i)?;
        self.sums.get(place).filter(|sum| **sum != [0.0; N])
    }

    /// What `gather` found, for all Gaussians.
    #[cfg(all(test, feature = "gpu"))]
    pub(crate) fn all_sums(&self) -> Vec<[f32; N]> {
        self.forward.projected.spread(&self.sums, [0.0; N])
    }

    /// The stage `loss` on the blended tiles.
    pub(crate) fn loss(&mut self, view: &RenderView, photo: &[f32], loss: Loss) -> ViewLoss {
        let Self { planes, gradient, scratch, .. } = self;
        to_planes(view, &self.forward.tiles, planes);
        let w = view.width as usize;
        let value = if loss.ssim == 0.0 {
            per_pixel(w, loss, [planes, photo], gradient)
        } else {
            with_ssim(w, loss, [planes, photo], scratch, gradient)
        };
        to_tiles(view, gradient, &mut self.tiles);
        value
    }
}
