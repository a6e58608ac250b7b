//! Cameras at encode time: importance of each Gaussian, and quality as seen.

use crate::progress;
use anyhow::{Context, Result, bail};
use finetune::{Image, RenderOptions, metrics, render, saliency_per_view};
use gs_model::{Camera, Scene, dataset};
use std::path::Path;

/// Views used to measure quality; more only slow the search down.
const MEASURED_VIEWS: usize = 12;

/// The training cameras of a scene folder.
pub(crate) fn cameras(dir: &Path) -> Result<Vec<Camera>> {
    let (_, views) = dataset::open_views(dir)?;
    if views.is_empty() {
        bail!("{}: no cameras", dir.display());
    }
    // Every 8th is held out for measuring, as everywhere in this project.
    let training: Vec<Camera> =
        views.into_iter().enumerate().filter(|(i, _)| i % 8 != 0).map(|(_, v)| v.camera).collect();
    if training.is_empty() {
        bail!("{}: a single camera is held out for measuring; give two or more", dir.display());
    }
    Ok(training)
}

/// Sum of squared blending weights per Gaussian over the cameras.
pub(crate) fn importance(scene: &Scene, cameras: &[Camera]) -> Vec<f32> {
    let bar = progress::bar("importance", cameras.len() as u64);
    let mut sum = vec![0.0f32; scene.len()];
    for camera in cameras {
        let one = saliency_per_view(scene, std::slice::from_ref(camera));
        for (s, v) in sum.iter_mut().zip(one.squared) {
            *s += v;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    sum
}

/// Measures a decoded scene against renders of the input model.
pub(crate) struct Reference {
    views: Vec<(Camera, Image)>,
}

impl Reference {
    /// Renders the input model at some of the cameras.
    pub(crate) fn new(scene: &Scene, cameras: &[Camera]) -> Result<Self> {
        let step = cameras.len().div_ceil(MEASURED_VIEWS).max(1);
        let views: Vec<_> = cameras
            .iter()
            .step_by(step)
            .map(|camera| {
                let image = render(scene, camera, &RenderOptions::default());
                // What a screen shows is clamped; differences beyond it do not count.
                let image = Image::from_rgb8(image.width, image.height, &image.to_rgb8());
                Ok((camera.clone(), image.context("render has no pixels")?))
            })
            .collect::<Result<_>>()?;
        Ok(Self { views })
    }

    /// Mean over the views of the PSNR of `scene`'s render, dB.
    pub(crate) fn psnr(&self, scene: &Scene) -> f64 {
        let sum: f64 = self
            .views
            .iter()
            .map(|(camera, image)| {
                metrics::psnr(&render(scene, camera, &RenderOptions::default()), image)
            })
            .sum();
        sum / self.views.len() as f64
    }
}
