//! The views of a run: those that gradients come from, in their order, and those kept aside.

use finetune::optimiser::permutation;
use finetune::{Loss, RenderOptions, TrainView, ViewGradients, metrics, render};
use gs_model::{Camera, Scene};

use crate::error::{Error, Result};

/// Of so many training views one is kept aside; none of fewer.
const ASIDE: usize = 16;
/// A model whose renders match the photos worse than this does not belong to them.
const LEAST_MATCH_DB: f64 = 12.0;

/// See the module.
pub(crate) struct Views {
    /// All cameras, for importance.
    pub(crate) cameras: Vec<Camera>,
    pub(crate) gradients: ViewGradients,
    aside: Vec<TrainView>,
    seed: u64,
    order: Vec<u32>,
}

impl Views {
    pub(crate) fn new(views: Vec<TrainView>, seed: u64) -> Result<Self> {
        for (index, view) in views.iter().enumerate() {
            if view.photo.rgb.iter().any(|v| !v.is_finite()) {
                return Err(Error::PhotoValue { index, name: view.camera.name.clone() });
            }
        }
        let cameras = views.iter().map(|v| v.camera.clone()).collect();
        let (mut training, mut aside) = (Vec::new(), Vec::new());
        for (i, view) in views.into_iter().enumerate() {
            if i % ASIDE == ASIDE / 2 { aside.push(view) } else { training.push(view) }
        }
        // Mean squared error: it gives a higher PSNR and fewer bytes than L1 with SSIM.
        let gradients = ViewGradients::new(&training, Loss::Mse, &RenderOptions::default())?;
        if aside.is_empty() {
            aside.extend(training.first().cloned());
        }
        Ok(Self { cameras, gradients, aside, seed, order: Vec::new() })
    }

    /// PSNR of the input model at the views kept aside.
    ///
    /// # Errors
    /// [`Error::OtherPhotos`] if the photos show something else.
    pub(crate) fn check(&self, scene: &Scene) -> Result<f64> {
        let (_, psnr) = self.aside(scene);
        if psnr < LEAST_MATCH_DB { Err(Error::OtherPhotos { psnr }) } else { Ok(psnr) }
    }

    /// The view of a step, counted from 0. Each is visited once before any is visited again.
    pub(crate) fn at(&mut self, step: u64) -> usize {
        let n = self.gradients.views() as u64;
        let (epoch, within) = (step / n, step % n);
        if self.order.is_empty() || within == 0 {
            self.order = permutation(self.seed, epoch, n as usize);
        }
        self.order[within as usize] as usize
    }

    /// Mean squared error and mean PSNR at the views kept aside.
    pub(crate) fn aside(&self, scene: &Scene) -> (f64, f64) {
        let psnr = |v: &TrainView| {
            metrics::psnr(&render(scene, &v.camera, &RenderOptions::default()), &v.photo).min(100.0)
        };
        let all: Vec<f64> = self.aside.iter().map(psnr).collect();
        let n = all.len().max(1) as f64;
        let mse = all.iter().map(|db| libm::exp10(-0.1 * db)).sum::<f64>() / n;
        (mse, all.iter().sum::<f64>() / n)
    }

    /// Number of views kept aside.
    pub(crate) fn kept_aside(&self) -> usize {
        self.aside.len()
    }

    /// Pixels of all cameras.
    pub(crate) fn pixels(&self) -> f64 {
        self.cameras.iter().map(|c| f64::from(c.width) * f64::from(c.height)).sum()
    }

    /// How much the views change without each Gaussian.
    pub(crate) fn removal_effects(&self, scene: &Scene) -> Vec<f32> {
        finetune::removal_effects(scene, &self.cameras)
    }

    /// The sum of squared blending weights of each Gaussian.
    pub(crate) fn importance(&self, scene: &Scene) -> Vec<f32> {
        finetune::saliency_per_view(scene, &self.cameras).squared
    }
}
