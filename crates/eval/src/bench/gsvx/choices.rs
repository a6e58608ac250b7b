//! What each way of coding one attribute costs at equal rendered error.
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
const EQUAL_AT: [f64; 5] = [34.0, 38.0, 42.0, 46.0, 50.0];

struct Study {
    prepared: Prepared,
    /// How much the training views change with each covariance.
    sensitivity: Vec<f32>,
    views: Vec<(Camera, Image)>,
}

/// Measures the choices on each scene and prints tables.
pub(super) fn run(names: &[String]) -> Result<()> {
    for name in names {
        let study = Study::new(name)?;
        println!("\n{name}: {} Gaussians after voxelization\n", study.prepared.scene.len());
        let head: Vec<String> = EQUAL_AT.iter().map(|db| format!("bytes at {db} dB")).collect();
        println!(
            "| attribute | coded as | {} |\n|---|---|{}",
            head.join(" | "),
            "---:|".repeat(EQUAL_AT.len())
        );
        study.covariance()?;
        study.opacity()?;
        println!(
            "\n| quality | stream as it is, bytes | AC sections | KLT per plane | KLT of all planes | AC without what is below half a step |\n|---:|---:|---:|---:|---:|---:|"
        );
        study.ac()?;
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
        let sensitivity = finetune::covariance_sensitivity(&prepared.scene, &training);
        Ok(Self { prepared, sensitivity, views })
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
        let steps = [0.25, 0.4, 0.7, 1.2, 2.0, 3.4, 5.0];
        let transform = self.curve(kind, &steps, |o, f| o.steps.covariance *= f, replace)?;
        row("covariance", "transform", &transform);
        let guess = gsvx::importance::without_cameras(&self.prepared.scene);
        for (of, sensitivity) in [
            ("derivatives of covariance", &self.sensitivity),
            ("blending weights", &self.prepared.importance),
            ("opacity and size", &guess),
        ] {
            for bits in [8, 10, 12, 14] {
                let points = self.curve(
                    kind,
                    &[0.15, 0.4, 1.0, 2.5],
                    |o, f| {
                        o.covariance = CovarianceMode::Vq { bits };
                        o.covariance_sensitivity = Some(sensitivity.clone());
                        o.steps.covariance *= f;
                    },
                    replace,
                )?;
                row("", &format!("codebook of 2^{bits}, by {of}"), &points);
                let best = points.last().context("no points")?;
                println!("| | (its best: {:.2} dB in {:.0}) | | | | | |", best.0, best.1);
            }
        }
        for bits in [8u8, 10, 12, 16] {
            let points = self.curve(
                kind,
                &[1.0],
                |o, _| o.covariance = CovarianceMode::Lossless { bits },
                replace,
            )?;
            let (db, bytes) = points[0];
            println!("| | (integers of {bits} bits: {db:.2} dB in {bytes:.0}) | | | | | |");
        }
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
                &[0.35, 0.7, 1.4, 2.8, 5.6, 11.2],
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

    /// Prints the bytes of the AC sections, and how they change by three alternatives: a KLT (the
    /// eigenvectors of the covariance of the coefficients) of each colour plane, a KLT of all planes
    /// together, and zeros for the SH degrees of Gaussians that are below half a step throughout.
    ///
    /// The KLTs are orthonormal and the steps are the same, so the error is the same. Their matrices
    /// are not counted. The zeros are the most that an SH degree per Gaussian could save; the cost of
    /// coding that degree is not counted either.
    fn ac(&self) -> Result<()> {
        if self.prepared.scene.sh_degree < 3 {
            return Ok(());
        }
        let per_plane: Vec<Vec<usize>> =
            (0..3).map(|p| (0..15).map(|c| 3 * c + p).collect()).collect();
        let per_plane = self.rotated(&per_plane);
        let all = self.rotated(&[(0..45).collect()]);
        for quality in [40.0, 50.0, 60.0, 75.0, 90.0] {
            let steps = EncodeOptions::from_quality(quality)?.steps;
            let o = EncodeOptions { steps, sh_prediction: false, ..self.options()? };
            let bytes = |scene: &Scene, o: &EncodeOptions| -> Result<[usize; 2]> {
                let encoded = gsvx::encode(scene, &self.prepared.voxels, o)?;
                let ac = [SectionKind::Sh1, SectionKind::Sh2, SectionKind::Sh3];
                let ac = encoded.sections.iter().filter(|(k, _)| ac.contains(k)).map(|(_, n)| *n);
                Ok([encoded.bytes.len(), ac.sum()])
            };
            let scene = &self.prepared.scene;
            let [whole, plain] = bytes(scene, &o)?;
            let percent = |scene: &Scene, o: &EncodeOptions| -> Result<String> {
                let ac = bytes(scene, o)?[1];
                Ok(format!("{:+.2} %", 100.0 * (ac as f64 / plain as f64 - 1.0)))
            };
            println!(
                "| {quality} | {whole} | {plain} | {} | {} | {} |",
                percent(&per_plane, &o)?,
                percent(&all, &o)?,
                percent(&self.without_small(steps.sh[0]), &o)?,
            );
        }
        Ok(())
    }

    /// The scene without the SH degrees of Gaussians that are below half their step throughout.
    fn without_small(&self, step: f32) -> Scene {
        let mut out = self.prepared.scene.clone();
        let classes = gsvx::importance::log_classes(&self.prepared.importance);
        let k = out.sh_len();
        for (sh, class) in out.sh.chunks_exact_mut(k).zip(classes) {
            let own = f64::from(step) * libm::exp2(f64::from(gsvx::importance::MEAN_CLASS) - class);
            for degree in [1..4, 4..9, 9..16] {
                let small = |c: &[f32; 3]| colour::forward(*c).iter().all(|v| v.abs() < 0.5 * own);
                if sh[degree.clone()].iter().all(small) {
                    sh[degree].fill([0.0; 3]);
                }
            }
        }
        out
    }

    /// The scene with its AC channels (three planes per coefficient) rotated, block by block, into
    /// the basis of the eigenvectors of their covariance, greatest first.
    fn rotated(&self, blocks: &[Vec<usize>]) -> Scene {
        let scene = &self.prepared.scene;
        let k = scene.sh_len();
        let classes = gsvx::importance::log_classes(&self.prepared.importance);
        let channels = |i: usize| -> Vec<f64> {
            scene.sh_of(i)[1..].iter().flat_map(|&c| colour::forward(c)).collect()
        };
        let exact: Vec<Vec<f64>> = (0..scene.len()).map(channels).collect();
        let mut turned = exact.clone();
        for block in blocks {
            let n = block.len();
            let mut c = DMatrix::<f64>::zeros(n, n);
            for (v, class) in exact.iter().zip(&classes) {
                let w = libm::exp2(2.0 * class);
                for a in 0..n {
                    for b in 0..n {
                        c[(a, b)] += w * v[block[a]] * v[block[b]];
                    }
                }
            }
            let eigen = c.symmetric_eigen();
            let mut order: Vec<usize> = (0..n).collect();
            order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
            for (v, out) in exact.iter().zip(&mut turned) {
                for (j, &vector) in order.iter().enumerate() {
                    let along = |a: usize| eigen.eigenvectors[(a, vector)] * v[block[a]];
                    out[block[j]] = (0..n).map(along).sum();
                }
            }
        }
        let mut out = scene.clone();
        for (sh, v) in out.sh.chunks_exact_mut(k).zip(&turned) {
            for (rgb, c) in sh[1..].iter_mut().zip(v.chunks_exact(3)) {
                *rgb = colour::inverse([c[0], c[1], c[2]]);
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
