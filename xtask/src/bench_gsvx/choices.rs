//! `bench-gsvx --choices`: what each way of coding one attribute costs at equal rendered error.
//!
//! Only the attribute in question is replaced by its decoded version, so that its rendered error is
//! its own; PSNR is against renders of the voxelized model, over a few held-out views.

use anyhow::{Context, Result};
use finetune::{Image, RenderOptions, metrics, render};
use gs_model::{Camera, Scene};
use gsvx::attributes::colour;
use gsvx::stream::SectionKind;
use gsvx::{CovarianceMode, EncodeOptions, OpacityDomain, Prepared};
use nalgebra::DMatrix;

use crate::scenes;

/// Quality of the voxelization; steps are then varied around those of this quality.
const QUALITY: f32 = 60.0;
/// Views that are rendered.
const VIEWS: usize = 6;
/// Rendered error at which the choices are compared, dB from the voxelized model's renders.
const EQUAL_AT: [f64; 3] = [38.0, 42.0, 46.0];

struct Study {
    prepared: Prepared,
    views: Vec<(Camera, Image)>,
}

/// Measures the choices on each scene and prints tables.
pub(super) fn run(names: &[String]) -> Result<()> {
    for name in names {
        let study = Study::new(name)?;
        println!("\n{name}: {} Gaussians after voxelization\n", study.prepared.scene.len());
        let head: Vec<String> = EQUAL_AT.iter().map(|db| format!("bytes at {db} dB")).collect();
        println!("| attribute | coded as | {} |\n|---|---|{}", head.join(" | "), "---:|".repeat(3));
        study.covariance()?;
        study.opacity()?;
        study.klt()?;
    }
    Ok(())
}

impl Study {
    fn new(name: &str) -> Result<Self> {
        let found = scenes::find(name)?;
        let (scene, _) = gs_model::ply::read(&found.dataset.model_path)?;
        let training: Vec<Camera> = found.dataset.training().map(|v| v.camera.clone()).collect();
        let seen = finetune::saliency_per_view(&scene, &training).squared;
        let strategy = |importance: &[f32], seen| gsvx::default_strategy(QUALITY, importance, seen);
        let prepared = gsvx::prepare(&scene, strategy, Some(&seen))?;
        let held: Vec<&Camera> = found.dataset.held_out().map(|v| &v.camera).collect();
        let every = held.len().div_ceil(VIEWS).max(1);
        let views = held
            .into_iter()
            .step_by(every)
            .map(|c| (c.clone(), render(&prepared.scene, c, &RenderOptions::default())))
            .collect();
        Ok(Self { prepared, views })
    }

    fn psnr(&self, scene: &Scene) -> f64 {
        let of = |(camera, image): &(Camera, Image)| {
            metrics::psnr(&render(scene, camera, &RenderOptions::default()), image)
        };
        self.views.iter().map(of).sum::<f64>() / self.views.len() as f64
    }

    fn options(&self) -> Result<EncodeOptions> {
        let importance = Some(self.prepared.importance.clone());
        Ok(EncodeOptions { importance, ..EncodeOptions::from_quality(QUALITY)? })
    }

