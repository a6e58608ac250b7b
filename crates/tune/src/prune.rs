//! The first stage: Gaussians that show little are left out in rounds, and the others are fine-tuned
//! between the rounds, with their means free.

use finetune::optimiser::Adam;
use finetune::{LearningRates, ViewGradients};
use gs_model::{Camera, Scene};
use rayon::prelude::*;

use crate::rows::Moments;

/// Rate of the means, over the extent of the cameras.
const MEAN_RATE: f32 = 2e-5;
/// Rates fall to this fraction in a round.
const FINAL_RATE: f64 = 0.1;

/// Half of the extent of the cameras: the greatest distance of one from their mean, and a tenth.
pub(crate) fn extent(cameras: &[Camera]) -> f64 {
    let centres: Vec<[f64; 3]> =
        cameras.iter().map(|c| (c.rotation.transpose() * -c.translation).to_array()).collect();
    let n = centres.len().max(1) as f64;
    let mean = [0, 1, 2].map(|k| centres.iter().map(|c| c[k]).sum::<f64>() / n);
    let distance =
        |c: &[f64; 3]| (0..3).map(|k| (c[k] - mean[k]) * (c[k] - mean[k])).sum::<f64>().sqrt();
    1.1 * centres.iter().map(distance).fold(0.0, f64::max)
}

/// A scene as rows of parameters: mean, SH coefficients, opacity logit, log-scales, quaternion.
pub(crate) struct Recovery {
    pub(crate) scene: Scene,
    rows: Vec<f32>,
    pub(crate) moments: Moments,
    rates: Vec<f32>,
    /// Steps of the round.
    pub(crate) steps: u64,
    pub(crate) done: u64,
}

impl Recovery {
    /// A round of `steps` steps on `scene`.
    pub(crate) fn new(scene: Scene, extent: f64, steps: u64) -> Self {
        let k = 3 * scene.sh_len();
        let r = LearningRates::default();
        let mut rates = vec![MEAN_RATE * extent as f32; 3];
        rates.extend([r.sh_dc; 3]);
        rates.extend(vec![r.sh_rest; k - 3]);
        rates.push(r.opacity);
        rates.extend([r.log_scale; 3]);
        rates.extend([r.rotation; 4]);
        let stride = rates.len();
        let mut rows = vec![0.0; stride * scene.len()];
        rows.par_chunks_mut(stride).enumerate().for_each(|(i, row)| {
            row[..3].copy_from_slice(&scene.means[i]);
            row[3..3 + k].copy_from_slice(scene.sh_of(i).as_flattened());
            row[3 + k] = scene.opacity_logits[i];
            row[4 + k..7 + k].copy_from_slice(&scene.log_scales[i]);
            row[7 + k..].copy_from_slice(&scene.rotations[i]);
        });
        let moments = Moments::zeros(rows.len());
        Self { scene, rows, moments, rates, steps, done: 0 }
    }

    /// One step at a view.
    pub(crate) fn step(&mut self, views: &mut ViewGradients, view: usize) -> finetune::ViewLoss {
        let loss = views.run(&self.scene, view);
        self.done += 1;
        let share = (self.done - 1) as f64 / self.steps.saturating_sub(1).max(1) as f64;
        let decay = libm::pow(FINAL_RATE, share) as f32;
        let rates: Vec<f32> = self.rates.iter().map(|r| r * decay).collect();
        let (scene, views) = (&self.scene, &*views);
        let k = 3 * scene.sh_len();
        let gradient = |i: usize, row: &mut [f32]| {
            let Some(g) = views.of(scene, i) else { return };
            row[..3].copy_from_slice(&g.mean);
            row[3..3 + k].copy_from_slice(&g.sh.as_flattened()[..k]);
            row[3 + k] = g.opacity_logit;
            row[4 + k..7 + k].copy_from_slice(&g.log_scale);
            row[7 + k..].copy_from_slice(&g.rotation);
        };
        self.moments.step(Adam::new(self.done), &rates, &mut self.rows, gradient, |_| ());
        self.rebuild();
        loss
    }

    /// Puts the rows into the scene.
    fn rebuild(&mut self) {
        let (rows, stride, k) = (&self.rows, self.rates.len(), self.scene.sh_len());
        let row = |i: usize| &rows[i * stride..(i + 1) * stride];
        let Scene { means, rotations, log_scales, opacity_logits, sh, .. } = &mut self.scene;
        fn copy<const N: usize>(from: &[f32], to: &mut [f32; N]) {
            to.copy_from_slice(&from[..N]);
        }
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
