//! Checks that cameras belong to a scene.
//!
//! Importances from cameras of another scene destroy a model without an error. These measures let a caller warn
//! before that, and measure the loss after it.

use gs_model::{Camera, Scene};

use crate::frustum::that_see;
use crate::saliency::saliency;
use crate::stages::opacity_of;
use crate::train_view::TrainView;

/// Share of the scene's opacity that a set of cameras sees: the sum of the opacities of the
/// Gaussians whose blending weight is above zero, over the sum of all opacities. It is 0 if the
/// cameras see nothing, and 1 if they see every Gaussian, or if the scene has no opacity at all.
///
/// `weights` are blending weights of the Gaussians, as [`crate::saliency`] gives them. A Gaussian without a weight counts as unseen.
///
/// ```
/// use finetune::{saliency, seen_opacity_share};
/// use gs_model::{Camera, Scene};
///
/// let scene = Scene {
///     means: vec![[0.0, 0.0, 0.0], [0.0, 0.0, -9.0]],
///     rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
///     log_scales: vec![[-2.0; 3]; 2],
///     opacity_logits: vec![1.0; 2],
///     sh_degree: 0,
///     sh: vec![[0.0; 3]; 2],
///     ..Scene::default()
/// };
/// // The camera looks at the first Gaussian; the second is behind it.
/// let (eye, up) = ([0.0, 0.0, -2.0], [0.0, -1.0, 0.0]);
/// let camera = Camera::looking_at("front".into(), eye, [0.0; 3], up, [32, 24], 30.0);
/// let share = seen_opacity_share(&scene, &saliency(&scene, &[camera]).total);
/// assert_eq!(share, 0.5);
/// ```
#[must_use]
pub fn seen_opacity_share(scene: &Scene, weights: &[f32]) -> f64 {
    let (mut seen, mut all) = (0.0, 0.0);
    for (i, &logit) in scene.opacity_logits.iter().enumerate() {
        let opacity = f64::from(opacity_of(logit));
        if opacity.is_finite() {
            all += opacity;
            seen += if weights.get(i).is_some_and(|&w| w > 0.0) { opacity } else { 0.0 };
        }
    }
    if all > 0.0 { seen / all } else { 1.0 }
}

/// Cameras that see less than this share of a scene's opacity may be those of another scene.
const LEAST_SEEN: f64 = 0.5;

/// Why cameras do not fit their model, most often.
pub const MISFIT_CAUSES: &str = "Most often nerfstudio's dataparser_transforms.json is not beside transforms.json, or \
    the axes (y or z up) or the units differ";

/// What cameras see of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Visibility {
    /// Sum of squared blending weights of each Gaussian over the pixels of all views.
    pub weights: Vec<f32>,
    /// See [`seen_opacity_share`].
    pub share: f64,
}

impl Visibility {
    /// Renders `scene` from each camera that can see it; if these are more than 256, from as many of them, which stand
    /// for all. `step` is called after each with the number of cameras that are done. An error from it ends the
    /// work.
    ///
    /// # Errors
    /// Those of `step`.
    pub fn of<E>(
        scene: &Scene,
        cameras: &[Camera],
        mut step: impl FnMut(usize) -> Result<(), E>,
    ) -> Result<Self, E> {
        let mut weights = vec![0.0f32; scene.len()];
        let (chosen, each) = that_see(scene, cameras);
        for (i, camera) in chosen.iter().enumerate() {
            let one = saliency(scene, std::slice::from_ref(camera));
            weights.iter_mut().zip(one.squared).for_each(|(sum, w)| *sum += w);
            step((i + 1) * cameras.len() / chosen.len())?;
        }
        if each > 1.0 {
            weights.iter_mut().for_each(|w| *w = (f64::from(*w) * each) as f32);
        }
        let share = seen_opacity_share(scene, &weights);
        Ok(Self { weights, share })
    }

    /// Number of Gaussians that no camera sees.
    #[must_use]
    pub fn unseen(&self) -> usize {
        self.weights.iter().filter(|&&w| w <= 0.0).count()
    }

    /// A sentence, if these may be the cameras of another scene: they see nothing, or less than half of the
    /// opacity.
    #[must_use]
    pub fn doubt(&self) -> Option<String> {
        let part = match self.share {
            s if s >= LEAST_SEEN => return None,
            0.0 => "nothing of the model".into(),
            s if s < 0.01 => "less than 1 % of the model's opacity".into(),
            s => format!("{:.0} % of the model's opacity", 100.0 * s),
        };
        Some(format!("these cameras see {part}; are they its own? {MISFIT_CAUSES}"))
    }
}

/// Views of [`References`]; more only take longer.
const REFERENCES: usize = 12;

/// Renders of a scene, to measure its stream against.
#[derive(Clone, Debug)]
pub struct References {
    views: Vec<TrainView>,
}

impl References {
    /// Renders `scene` from at most 12 of the cameras, evenly spread. `step` is called after each render with the
    /// numbers of renders that are done and that there will be. An error from it ends the work.
    ///
    /// # Errors
    /// Those of `step`.
    pub fn new<E>(
        scene: &Scene,
        cameras: &[Camera],
        mut step: impl FnMut(usize, usize) -> Result<(), E>,
    ) -> Result<Self, E> {
        let every = cameras.len().div_ceil(REFERENCES).max(1);
        let chosen: Vec<&Camera> = cameras.iter().step_by(every).collect();
        let mut views = Vec::with_capacity(chosen.len());
        for camera in &chosen {
            views.push(TrainView::rendered(scene, (*camera).clone()));
            step(views.len(), chosen.len())?;
        }
        Ok(Self { views })
    }

    /// Mean over the views of the PSNR of `scene`'s render, dB.
    #[must_use]
    pub fn psnr(&self, scene: &Scene) -> f64 {
        self.mean(|view| view.psnr(scene))
    }

    /// Mean over the views of the SSIMULACRA2 of `scene`'s render.
    #[must_use]
    pub fn ssimulacra2(&self, scene: &Scene) -> f64 {
        self.mean(|view| view.ssimulacra2(scene))
    }

    fn mean(&self, score: impl Fn(&TrainView) -> f64) -> f64 {
        self.views.iter().map(score).sum::<f64>() / self.views.len() as f64
    }
}
