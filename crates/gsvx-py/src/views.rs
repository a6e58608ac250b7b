//! What cameras see of a model, and how renders of a stream compare with those of its input.

use crate::background::Line;
use crate::cameras::Cameras;
use crate::error::{Fault, Result};
use finetune::{Image, RenderOptions, metrics, render, saliency_per_view, seen_opacity_share};
use gs_model::{Camera, Scene};

/// Cameras that see less than this share of a model's opacity may be those of another model.
const LEAST_SEEN: f64 = 0.5;
/// Views used to measure quality; more only slow a search down.
const MEASURED_VIEWS: usize = 12;

/// What cameras see of a model.
pub(crate) struct Seen {
    /// Sum of squared blending weights per Gaussian.
    pub(crate) weights: Vec<f32>,
    /// Share of the opacity of all Gaussians that belongs to those seen.
    pub(crate) share: f64,
    /// What is to be said of it.
    pub(crate) warning: Option<String>,
}

impl Seen {
    /// # Errors
    /// If the cameras see nothing.
    pub(crate) fn of(scene: &Scene, cameras: &Cameras, line: &Line) -> Result<Self> {
        let Cameras { name, list } = cameras;
        let mut weights = vec![0.0f32; scene.len()];
        for (i, camera) in list.iter().enumerate() {
            let one = saliency_per_view(scene, std::slice::from_ref(camera));
            weights.iter_mut().zip(one.squared).for_each(|(sum, v)| *sum += v);
            line.step("importance", i + 1, list.len())?;
        }
        let share = seen_opacity_share(scene, &weights);
        if share == 0.0 {
            return Err(Fault::Failed(format!(
                "{name}: these cameras see nothing of the model; are they its own?"
            )));
        }
        let warning = (share < LEAST_SEEN).then(|| {
            let share = 100.0 * share;
            format!(
                "{name}: these cameras see {share:.1} % of the model's opacity; are they its own?"
            )
        });
        Ok(Self { weights, share, warning })
    }

    /// Gaussians that no camera sees.
    pub(crate) fn unseen(&self) -> usize {
        self.weights.iter().filter(|&&w| w <= 0.0).count()
    }
}

/// Renders of the input model, to measure a decoded scene against.
pub(crate) struct Reference {
    views: Vec<(Camera, Image)>,
}

impl Reference {
    /// Renders the input model at some of the cameras.
    pub(crate) fn new(scene: &Scene, cameras: &[Camera], line: &Line) -> Result<Self> {
        let step = cameras.len().div_ceil(MEASURED_VIEWS).max(1);
        let chosen: Vec<&Camera> = cameras.iter().step_by(step).collect();
        let mut views = Vec::with_capacity(chosen.len());
        for camera in &chosen {
            let image = render(scene, camera, &RenderOptions::default());
            // What a screen shows is clamped; differences beyond it do not count.
            let image = Image::from_rgb8(image.width, image.height, &image.to_rgb8());
            views.push(((*camera).clone(), image.unwrap_or_default()));
            line.step("renders of the input", views.len(), chosen.len())?;
        }
        Ok(Self { views })
    }

    /// Mean over the views of the PSNR of `scene`'s render, dB.
    pub(crate) fn psnr(&self, scene: &Scene) -> f64 {
        let psnr = |(camera, image): &(Camera, Image)| {
            metrics::psnr(&render(scene, camera, &RenderOptions::default()), image)
        };
        self.views.iter().map(psnr).sum::<f64>() / self.views.len() as f64
    }
}
