//! A loss and all its gradients, for tests and for callers with their own optimiser.

use gs_model::{Camera, Scene};

use crate::forward::Forward;
use crate::image::Image;
use crate::options::{Loss, RenderOptions};
use crate::stages::blend_adjoint::{FROZEN, MOVING, TileGradient, blend_adjoint};
use crate::stages::gather::gather_gradients;
use crate::stages::loss::{LossValue, SsimScratch, l1_ssim, mse, to_planes, to_tiles};
use crate::stages::project::View;
use crate::stages::project_adjoint::{Gaussian, gaussian_gradient};

/// Gradients of a loss with respect to a scene's arrays, in their layout.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gradients {
    /// With respect to [`Scene::sh`].
    pub d_sh: Vec<[f32; 3]>,
    /// With respect to [`Scene::opacity_logits`].
    pub d_opacity_logit: Vec<f32>,
    /// With respect to [`Scene::log_scales`].
    pub d_log_scale: Vec<[f32; 3]>,
    /// With respect to [`Scene::rotations`], not normalised ones.
    pub d_rotation: Vec<[f32; 4]>,
    /// With respect to [`Scene::means`].
    pub d_mean: Vec<[f32; 3]>,
    /// Squared length of the gradient with respect to the projected mean, per pixel squared. It tells
    /// how far a Gaussian is from a position that fits the photo.
    pub image_gradient2: Vec<f32>,
}

/// Loss of `scene` seen by `camera` against `photo`, and its gradients.
///
/// `None` if the photo's size is not the camera's.
#[must_use]
pub fn gradients(
    scene: &Scene,
    camera: &Camera,
    photo: &Image,
    loss: Loss,
    options: &RenderOptions,
) -> Option<(f64, Gradients)> {
    let view = View::new(camera, options);
    if (photo.width, photo.height) != (view.width, view.height) {
        return None;
    }
    let mut pass = Backward::<MOVING>::default();
    let photo = planes_of(photo);
    let value = pass.run(scene, &view, &photo, loss);
    let n = scene.len();
    let mut out = Gradients {
        d_sh: vec![[0.0; 3]; scene.sh.len()],
        d_opacity_logit: vec![0.0; n],
        d_log_scale: vec![[0.0; 3]; n],
        d_rotation: vec![[0.0; 4]; n],
        d_mean: vec![[0.0; 3]; n],
        image_gradient2: vec![0.0; n],
    };
    let k = scene.sh_len();
    for (i, record) in pass.sums.iter().enumerate() {
        let Some(g) = gaussian_gradient(&view, &Gaussian::of(scene, i), record) else { continue };
        for (d, b) in out.d_sh[i * k..(i + 1) * k].iter_mut().zip(&g.basis) {
            *d = g.v_raw.map(|v| b * v);
        }
        out.d_opacity_logit[i] = g.d_opacity_logit;
        out.d_log_scale[i] = g.d_log_scale;
        out.d_rotation[i] = g.d_rotation;
        out.d_mean[i] = g.d_mean;
        out.image_gradient2[i] = g.image_gradient2;
    }
    Some((value.loss, out))
}

/// An interleaved image as three planes.
pub(crate) fn planes_of(image: &Image) -> Vec<f32> {
    let mut planes = Vec::with_capacity(image.rgb.len());
    for channel in 0..3 {
        planes.extend(image.rgb.iter().skip(channel).step_by(3));
    }
    planes
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
        view: &View,
        photo: &[f32],
        loss: Loss,
    ) -> LossValue {
        self.forward.run(scene, view);
        let value = self.loss(view, photo, loss);
        let f = &self.forward;
        let splats = &f.projected.splats;
        blend_adjoint(view, f, &self.tiles, &mut self.records);
        gather_gradients(&f.lists, &self.records, splats, &mut self.sums);
        value
    }

    /// The stage `loss` on the blended tiles.
    pub(crate) fn loss(&mut self, view: &View, photo: &[f32], loss: Loss) -> LossValue {
        to_planes(view, &self.forward.tiles, &mut self.planes);
        let (w, h) = (view.width as usize, view.height as usize);
        let value = match loss {
            Loss::Mse => mse(w, &self.planes, photo, &mut self.gradient),
            Loss::L1Ssim { ssim_weight } => l1_ssim(
                (w, h),
                ssim_weight,
                [&self.planes, photo],
                &mut self.scratch,
                &mut self.gradient,
            ),
        };
        to_tiles(view, &self.gradient, &mut self.tiles);
        value
    }
}
