//! The views of a run: those that gradients come from, in their order, and those kept aside.
//!
//! A photo that the input model matches far worse than it does most photos shows something that the model
//! cannot: another exposure, a lens out of focus, a person who walked by. Its squared error is so large that it
//! would outweigh all others, so it counts less: see [`weights`].

use finetune::optimiser::permutation;
use finetune::{Loss, RenderOptions, TrainView, ViewGradients, metrics, render};
use gs_model::{Camera, Scene};

use crate::error::{Error, Result};

/// One of this many training views is kept aside; with fewer views, none.
const ASIDE: usize = 16;
/// A photo counts in full up to this many times the median of the squared errors (3 dB).
const FULL_WEIGHT: f64 = 2.0;

/// The views of a run.
pub(crate) struct Views {
    /// All cameras, for importance.
    pub(crate) cameras: Vec<Camera>,
    pub(crate) gradients: ViewGradients,
    pub(crate) aside: Vec<TrainView>,
    seed: u64,
    order: Vec<u32>,
}

impl Views {
    /// Gradients of `loss` come from all views, which all count the same.
    pub(crate) fn all(views: Vec<TrainView>, loss: Loss, seed: u64) -> Result<Self> {
        let cameras = cameras_of(&views)?;
        let gradients = ViewGradients::new(views, loss, &RenderOptions::default())?;
        Ok(Self { cameras, gradients, aside: Vec::new(), seed, order: Vec::new() })
    }

    /// Some views are kept aside, and photos that `scene`, the input model, matches badly count less.
    pub(crate) fn new(scene: &Scene, views: Vec<TrainView>, seed: u64) -> Result<Self> {
        let cameras = cameras_of(&views)?;
        let (mut training, mut aside) = (Vec::new(), Vec::new());
        for (i, view) in views.into_iter().enumerate() {
            if i % ASIDE == ASIDE / 2 { aside.push(view) } else { training.push(view) }
        }
        if aside.is_empty() {
            aside.extend(training.first().cloned());
        }
        let errors: Vec<f64> =
            training.iter().map(|v| libm::exp10(-0.1 * psnr(scene, v))).collect();
        // Mean squared error: it gives a higher PSNR and fewer bytes than L1 with SSIM.
        let mut gradients = ViewGradients::new(training, Loss::Mse, &RenderOptions::default())?;
        weights(&errors).iter().enumerate().for_each(|(i, w)| gradients.weigh(i, *w as f32));
        Ok(Self { cameras, gradients, aside, seed, order: Vec::new() })
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
    pub(crate) fn at_aside(&self, scene: &Scene) -> (f64, f64) {
        let all: Vec<f64> = self.aside.iter().map(|v| psnr(scene, v)).collect();
        let n = all.len().max(1) as f64;
        let mse = all.iter().map(|db| libm::exp10(-0.1 * db)).sum::<f64>() / n;
        (mse, all.iter().sum::<f64>() / n)
    }

    /// Pixels of all cameras.
    pub(crate) fn pixels(&self) -> f64 {
        self.cameras.iter().map(|c| f64::from(c.width) * f64::from(c.height)).sum()
    }

    /// The sum of squared blending weights of each Gaussian.
    pub(crate) fn importance(&self, scene: &Scene) -> Vec<f32> {
        finetune::saliency(scene, &self.cameras).squared
    }
}

/// The cameras of views whose photos hold numbers.
fn cameras_of(views: &[TrainView]) -> Result<Vec<Camera>> {
    for (index, view) in views.iter().enumerate() {
        if view.photo.rgb.iter().any(|v| !v.is_finite()) {
            return Err(Error::PhotoValue { index, name: view.camera.name.clone() });
        }
    }
    Ok(views.iter().map(|v| v.camera.clone()).collect())
}

/// PSNR of a scene at a view, dB, at most 100.
fn psnr(scene: &Scene, view: &TrainView) -> f64 {
    metrics::psnr(&render(scene, &view.camera, &RenderOptions::default()), &view.photo).min(100.0)
}

/// Weights of photos with these mean squared errors.
fn weights(errors: &[f64]) -> Vec<f64> {
    let mut sorted = errors.to_vec();
    sorted.sort_by(f64::total_cmp);
    let full = sorted.get(sorted.len() / 2).map_or(0.0, |median| FULL_WEIGHT * median);
    errors.iter().map(|&e| if e > full { full / e } else { 1.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_photos_that_match_far_worse_than_most_count_less() {
        assert_eq!(weights(&[1.0, 2.0, 1.5, 0.1, 1.0]), [1.0; 5]);
        assert_eq!(weights(&[1.0, 8.0, 1.0, 1.0]), [1.0, 0.25, 1.0, 1.0]);
        assert_eq!(weights(&[0.0; 3]), [1.0; 3]);
        assert!(weights(&[]).is_empty());
    }
}
