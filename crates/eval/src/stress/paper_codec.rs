//! The paper's codec with its codebook, RAHT and RLGR, and W2 barycenters, against their definitions in double precision.

use anyhow::{Result, anyhow, ensure};
use gpcc_lite::paper::rlgr;
use gs_model::Scene;
use gs_model::math::{Symmetric, axes_product, eigen_of, rotation};
use nalgebra::Matrix3;
use paper::{CovarianceCoding, PaperOptions, Qp, Strategy};
use voxel::w2::{Barycenter, Gaussian, barycenter};

use super::outcome::{ChainOutcome, by};
use crate::attributes::colour_planes;

/// Greatest error of a coefficient, in steps: a level is the magnitude plus a third, rounded down.
const COEFFICIENT: f64 = 2.0 / 3.0;
/// The step of the logarithms of the scale factors.
const FACTOR_STEP: f64 = 0.145;
/// Codewords of a codebook, binary logarithm: few, so that most are far from their covariances.
const BITS: u8 = 5;
/// Codewords hold log-scales in 32nds: half of that shifts a size, twice that the difference of two distances.
const ROUNDED: f64 = 1.0 / 64.0;
/// A barycenter is a fixed point up to this, of its greatest entry, or to the last change where it has not converged.
const FIXED_POINT: f64 = 1e-6;

/// The scene through the paper's codec, in a mode that names the QP.
pub(super) fn run(scene: &Scene, mode: &str) -> Result<ChainOutcome> {
    let lossless = mode.ends_with("lossless covariances");
    let qp = mode.split("QP ").nth(1).and_then(|rest| rest.split(',').next());
    let qp: u8 = qp.ok_or_else(|| anyhow!("{mode} names no QP"))?.parse()?;
    let covariance = match lossless {
        true => CovarianceCoding::Lossless,
        false => CovarianceCoding::Lossy { codebook_bits: BITS },
    };
    let options = PaperOptions { qp: Qp { ac: qp, dc: qp, opacity: qp }, covariance };
    let coded = || {
        let of = paper::voxelize(scene, &Strategy::paper(4, 9)).map_err(by("voxelize"))?;
        let stream = paper::encode(&of.scene, of.voxels.octree(), None, &options);
        Ok((stream.map_err(by("encode"))?, of))
    };
    let (stream, of) = match coded() {
        Ok(coded) => coded,
        Err(refused) => return Ok(Err(refused)),
    };
    let back = paper::decode(&stream.bytes)?;
    back.validate().map_err(|e| anyhow!("the paper's decoder returned {e}"))?;
    ensure!(back.means == of.scene.means, "decoded means are not those of the voxels");
    let levels = |scene: &Scene| -> Vec<i32> {
        scene.sh.as_flattened().iter().map(|v| (v.to_bits() >> 6) as i32 - (1 << 24)).collect()
    };
    let levels = levels(&of.scene);
    ensure!(rlgr::decode(&rlgr::encode(&levels), levels.len())? == levels, "RLGR changed a level");
    let path = 3.0 * f64::from(of.voxels.octree().depth()) + 1.0;
    let mut worst = attributes(&of.scene, &back, qp, path);
    let covariances =
        if lossless { integers(&of.scene, &back) } else { codewords(&of.scene, &back, path) };
    worst.push(("covariance of the paper's codec", covariances));
    Ok(Ok(worst))
}

/// The worst error over its bound, and the root mean square over its bound, of values coded by RAHT in a step.
fn by_raht(was: &[f64], is: &[f64], step: f64, path: f64) -> f64 {
    let n = was.len().max(1) as f64;
    let size = was.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    // Sums of a tree, and the rounding of what is decoded to single precision.
    let error = |(a, b): (&f64, &f64)| ((a - b).abs() - 2e-6 * size - 1e-30).max(0.0);
    let errors: Vec<f64> = was.iter().zip(is).map(error).collect();
    let most = errors.iter().fold(0.0f64, |most, v| most.max(*v));
    let square = errors.iter().map(|v| v * v).sum::<f64>() / n;
    (most / path.min(n.sqrt())).max(square.sqrt()) / (COEFFICIENT * step)
}

/// The step of a QP: of 255ths of the range of the values, and at least what levels of 31 bits hold.
fn step(qp: u8, values: &[f64]) -> f64 {
    let end = |pick: fn(f64, f64) -> f64| values.iter().copied().reduce(pick).unwrap_or(0.0);
    let (low, high) = (end(f64::min), end(f64::max));
    let range = if high > low { high - low } else { 1.0 };
    let least = low.abs().max(high.abs()) * (values.len() as f64).sqrt() / f64::from(1 << 30);
    (range / 255.0 * libm::exp2((f64::from(qp) - 4.0) / 6.0)).max(least)
}

/// Opacity and SH coefficients.
fn attributes(was: &Scene, is: &Scene, qp: u8, path: f64) -> Vec<(&'static str, f64)> {
    let ratio = |value: &dyn Fn(&Scene, usize) -> f64| {
        let of = |scene: &Scene| (0..scene.len()).map(|i| value(scene, i)).collect::<Vec<f64>>();
        let values = of(was);
        by_raht(&values, &of(is), step(qp, &values), path)
    };
    let opacity = ratio(&|s, i| f64::from(s.opacity_logits[i]).clamp(-8.0, 12.0));
    let sh = (0..3 * was.sh_len()).map(|c| ratio(&|s, i| colour_planes(s.sh_of(i)[c / 3])[c % 3]));
    vec![
        ("opacity of the paper's codec", opacity),
        ("SH of the paper's codec", sh.fold(0.0, f64::max)),
    ]
}

