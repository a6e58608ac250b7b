//! [`SceneOptimiser`]: a scene that is fine-tuned.

#[cfg(feature = "gpu")]
use std::borrow::Cow;

#[cfg(feature = "gpu")]
use super::rows::{rows_of, set_rows};
use super::rows::{scene_chunks, stride};
use super::{Adam, AdamMoments};
use crate::options::LearningRates;
use crate::stages::loss::ViewLoss;
use crate::stages::project_adjoint::Gaussian;
use crate::view_gradients::ViewGradients;
use gs_model::Scene;
use rayon::prelude::*;

/// Weights of the mean opacity and the mean scale in the loss, as in MCMC training (Kheradmand et al. 2024, section 3.3).
/// What no photo needs fades and shrinks.
///
/// A step shrinks only the Gaussians that its view shows. Adam divides by the root of the second moment. Where the
/// moments are zero, shrinkage alone would move a Gaussian at several times its rate until a view shows it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shrinkage {
    /// Of the mean opacity.
    pub opacity: f32,
    /// Of the mean scale, in world units.
    pub scale: f32,
}

/// A scene, and Adam on the rows of its Gaussians.
pub struct SceneOptimiser {
    scene: Scene,
    /// Adam's moments, row after row.
    pub moments: AdamMoments,
    /// Rates of the other parameters.
    pub rates: LearningRates,
    /// Rate of the means.
    pub mean_rate: f32,
    /// Coefficients of higher SH degrees stay where they are.
    pub learned_degree: u8,
    /// Zero at first.
    pub shrinkage: Shrinkage,
}

impl SceneOptimiser {
    /// Starts from `scene`. Means stay where they are if their rate is zero.
    #[must_use]
    pub fn new(scene: Scene, rates: LearningRates, mean_rate: f32) -> Self {
        let moments = AdamMoments::zeros(stride(scene.sh_len()) * scene.len());
        let (learned_degree, shrinkage) = (scene.sh_degree, Shrinkage::default());
        Self { scene, moments, rates, mean_rate, learned_degree, shrinkage }
    }

    /// The scene as it is.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Takes the scene out, after the last step.
    #[must_use]
    pub fn take_scene(&mut self) -> Scene {
        std::mem::take(&mut self.scene)
    }

    /// Step number `number`, counted from 1, at a view. `decay` multiplies all rates.
    pub fn step(
        &mut self,
        views: &mut ViewGradients,
        view: usize,
        number: u64,
        decay: f32,
    ) -> ViewLoss {
        let loss = views.run(&self.scene, view);
        self.descend(views, number, decay);
        loss
    }

    /// Moves means by what `by` says of each Gaussian, in world units.
    pub fn move_means(&mut self, by: impl Fn(&Scene, usize) -> Option<[f32; 3]> + Sync) {
        let scene = &self.scene;
        let by: Vec<_> = (0..scene.len()).into_par_iter().map(|i| by(scene, i)).collect();
        self.scene.means.par_iter_mut().zip(by).for_each(|(mean, by)| {
            if let Some(by) = by {
                mean.iter_mut().zip(by).for_each(|(mean, by)| *mean += by);
            }
        });
    }

    /// Moves the scene against the gradients of the last view.
    pub(crate) fn descend(&mut self, views: &ViewGradients, number: u64, decay: f32) {
        let rates: Vec<f32> = self.row_rates().iter().map(|r| r * decay).collect();
        let scene = &mut self.scene;
        let k = 3 * scene.sh_len();
        let Shrinkage { opacity, scale } = self.shrinkage;
        let n = scene.len().max(1) as f32;
        let shrinking = (opacity / n, scale / (3.0 * n));
        let gradient = |i: usize, row: &[f32], g: &mut [f32]| {
            let Some(found) = views.of_gaussian(&Gaussian::of_row(row), i) else { return };
            g[..3].copy_from_slice(&found.mean);
            g[3..3 + k].copy_from_slice(&found.sh.as_flattened()[..k]);
            g[3 + k] = found.opacity_logit;
            g[4 + k..7 + k].copy_from_slice(&found.log_scale);
            g[7 + k..].copy_from_slice(&found.rotation);
            if shrinking != (0.0, 0.0) {
                let alpha = 1.0 / (1.0 + libm::expf(-row[3 + k]));
                g[3 + k] += shrinking.0 * (alpha * (1.0 - alpha));
                let scales = g[4 + k..7 + k].iter_mut().zip(&row[4 + k..]);
                scales.for_each(|(g, s)| *g += shrinking.1 * libm::expf(*s));
            }
        };
        self.moments.step(Adam::new(number), &rates, scene_chunks(scene), gradient, |_| ());
    }

    /// The rate of each parameter of a row.
    fn row_rates(&self) -> Vec<f32> {
        let r = &self.rates;
        let mut rates = vec![self.mean_rate; 3];
        rates.extend([r.sh_dc; 3]);
        let learned = gs_model::sh_len(self.learned_degree.min(self.scene.sh_degree));
        rates.extend(vec![r.sh_rest; 3 * learned - 3]);
        rates.extend(vec![0.0; 3 * (self.scene.sh_len() - learned)]);
        rates.push(r.opacity);
        rates.extend([r.log_scale; 3]);
        rates.extend([r.rotation; 4]);
        rates
    }
}

/// The state of the steps, for the executor on a device.
#[cfg(feature = "gpu")]
impl SceneOptimiser {
    /// The rates, with the means frozen.
    pub(crate) fn rates(&self) -> &LearningRates {
        &self.rates
    }

    /// Parameters and moments, row after row.
    pub(crate) fn state(&self) -> [Cow<'_, [f32]>; 3] {
        let AdamMoments { first, second } = &self.moments;
        [rows_of(&self.scene).into(), first.into(), second.into()]
    }

    /// Takes parameters and moments.
    pub(crate) fn set_state(&mut self, [rows, first, second]: [Vec<f32>; 3]) {
        set_rows(&mut self.scene, &rows);
        self.moments = AdamMoments { first, second };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Loss, Photo, RenderOptions, TrainView};
    use gs_model::Camera;

    #[test]
    fn what_the_photos_do_not_need_fades_and_what_no_view_shows_stays() {
        let (eye, up) = ([0.0, 0.0, -3.0], [0.0, -1.0, 0.0]);
        let camera = Camera::looking_at("a".into(), eye, [0.0; 3], up, [32, 24], 60.0);
        let mut scene = Scene::zeros(2, 0);
        // The second lies behind the camera.
        scene.means[1] = [0.0, 0.0, -9.0];
        scene.rotations.fill([1.0, 0.0, 0.0, 0.0]);
        scene.log_scales.fill([-1.0; 3]);
        let photo = Photo { rgb: vec![90; 32 * 24 * 3], ..Photo::black(32, 24) };
        let view = TrainView { camera, photo };
        let after = |weight: f32| {
            let options = RenderOptions::default();
            let mut views = ViewGradients::new(vec![view.clone()], Loss::Mse, &options).unwrap();
            let mut run = SceneOptimiser::new(scene.clone(), LearningRates::default(), 0.0);
            run.shrinkage = Shrinkage { opacity: weight, scale: weight };
            (1..=20).for_each(|number| _ = run.step(&mut views, 0, number, 1.0));
            run.take_scene()
        };
        let (free, after) = (after(0.0), after(1.0));
        assert!(after.opacity_logits[0] < free.opacity_logits[0] - 0.5);
        assert!(after.log_scales[0][0] < free.log_scales[0][0] - 0.05);
        assert_eq!(after.select(&[1]), scene.select(&[1]));
    }
}
