//! [`SceneOptimiser`]: a scene that is fine-tuned.

#[cfg(feature = "gpu")]
use super::rows::{rows_of, set_rows};
use super::rows::{scene_chunks, stride};
use super::unseen::catch_up;
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

/// A scene, and Adam on the rows of its Gaussians. A step moves those that its view shows. The others catch up before a
/// view shows them, so a step costs what is seen, not the size of the scene.
pub struct SceneOptimiser {
    scene: Scene,
    /// Adam's moments, row after row.
    pub moments: AdamMoments,
    /// For each row the number of the step that it is up to date with; 0 at first.
    pub last: Vec<u32>,
    /// Number of the last step, and what its rates were multiplied by.
    pub made: (u64, f32),
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
        let last = vec![0; scene.len()];
        let (learned_degree, shrinkage) = (scene.sh_degree, Shrinkage::default());
        Self { scene, moments, last, made: (0, 1.0), rates, mean_rate, learned_degree, shrinkage }
    }

    /// The scene as it is. Rows may have missed steps: see [`SceneOptimiser::settle`].
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Makes the steps that rows have missed, at the rates of now.
    pub fn settle(&mut self) {
        let (rates, number) = (self.row_rates(self.made.1), self.made.0 as u32);
        let Self { scene, moments, last, .. } = self;
        catch_up([number; 2], &rates, scene_chunks(scene), moments, last, |_| true);
    }

    /// Takes the scene out, after the last step.
    #[must_use]
    pub fn take_scene(&mut self) -> Scene {
        self.settle();
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
        let (rates, made) = (self.row_rates(decay), number.saturating_sub(1) as u32);
        self.made = (number, decay);
        let Self { scene, moments, last, .. } = self;
        if last.par_iter().any(|&last| last > 0 && last < made) {
            views.look(scene, view);
            let due = |i: usize| views.may_show(i);
            catch_up([made; 2], &rates, scene_chunks(scene), moments, last, due);
        }
        let loss = views.run(scene, view);
        let shows = |i: usize| views.shows(i);
        catch_up([made, number as u32], &rates, scene_chunks(scene), moments, last, shows);
        self.descend(views, Adam::new(number), &rates);
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

    /// Moves what the last view shows against its gradients.
    fn descend(&mut self, views: &ViewGradients, adam: Adam, rates: &[f32]) {
        let Self { scene, moments, .. } = self;
        let (k, antialiased) = (3 * scene.sh_len(), scene.antialiased);
        let Shrinkage { opacity, scale } = self.shrinkage;
        let n = scene.len().max(1) as f32;
        let shrinking = (opacity / n, scale / (3.0 * n));
        let gradient = |i: usize, row: &[f32], g: &mut [f32]| {
            let Some(found) = views.of_gaussian(&Gaussian::of_row(row, antialiased), i) else {
                return;
            };
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
        let shows = |i: usize| views.shows(i);
        moments.step(adam, rates, scene_chunks(scene), shows, gradient, |_| ());
    }

    /// The rate of each parameter of a row, times `decay`.
    fn row_rates(&self, decay: f32) -> Vec<f32> {
        let r = &self.rates;
        let mut rates = vec![self.mean_rate; 3];
        rates.extend([r.sh_dc; 3]);
        let learned = gs_model::sh_len(self.learned_degree.min(self.scene.sh_degree));
        rates.extend(vec![r.sh_rest; 3 * learned - 3]);
        rates.extend(vec![0.0; 3 * (self.scene.sh_len() - learned)]);
        rates.push(r.opacity);
        rates.extend([r.log_scale; 3]);
        rates.extend([r.rotation; 4]);
        rates.iter_mut().for_each(|rate| *rate *= decay);
        rates
    }
}

/// The state of the steps, for the executor on a device.
#[cfg(feature = "gpu")]
impl SceneOptimiser {
    /// Parameters and moments, row after row.
    pub(crate) fn state(&self) -> [Vec<f32>; 3] {
        let mut copy = Self::new(self.scene.clone(), self.rates, self.mean_rate);
        (copy.moments, copy.last, copy.made) = (self.moments.clone(), self.last.clone(), self.made);
        copy.settle();
        [rows_of(&copy.scene), copy.moments.first, copy.moments.second]
    }

    /// Takes parameters and moments after so many steps, which moved every row.
    pub(crate) fn set_state(&mut self, [rows, first, second]: [Vec<f32>; 3], made: u64) {
        set_rows(&mut self.scene, &rows);
        self.moments = AdamMoments { first, second };
        self.last.fill(made as u32);
        self.made.0 = made;
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
            let mut views = ViewGradients::new(vec![view.clone()], Loss::MSE, &options).unwrap();
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