    /// Bytes of the section and PSNR with its attribute replaced, at several steps.
    fn curve(
        &self,
        kind: SectionKind,
        factors: &[f32],
        options: impl Fn(&mut EncodeOptions, f32),
        replace: impl Fn(&mut Scene, &Scene),
    ) -> Result<Vec<(f64, f64)>> {
        let mut points = Vec::new();
        for &factor in factors {
            let mut o = self.options()?;
            // The other sections only cost time.
            o.max_sh_degree = 0;
            options(&mut o, factor);
            let encoded = gsvx::encode(&self.prepared.scene, &self.prepared.voxels, &o)?;
            let decoded = gsvx::decode(&encoded.bytes, &Default::default())?.scene;
            let mut mixed = self.prepared.scene.clone();
            replace(&mut mixed, &decoded);
            let bytes = encoded.sections.iter().find(|(k, _)| *k == kind).map_or(0, |(_, n)| *n);
            points.push((self.psnr(&mixed), bytes as f64));
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(points)
    }

    fn covariance(&self) -> Result<()> {
        let replace = |mixed: &mut Scene, decoded: &Scene| {
            mixed.rotations.clone_from(&decoded.rotations);
            mixed.log_scales.clone_from(&decoded.log_scales);
        };
        let kind = SectionKind::Covariance;
        let steps = [0.35, 0.6, 1.0, 1.7, 3.0];
        let transform = self.curve(kind, &steps, |o, f| o.steps.covariance *= f, replace)?;
        row("covariance", "transform", &transform);
        for bits in [10, 12, 14, 16] {
            let points = self.curve(
                kind,
                &[0.15, 0.35, 1.0],
                |o, f| {
                    o.covariance = CovarianceMode::Vq { bits };
                    o.steps.covariance *= f;
                },
                replace,
            )?;
            row("", &format!("codebook of 2^{bits}"), &points);
            let best = points.last().context("no points")?;
            println!("| | (its best: {:.2} dB in {:.0} bytes) | | | |", best.0, best.1);
        }
        let points = self.curve(
            kind,
            &[8.0, 10.0, 12.0, 16.0],
            |o, bits| o.covariance = CovarianceMode::Lossless { bits: bits as u8 },
            replace,
        )?;
        row("", "integers of 8 to 16 bits", &points);
        Ok(())
    }

    fn opacity(&self) -> Result<()> {
        for (domain, what, scale) in [
            (OpacityDomain::LogAlpha, "ln(alpha)", 1.0),
            (OpacityDomain::Logit, "logit", 2.0),
            (OpacityDomain::Alpha, "alpha", 0.5),
        ] {
            let points = self.curve(
                SectionKind::Opacity,
                &[0.35, 0.7, 1.4, 2.8, 5.6],
                |o, f| {
                    o.opacity_domain = domain;
                    o.steps.opacity *= f * scale;
                },
                |mixed, decoded| mixed.opacity_logits.clone_from(&decoded.opacity_logits),
            )?;
            row("opacity", what, &points);
        }
        Ok(())
    }

    /// Bytes of the AC sections with the coefficients as they are, and turned by the eigenvectors of
    /// their covariance (per plane, over all degrees; the matrices, 2.7 kB as f32, not counted). The
    /// turn is orthonormal and the step the same, so the error is too.
    fn klt(&self) -> Result<()> {
        if self.prepared.scene.sh_degree == 0 {
            return Ok(());
        }
        let turned = self.turned();
        for quality in [40.0, 60.0, 80.0] {
            let o = EncodeOptions {
                steps: EncodeOptions::from_quality(quality)?.steps,
                ..self.options()?
            };
            let bytes = |scene: &Scene| -> Result<usize> {
                let encoded = gsvx::encode(scene, &self.prepared.voxels, &o)?;
                let ac = [SectionKind::Sh1, SectionKind::Sh2, SectionKind::Sh3];
                Ok(encoded.sections.iter().filter(|(k, _)| ac.contains(k)).map(|(_, n)| *n).sum())
            };
            let (plain, klt) = (bytes(&self.prepared.scene)?, bytes(&turned)?);
            println!(
                "| AC, steps of quality {quality} | as they are {plain}, KLT {klt}: {:+.2} % | | | |",
                100.0 * (klt as f64 / plain as f64 - 1.0)
            );
        }
        Ok(())
    }

    /// The scene with its AC coefficients in the basis of their eigenvectors, greatest first.
    fn turned(&self) -> Scene {
        let (scene, weights) = (&self.prepared.scene, &self.prepared.importance);
        let k = scene.sh_len() - 1;
        let ycc = |i: usize| -> Vec<[f64; 3]> {
            scene.sh_of(i)[1..].iter().map(|&c| colour::forward(c)).collect()
        };
        let mut bases = Vec::new();
        for plane in 0..3 {
            let mut c = DMatrix::<f64>::zeros(k, k);
            for (i, &w) in weights.iter().enumerate() {
                let v = ycc(i);
                for a in 0..k {
                    for b in 0..k {
                        c[(a, b)] += f64::from(w) * v[a][plane] * v[b][plane];
                    }
                }
            }
            let eigen = c.symmetric_eigen();
            let mut order: Vec<usize> = (0..k).collect();
            order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
            bases.push(DMatrix::from_fn(k, k, |r, c| eigen.eigenvectors[(r, order[c])]));
        }
        let mut out = scene.clone();
        for i in 0..scene.len() {
            let v = ycc(i);
            for j in 0..k {
                let turned = std::array::from_fn(|p| {
                    (0..k).map(|a| bases[p][(a, j)] * v[a][p]).sum::<f64>()
                });
                out.sh[i * (k + 1) + 1 + j] = colour::inverse(turned);
            }
        }
        out
    }
}

/// One row: bytes at equal error, by interpolating the logarithm of the size over dB.
fn row(attribute: &str, what: &str, points: &[(f64, f64)]) {
    let cells: Vec<String> = EQUAL_AT
        .iter()
        .map(|&db| bytes_at(points, db).map_or("out of reach".into(), |b| format!("{b:.0}")))
        .collect();
    println!("| {attribute} | {what} | {} |", cells.join(" | "));
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
