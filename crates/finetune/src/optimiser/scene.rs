//! [`SceneOptimiser`]: a scene that is fine-tuned.

use super::{Adam, AdamMoments};
use crate::options::LearningRates;
use crate::stages::loss::ViewLoss;
use crate::view_gradients::ViewGradients;
use gs_model::Scene;
use rayon::prelude::*;

/// Weights of two terms of the loss that no view asks for, as MCMC training has them (Kheradmand et al. 2024, section 3.3):
/// the mean opacity and the mean scale. What no photo needs fades and shrinks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shrinkage {
    /// Of the mean opacity.
    pub opacity: f32,
    /// Of the mean scale, in world units.
    pub scale: f32,
}

/// A scene as rows of parameters (mean, SH coefficients, opacity logit, log-scales, quaternion), and Adam on
/// them.
pub struct SceneOptimiser {
    scene: Scene,
    rows: Vec<f32>,
    /// Adam's moments, in the layout of the rows.
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
        let rows = rows_of(&scene);
        let moments = AdamMoments::zeros(rows.len());
        let (learned_degree, shrinkage) = (scene.sh_degree, Shrinkage::default());
        Self { scene, rows, moments, rates, mean_rate, learned_degree, shrinkage }
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
        let stride = stride(self.scene.sh_len());
        let scene = &self.scene;
        self.rows.par_chunks_mut(stride).enumerate().for_each(|(i, row)| {
            if let Some(by) = by(scene, i) {
                row.iter_mut().zip(by).for_each(|(mean, by)| *mean += by);
            }
        });
        let (means, rows) = (&mut self.scene.means, &self.rows);
        means.par_iter_mut().enumerate().for_each(|(i, v)| copy(&rows[i * stride..], v));
    }

    /// Moves the scene against the gradients of the last view.
    pub(crate) fn descend(&mut self, views: &ViewGradients, number: u64, decay: f32) {
        let rates: Vec<f32> = self.row_rates().iter().map(|r| r * decay).collect();
        let scene = &self.scene;
        let k = 3 * scene.sh_len();
        let Shrinkage { opacity, scale } = self.shrinkage;
        let n = scene.len().max(1) as f32;
        let shrinking = (opacity / n, scale / (3.0 * n));
        let gradient = |i: usize, row: &mut [f32]| {
            if let Some(g) = views.of(scene, i) {
                row[..3].copy_from_slice(&g.mean);
                row[3..3 + k].copy_from_slice(&g.sh.as_flattened()[..k]);
                row[3 + k] = g.opacity_logit;
                row[4 + k..7 + k].copy_from_slice(&g.log_scale);
                row[7 + k..].copy_from_slice(&g.rotation);
            }
            if shrinking != (0.0, 0.0) {
                let alpha = 1.0 / (1.0 + libm::expf(-scene.opacity_logits[i]));
                row[3 + k] += shrinking.0 * (alpha * (1.0 - alpha));
                let scales = row[4 + k..7 + k].iter_mut().zip(scene.log_scales[i]);
                scales.for_each(|(g, s)| *g += shrinking.1 * libm::expf(s));
            }
        };
        self.moments.step(Adam::new(number), &rates, &mut self.rows, gradient, |_| ());
        self.rebuild();
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

    /// Puts the rows into the scene.
    fn rebuild(&mut self) {
        let k = self.scene.sh_len();
        let (rows, stride) = (&self.rows, stride(k));
        let row = |i: usize| &rows[i * stride..(i + 1) * stride];
        let Scene { means, rotations, log_scales, opacity_logits, sh, .. } = &mut self.scene;
        let at = 3 + 3 * k;
        means.par_iter_mut().enumerate().for_each(|(i, v)| copy(row(i), v));
        sh.par_chunks_mut(k)
            .enumerate()
            .for_each(|(i, v)| v.as_flattened_mut().copy_from_slice(&row(i)[3..at]));
        opacity_logits.par_iter_mut().enumerate().for_each(|(i, v)| *v = row(i)[at]);
        log_scales.par_iter_mut().enumerate().for_each(|(i, v)| copy(&row(i)[at + 1..], v));
        rotations.par_iter_mut().enumerate().for_each(|(i, v)| copy(&row(i)[at + 4..], v));
    }
}

fn copy<const N: usize>(from: &[f32], to: &mut [f32; N]) {
    to.copy_from_slice(&from[..N]);
}

/// Parameters of a row, of `k` SH coefficients.
fn stride(k: usize) -> usize {
    3 * k + 11
}

/// The rows of a scene.
pub(crate) fn rows_of(scene: &Scene) -> Vec<f32> {
    let k = 3 * scene.sh_len();
    let stride = stride(scene.sh_len());
    let mut rows = vec![0.0; stride * scene.len()];
    rows.par_chunks_mut(stride).enumerate().for_each(|(i, row)| {
        row[..3].copy_from_slice(&scene.means[i]);
        row[3..3 + k].copy_from_slice(scene.sh_of(i).as_flattened());
        row[3 + k] = scene.opacity_logits[i];
        row[4 + k..7 + k].copy_from_slice(&scene.log_scales[i]);
        row[7 + k..].copy_from_slice(&scene.rotations[i]);
    });
    rows
}

/// The state of the steps, for the executor on a device.
#[cfg(feature = "gpu")]
impl SceneOptimiser {
    /// The rates, with the means frozen.
    pub(crate) fn rates(&self) -> &LearningRates {
        &self.rates
    }

    /// Parameters and moments, row after row.
    pub(crate) fn state(&self) -> [&[f32]; 3] {
        [&self.rows, &self.moments.first, &self.moments.second]
    }

    /// Takes parameters and moments.
    pub(crate) fn set_state(&mut self, [rows, first, second]: [Vec<f32>; 3]) {
        self.rows = rows;
        self.moments = AdamMoments { first, second };
        self.rebuild();
    }
}
