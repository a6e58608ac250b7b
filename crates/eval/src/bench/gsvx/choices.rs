//! What each way of coding covariances costs at equal rendered error.
//!
//! Only the covariances are replaced by their decoded version, so that the rendered error is theirs;
//! PSNR is against renders of the voxelized model, over a few held-out views.

use anyhow::{Context, Result};
use finetune::{Image, RenderOptions, metrics, render};
use gs_model::{Camera, Scene};
use gsvx::{CovarianceMode, EncodeOptions, Prepared};

use crate::scenes;

/// Quality of the voxelization; steps are then varied around those of this quality.
const QUALITY: f32 = 60.0;
/// Views that are rendered.
const VIEWS: usize = 6;
/// Rendered error at which the choices are compared, dB from the voxelized model's renders.
const EQUAL_AT: [f64; 5] = [34.0, 38.0, 42.0, 46.0, 50.0];
/// A step at which every coordinate of a covariance is coded as 0.
const NOTHING: f32 = 1e6;

struct Study {
    prepared: Prepared,
    /// How much the training views change with each covariance.
    sensitivity: Vec<f32>,
    views: Vec<(Camera, Image)>,
    /// Bytes of a stream whose covariances are all zeros.
    rest: usize,
}

/// Measures the choices on each scene and prints tables.
pub(super) fn run(names: &[String]) -> Result<()> {
    for name in names {
        let study = Study::new(name)?;
        println!("\n{name}: {} Gaussians after voxelization\n", study.prepared.scene.len());
        let head: Vec<String> = EQUAL_AT.iter().map(|db| format!("bytes at {db} dB")).collect();
        println!(
            "| covariance coded as | {} |\n|---|{}",
            head.join(" | "),
            "---:|".repeat(EQUAL_AT.len())
        );
        study.covariance()?;
    }
    Ok(())
}

impl Study {
    fn new(name: &str) -> Result<Self> {
        let found = scenes::find(name)?;
        let (scene, _) = gs_model::ply::read(&found.dataset.model_path)?;
        let training: Vec<Camera> = found.dataset.training().map(|v| v.camera.clone()).collect();
        let seen = finetune::saliency_per_view(&scene, &training).squared;
        let mut options = EncodeOptions::from_quality(QUALITY)?;
        options.importance = Some(seen);
        options.drop_unseen = true;
        let prepared = gsvx::prepare(&scene, &options)?;
        let held: Vec<&Camera> = found.dataset.held_out().map(|v| &v.camera).collect();
        let every = held.len().div_ceil(VIEWS).max(1);
        let views = held
            .into_iter()
            .step_by(every)
            .map(|c| (c.clone(), render(&prepared.scene, c, &RenderOptions::default())))
            .collect();
        let sensitivity = finetune::covariance_sensitivity(&prepared.scene, &training);
        let mut study = Self { prepared, sensitivity, views, rest: 0 };
        let mut options = study.options()?;
        options.steps.covariance = NOTHING;
        study.rest = study.encode(&options)?.len();
        Ok(study)
    }

    fn encode(&self, options: &EncodeOptions) -> Result<Vec<u8>> {
        let Prepared { scene, voxels, .. } = &self.prepared;
        Ok(gsvx::encode_voxels(scene, voxels, None, options)?.bytes)
    }

    fn psnr(&self, scene: &Scene) -> f64 {
        let of = |(camera, image): &(Camera, Image)| {
            metrics::psnr(&render(scene, camera, &RenderOptions::default()), image)
        };
        self.views.iter().map(of).sum::<f64>() / self.views.len() as f64
    }

    /// Without higher SH degrees, which only cost time.
    fn options(&self) -> Result<EncodeOptions> {
        let mut options = EncodeOptions::from_quality(QUALITY)?;
        options.importance = Some(self.prepared.importance.clone());
        options.max_sh_degree = 0;
        Ok(options)
    }

    /// PSNR with the covariances replaced, and the bytes that they take, at several factors of the step.
    fn curve(
        &self,
        factors: &[f32],
        choose: impl Fn(&mut EncodeOptions),
    ) -> Result<Vec<(f64, f64)>> {
        let mut points = Vec::new();
        for &factor in factors {
            let mut options = self.options()?;
            options.steps.covariance *= factor;
            choose(&mut options);
            let bytes = self.encode(&options)?;
            let decoded = gsvx::decode(&bytes)?;
            let mut mixed = self.prepared.scene.clone();
            mixed.rotations = decoded.rotations;
            mixed.log_scales = decoded.log_scales;
            points.push((self.psnr(&mixed), bytes.len() as f64 - self.rest as f64));
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(points)
    }

    fn covariance(&self) -> Result<()> {
        let steps = [0.25, 0.4, 0.7, 1.2, 2.0, 3.4, 5.0];
        row("transform", &self.curve(&steps, |_| ())?);
        let guess = gsvx::importance::without_cameras(&self.prepared.scene);
        for (of, sensitivity) in [
            ("derivatives of covariance", &self.sensitivity),
            ("blending weights", &self.prepared.importance),
            ("opacity and size", &guess),
        ] {
            for bits in [8, 10, 12, 14] {
                let points = self.curve(&[0.15, 0.4, 1.0, 2.5], |o| {
                    o.covariance = CovarianceMode::Vq { bits };
                    o.covariance_sensitivity = Some(sensitivity.clone());
                })?;
                row(&format!("codebook of 2^{bits}, by {of}"), &points);
                let best = points.last().context("no points")?;
                println!("| (its best: {:.2} dB in {:.0}) | | | | | |", best.0, best.1);
            }
        }
        for bits in [8u8, 10, 12, 16] {
            let points =
                self.curve(&[1.0], |o| o.covariance = CovarianceMode::Lossless { bits })?;
            let (db, bytes) = points[0];
            println!("| (integers of {bits} bits: {db:.2} dB in {bytes:.0}) | | | | | |");
        }
        Ok(())
    }
}

/// One row: bytes at equal error, by interpolating the logarithm of the size over dB.
fn row(what: &str, points: &[(f64, f64)]) {
    let cells: Vec<String> = EQUAL_AT
        .iter()
        .map(|&db| bytes_at(points, db).map_or("out of reach".into(), |b| format!("{b:.0}")))
        .collect();
    println!("| {what} | {} |", cells.join(" | "));
}

/// `points` ascend in dB.
fn bytes_at(points: &[(f64, f64)], db: f64) -> Option<f64> {
    points.windows(2).find(|w| w[0].0 <= db && db <= w[1].0).map(|w| {
        let t = (db - w[0].0) / (w[1].0 - w[0].0).max(1e-9);
        libm::exp(libm::log(w[0].1) * (1.0 - t) + libm::log(w[1].1) * t)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_interpolated_in_their_logarithm() {
        let points = [(30.0, 100.0), (40.0, 400.0)];
        assert!((bytes_at(&points, 35.0).unwrap() - 200.0).abs() < 1e-6);
        assert_eq!(bytes_at(&points, 41.0), None);
    }
}
