//! Gradients of one view after another, for optimisers of other parameters than a scene's arrays.

use gs_model::Scene;

use crate::error::Result;
use crate::gradients::{Backward, planes_of};
use crate::image::Image;
use crate::options::{Loss, RenderOptions};
use crate::stages::blend_adjoint::{FROZEN, MOVING};
use crate::stages::project::View;
use crate::stages::project_adjoint::{Gaussian, gaussian_gradient};
use crate::train::view::{TrainView, check_views};

/// The loss of one view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewLoss {
    /// The loss that the gradients are of.
    pub loss: f64,
    /// Mean squared error of the clamped image, for the PSNR.
    pub mse: f64,
}

impl ViewLoss {
    /// PSNR in dB, at most 100.
    #[must_use]
    pub fn psnr(&self) -> f64 {
        (-10.0 * libm::log10(self.mse)).min(100.0)
    }
}

/// Derivatives of a loss by the arrays of one Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GaussianGradient {
    /// By its SH coefficients, as many as the scene has.
    pub sh: [[f32; 3]; 16],
    /// By its opacity logit.
    pub opacity_logit: f32,
    /// By its log-scales.
    pub log_scale: [f32; 3],
    /// By its quaternion, not normalised.
    pub rotation: [f32; 4],
    /// By its mean; zero where means are frozen.
    pub mean: [f32; 3],
}

/// Renders views, compares them with their photos and gives gradients. Buffers are used again from view
/// to view.
pub struct ViewGradients {
    /// Views with their photos as planes.
    views: Vec<(View, Vec<f32>)>,
    loss: Loss,
    pass: Pass,
    last: usize,
}

/// With or without gradients of the means.
enum Pass {
    Frozen(Box<Backward<FROZEN>>),
    Moving(Box<Backward<MOVING>>),
}

impl ViewGradients {
    /// Prepares the views.
    ///
    /// # Errors
    /// [`NoViews`](crate::Error::NoViews), [`PhotoSize`](crate::Error::PhotoSize),
    /// [`ViewSize`](crate::Error::ViewSize), [`DistortedView`](crate::Error::DistortedView).
    pub fn new(views: &[TrainView], loss: Loss, options: &RenderOptions) -> Result<Self> {
        check_views(views)?;
        let one = |v: &TrainView| (View::new(&v.camera, options), planes_of(&v.photo));
        let views = views.iter().map(one).collect();
        Ok(Self { views, loss, pass: Pass::Frozen(Box::default()), last: 0 })
    }

    /// Whether gradients of the means are wanted from now on; at first they are not.
    pub fn move_means(&mut self, wanted: bool) {
        self.pass =
            if wanted { Pass::Moving(Box::default()) } else { Pass::Frozen(Box::default()) };
    }

    /// Number of views.
    #[must_use]
    pub fn views(&self) -> usize {
        self.views.len()
    }

    /// Renders `scene` at view `view` (modulo their number) and prepares the gradients.
    pub fn run(&mut self, scene: &Scene, view: usize) -> ViewLoss {
        self.last = view % self.views.len();
        let (view, photo) = &self.views[self.last];
        let value = match &mut self.pass {
            Pass::Frozen(pass) => pass.run(scene, view, photo, self.loss),
            Pass::Moving(pass) => pass.run(scene, view, photo, self.loss),
        };
        ViewLoss { loss: value.loss, mse: value.mse }
    }

    /// The image of the last [`ViewGradients::run`].
    #[must_use]
    pub fn image(&self) -> Image {
        let view = &self.views[self.last].0;
        match &self.pass {
            Pass::Frozen(pass) => pass.forward.image(view),
            Pass::Moving(pass) => pass.forward.image(view),
        }
    }

    /// The gradients of Gaussian `i` at the last view; `None` if it reaches no pixel. `scene` is that of
    /// [`ViewGradients::run`].
    #[inline]
    #[must_use]
    pub fn of(&self, scene: &Scene, i: usize) -> Option<GaussianGradient> {
        let (view, gaussian) = (&self.views[self.last].0, Gaussian::of(scene, i));
        let g = match &self.pass {
            Pass::Frozen(pass) => gaussian_gradient(view, &gaussian, pass.sums.get(i)?),
            Pass::Moving(pass) => gaussian_gradient(view, &gaussian, pass.sums.get(i)?),
        }?;
        let mut out = GaussianGradient {
            opacity_logit: g.d_opacity_logit,
            log_scale: g.d_log_scale,
            rotation: g.d_rotation,
            mean: g.d_mean,
            ..GaussianGradient::default()
        };
        for (d, b) in out.sh.iter_mut().zip(&g.basis).take(scene.sh_len()) {
            *d = g.v_raw.map(|v| b * v);
        }
        Some(out)
    }
}