/// Quaternions and log-scales as integers of 16 bits: at most half a step off, and the rounding of floats.
fn integers(was: &Scene, is: &Scene) -> f64 {
    let ratio = |was: &[f32], is: &[f32]| {
        let end = |pick: fn(f32, f32) -> f32| was.iter().copied().reduce(pick).unwrap_or(0.0);
        let (low, high) = (f64::from(end(f32::min)), f64::from(end(f32::max)));
        let bound = (high - low) / 131_070.0 + 1e-6 * low.abs().max(high.abs()) + 1e-30;
        let errors = was.iter().zip(is).map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs());
        errors.fold(0.0, f64::max) / bound
    };
    let scales = ratio(was.log_scales.as_flattened(), is.log_scales.as_flattened());
    scales.max(ratio(was.rotations.as_flattened(), is.rotations.as_flattened()))
}

/// The logarithm of the size of a Gaussian, and the square root of its covariance without it.
fn size_and_shape(scene: &Scene, i: usize) -> (f64, Symmetric) {
    let l = scene.log_scales[i].map(f64::from);
    let largest = l.into_iter().fold(f64::MIN, f64::max);
    let size = largest + 0.5 * libm::log(l.map(|l| libm::exp(2.0 * (l - largest))).iter().sum());
    (size, axes_product(&rotation(scene.rotations[i]), l.map(|l| libm::exp(l - size))))
}

/// Of all codewords in use none is nearer to a Gaussian than its own, and sizes are those of RAHT.
fn codewords(was: &Scene, is: &Scene, path: f64) -> f64 {
    let of = |scene: &Scene| -> (Vec<f64>, Vec<Symmetric>) {
        (0..scene.len()).map(|i| size_and_shape(scene, i)).unzip()
    };
    let ((sizes, shapes), (found, own)) = (of(was), of(is));
    let mut book = own.clone();
    book.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    book.dedup_by(|a, b| (0..6).all(|k| (a[k] - b[k]).abs() < 1e-7));
    let distance = |a: &Symmetric, b: &Symmetric| {
        let twice = |k: usize| if k < 3 { 1.0 } else { 2.0 };
        (0..6).map(|k| twice(k) * (a[k] - b[k]) * (a[k] - b[k])).sum::<f64>().sqrt()
    };
    let too_far = |(shape, own): (&Symmetric, &Symmetric)| {
        let nearest = book.iter().map(|word| distance(shape, word)).fold(f64::MAX, f64::min);
        (distance(shape, own) - nearest) / (2.0 * ROUNDED)
    };
    let far = shapes.iter().zip(&own).map(too_far).fold(0.0, f64::max);
    let off = |(a, b): (&f64, &f64)| b - (b - a).clamp(-ROUNDED, ROUNDED);
    let found: Vec<f64> = sizes.iter().zip(&found).map(off).collect();
    far.max(by_raht(&sizes, &found, FACTOR_STEP, path))
}

/// Barycenters of the Gaussians of each cell of a coarse octree are fixed points of the paper's equation 5, with weights.
pub(super) fn barycenters(scene: &Scene) -> Result<ChainOutcome> {
    let of = match paper::voxelize(scene, &Strategy::Uniform { depth: 4 }) {
        Ok(of) => of,
        Err(refused) => return Ok(Err(by("voxelize")(refused))),
    };
    let mut worst = 0.0f64;
    for leaf in 0..of.voxels.len() {
        let members = of.voxels.members_of(leaf);
        let all: Vec<Gaussian> =
            members.iter().map(|&i| Gaussian::of_scene(scene, i as usize)).collect();
        let Barycenter { gaussian: found, residual, .. } = barycenter(&all, &vec![1.0; all.len()]);
        let n = all.len() as f64;
        for k in 0..3 {
            let (mean, most) = all.iter().fold((0.0, 0.0f64), |(sum, most), g| {
                (sum + g.mean[k] / n, most.max(g.mean[k].abs()))
            });
            worst = worst.max((found.mean[k] - mean).abs() / (1e-12 * most + 1e-300));
        }
        let s = found.covariance;
        let size = s.amax();
        if size == 0.0 || !size.is_finite() {
            ensure!(all.iter().all(|g| g.covariance.amax() == 0.0), "a barycenter of no size");
            continue;
        }
        let half = root(&(s / size));
        let crossed = |g: &Gaussian| root(&(half * (g.covariance / size) * half)) / n;
        let sum: Matrix3<f64> = all.iter().map(crossed).sum();
        worst = worst.max((sum - s / size).amax() / residual.max(FIXED_POINT));
    }
    Ok(Ok(vec![("W2 barycenter", worst)]))
}

/// The square root of a positive semi-definite matrix.
fn root(m: &Matrix3<f64>) -> Matrix3<f64> {
    let mean = |i, j| 0.5 * (m[(i, j)] + m[(j, i)]);
    let upper = [m[(0, 0)], m[(1, 1)], m[(2, 2)], mean(0, 1), mean(0, 2), mean(1, 2)];
    let (variances, axes) = eigen_of(&upper);
    let [xx, yy, zz, xy, xz, yz] = axes_product(&axes, variances.map(|v| v.max(0.0).sqrt()));
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}
