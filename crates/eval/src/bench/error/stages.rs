//! Stages of the codec and of the rasterizer, against f64.

use anyhow::Result;
use finetune::{Image, Profile, RenderOptions};
use gpcc_lite::attribute::{self, Quantisation};
use gpcc_lite::coder::RansEncoder;
use gpcc_lite::raht::{self, RahtPlan, Rows};
use gs_model::Scene;
use nalgebra::{Matrix3, Quaternion, SymmetricEigen, UnitQuaternion, Vector3};
use paper::{CovarianceCoding, PaperOptions, Qp};
use voxel::{Merge, RateDistortion, Strategy, w2};

use super::{Family, small};
use crate::exact::{self, Cuts};
use crate::measure;
use crate::process::timed;
use crate::rd_curve::plan::{self, criteria};
use crate::study::Study;

/// Runs of which the fastest counts.
pub(super) const RUNS: usize = 3;
/// Pixels of the view that the rasterizer draws.
const PIXELS: u32 = 300_000;

pub(super) fn families(study: &Study) -> Result<Vec<Family>> {
    let scene = &study.test.model;
    let depth = plan::depth(study, None)?;
    let voxelized = paper::voxelize(scene, &Strategy::Uniform { depth })?;
    let plan = RahtPlan::new(voxelized.voxels.octree().clone());
    Ok(vec![
        rasterizer(study),
        transforms(&voxelized.scene, &plan)?,
        voxelizations(study, depth)?,
        covariances(&voxelized.scene, &plan)?,
    ])
}

/// The result of the last run, and the seconds of the fastest.
fn best<T>(mut work: impl FnMut() -> T) -> (T, f64) {
    let mut done = timed(&mut work);
    for _ in 1..RUNS {
        let again = timed(&mut work);
        done = (again.0, again.1.min(done.1));
    }
    done
}

/// Root of the mean square of `a - b`.
fn rms(a: &[f32], b: &[f32]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
    (squares.sum::<f64>() / a.len() as f64).sqrt()
}

fn rasterizer(study: &Study) -> Family {
    let scene = &study.test.model;
    let camera = study.test.held_out[0].camera.within(PIXELS);
    let mut family = Family::new(
        "Rasterizer",
        format!(
            "A view of {}x{} pixels. The error is the root mean square of values of 0 to 1, against f64 with and without the cuts.",
            camera.width, camera.height
        ),
        "same cuts | no cuts",
    );
    let (all, slow) = timed(|| exact::render(scene, &camera, Cuts::NONE));
    let (cut, cut_slow) = timed(|| exact::render(scene, &camera, Cuts::INRIA));
    let mut add = |what: &str, (image, seconds): (Image, f64), buys: &str| {
        let [same, none] = [&cut, &all].map(|exact| rms(&image.rgb, &exact.rgb));
        family.row(what, seconds, none, &format!("{} | {}", small(same), small(none)), buys);
    };
    add("f64, no cuts, one thread", (all.clone(), slow), "the reference");
    let buys = "alpha from 1/255, transmittance from 1e-4";
    add("f64, cuts of 3DGS, one thread", (cut.clone(), cut_slow), buys);
    let inria = RenderOptions { profile: Profile::Reference, ..RenderOptions::default() };
    let buys = "f32, vectors, all cores, Inria's tiles";
    add("`Profile::Reference`", best(|| finetune::render(scene, &camera, &inria)), buys);
    let draw = |scene: &Scene| best(|| finetune::render(scene, &camera, &RenderOptions::default()));
    add("`finetune::render`", draw(scene), "only tiles that the ellipse reaches");
    for (degree, buys) in [(2, "no SH degree 3"), (1, "nor 2"), (0, "nor 1")] {
        let mut plain = scene.clone();
        plain.cut_sh(degree);
        add(&format!("the same, SH degree {degree}"), draw(&plain), buys);
    }
    family
}

fn transforms(scene: &Scene, plan: &RahtPlan) -> Result<Family> {
    let channels = 3 * scene.sh_len();
    let values = scene.sh.as_flattened();
    let value = |leaf: usize, c: usize| values[leaf * channels + c];
    let largest = values.iter().fold(0.0f64, |m, v| m.max(f64::from(v.abs())));
    let n = plan.len();
    let mut family = Family::new(
        "Transforms",
        format!(
            "The {channels} SH channels of {n} voxels, forward and back, one thread for f64. The error is the greatest, over the greatest value.",
        ),
        "error",
    );
    let most = |back: &dyn Fn(usize, usize) -> f64| {
        let all = (0..n).flat_map(|leaf| (0..channels).map(move |c| (leaf, c)));
        all.map(|(i, c)| (back(i, c) - f64::from(value(i, c))).abs()).fold(0.0, f64::max) / largest
    };
    let (double, seconds) = timed(|| -> Result<Vec<Vec<f64>>> {
        let one = |c: usize| -> Result<Vec<f64>> {
            let mut column: Vec<f64> = (0..n).map(|i| f64::from(value(i, c))).collect();
            plan.forward_f64(&mut column)?;
            plan.inverse_f64(&mut column)?;
            Ok(column)
        };
        (0..channels).map(one).collect()
    });
    let double = double?;
    let error = most(&|i, c| double[c][i]);
    family.row("RAHT in f64", seconds, error, &small(error), "the reference");
    let (rows, seconds) = best(|| -> Result<Rows> {
        let mut rows = Rows::new(n, channels);
        (0..n).for_each(|i| rows.row_mut(i).copy_from_slice(&values[i * channels..][..channels]));
        raht::forward(plan, &mut rows)?;
        raht::inverse(plan, &mut rows)?;
        Ok(rows)
    });
    let rows = rows?;
    let error = most(&|i, c| f64::from(rows.row(i)[c]));
    let buys = "as streams have it";
    family.row("RAHT in f32", seconds, error, &small(error), buys);
    Ok(family)
}

fn voxelizations(study: &Study, depth: u8) -> Result<Family> {
    let scene = &study.test.model;
    let cube = voxel::cube_of(&scene.means)?;
    let mut family = Family::new(
        "Voxelizations",
        "Merged by moments, one row by W2 barycenters. Equation 4 is relative to that of uniform J at its barycenters: at the barycenters (the error), and at the merged Gaussians. PSNR at the held-out photos.",
        "Gaussians | equation 4 | at the merged | PSNR, dB",
    );
    let strategies = [
        ("uniform, J", Strategy::Uniform { depth }, "like the original to 40 dB"),
        ("uniform, J-1", Strategy::Uniform { depth: depth - 1 }, "twice the side"),
        ("criteria, J-3 to J+5", criteria(depth), "depth by density, size and offset"),
        ("rate-distortion", like_uniform(scene, &cube, depth)?, "depth by loss over bits"),
    ];
    let mut uniform = f64::NAN;
    for (what, strategy, buys) in strategies {
        let (made, seconds) = best(|| -> Result<_> {
            let voxels = voxel::voxelize(scene, &cube, &strategy)?;
            Ok((voxel::merge(scene, &voxels, Merge::Moments)?, voxels))
        });
        let (merged, voxels) = made?;
        let distortion = w2::total_distortion(scene, &voxels);
        if what == "uniform, J" {
            uniform = distortion;
        }
        let error = distortion / uniform;
        let mut add = |what: &str, seconds, merged: &Scene, buys: &str| {
            let db = measure::psnr_db(merged, &study.test.held_out);
            let replaced = w2::replaced_distortion(scene, &voxels, merged) / uniform;
            let cells = format!("{} | {error:.2} | {replaced:.2} | {db:.2}", voxels.len());
            family.row(what, seconds, error, &cells, buys);
        };
        add(what, seconds, &merged, buys);
        if what == "uniform, J" {
            let (merged, more) = timed(|| barycenters(scene, &voxels, merged));
            add("the same, W2 barycenters", seconds + more, &merged, "the least equation 4");
        }
    }
    Ok(family)
}

/// The rate-distortion strategy that leaves about as many Gaussians as a uniform depth.
fn like_uniform(scene: &Scene, cube: &gpcc_lite::Cube, depth: u8) -> Result<Strategy> {
    let leaves = |strategy: &Strategy| -> Result<usize> {
        Ok(voxel::voxelize(scene, cube, strategy)?.len())
    };
    let wanted = leaves(&Strategy::Uniform { depth })?;
    let at = |log: f64| Strategy::RateDistortion(RateDistortion::unseen(libm::exp2(log)));
    let (mut low, mut high) = (-60.0, 20.0);
    for _ in 0..12 {
        let middle = 0.5 * (low + high);
        *(if leaves(&at(middle))? > wanted { &mut low } else { &mut high }) = middle;
    }
    Ok(at(high))
}

/// The scene of the leaves with the W2 barycenters of their members' covariances.
fn barycenters(scene: &Scene, voxels: &voxel::Voxelization, mut merged: Scene) -> Scene {
    for leaf in 0..voxels.len() {
        let members = voxels.members_of(leaf).iter();
        let members: Vec<_> = members.map(|&i| w2::Gaussian::of_scene(scene, i as usize)).collect();
        if members.len() > 1 {
            let centre = w2::barycenter(&members, &vec![1.0; members.len()]).gaussian;
            let eigen = SymmetricEigen::new(centre.covariance);
            set_covariance(
                &mut merged,
                leaf,
                &eigen.eigenvectors,
                eigen.eigenvalues.map(libm::log) / 2.0,
            );
        }
    }
    merged
}

/// Sets the axes of a Gaussian, in columns, and the logarithms of its standard deviations along them.
fn set_covariance(scene: &mut Scene, i: usize, axes: &Matrix3<f64>, log_scales: Vector3<f64>) {
    let axes = if axes.determinant() < 0.0 { -axes } else { *axes };
    let turn = UnitQuaternion::from_matrix(&axes);
    scene.rotations[i] = [turn.w, turn.i, turn.j, turn.k].map(|v| v as f32);
    scene.log_scales[i] = [0, 1, 2].map(|k| log_scales[k] as f32);
}

/// Root of the mean of the squared Bures distance of covariances over their traces.
fn covariance_error(a: &Scene, b: &Scene) -> f64 {
    let one = |i: usize| {
        let [a, b] = [a, b].map(|s| w2::Gaussian::of_scene(s, i).covariance);
        w2::bures_squared(&a, &b) / a.trace()
    };
    ((0..a.len()).map(one).sum::<f64>() / a.len() as f64).sqrt()
}

fn covariances(scene: &Scene, plan: &RahtPlan) -> Result<Family> {
    let mut family = Family::new(
        "Covariances",
        format!(
            "Of {} voxels. The error is the W2 distance over the root of the trace, root mean square.",
            scene.len()
        ),
        "bits per Gaussian | error",
    );
    let bits = |bytes: u64| 8.0 * bytes as f64 / scene.len() as f64;
    let qp = Qp { ac: 51, dc: 51, opacity: 51 };
    let coded = |covariance| -> Result<(u64, Scene, f64)> {
        let options = PaperOptions { qp, covariance };
        let (stream, seconds) = timed(|| paper::encode(scene, plan.octree(), None, &options));
        let stream = stream?;
        let is_it = |part: &str| part == "covariance" || part == "codebook indices";
        let bytes = stream.parts.iter().filter(|(part, _)| is_it(part)).map(|p| p.1).sum();
        Ok((bytes, paper::decode(&stream.bytes)?, seconds))
    };
    let (_, _, rest) = coded(CovarianceCoding::Lossy { codebook_bits: 0 })?;
    for (codebook_bits, buys) in [
        (8, "256 codewords, a size each"),
        (10, "1,024"),
        (12, "4,096, as the authors"),
        (14, "16,384"),
    ] {
        let (bytes, back, seconds) = coded(CovarianceCoding::Lossy { codebook_bits })?;
        let error = covariance_error(scene, &back);
        let cells = format!("{:.1} | {}", bits(bytes), small(error));
        let what = format!("codebook of {codebook_bits} bits");
        family.row(&what, (seconds - rest).max(0.0), error, &cells, buys);
    }
    let (bytes, back, seconds) = coded(CovarianceCoding::Lossless)?;
    let error = covariance_error(scene, &back);
    let cells = format!("{:.1} | {}", bits(bytes), small(error));
    let buys = "16 bits per component";
    family.row("predicted, lossless", (seconds - rest).max(0.0), error, &cells, buys);
    for (quality, buys) in [
        (50.0, "as streams have it"),
        (65.0, "half the step"),
        (80.0, "half of that: the default"),
        (95.0, "half of that"),
    ] {
        let step = gsvx::Steps::of_quality(quality)?.covariance;
        let (done, seconds) = best(|| log_euclidean(scene, plan, step));
        let (bytes, back) = done?;
        let error = covariance_error(scene, &back);
        let cells = format!("{:.1} | {}", bits(bytes), small(error));
        family.row(&format!("transform, quality {quality}"), seconds, error, &cells, buys);
    }
    Ok(family)
}

/// Logarithms of covariances through RAHT and the coder of coefficients, in these steps; bytes, and what is decoded.
fn log_euclidean(scene: &Scene, plan: &RahtPlan, step: f32) -> Result<(u64, Scene)> {
    let root = std::f64::consts::SQRT_2;
    let steps = [step; 6];
    let mut rows = Rows::new(plan.len(), steps.len());
    for i in 0..plan.len() {
        let [w, x, y, z] = scene.rotations[i].map(f64::from);
        let axes = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        let axes = *axes.to_rotation_matrix().matrix();
        let scales = Vector3::from(scene.log_scales[i].map(f64::from));
        let m = axes * Matrix3::from_diagonal(&scales) * axes.transpose();
        let six = [m.m11, m.m22, m.m33, root * m.m12, root * m.m13, root * m.m23];
        rows.row_mut(i).copy_from_slice(&six.map(|v| v as f32));
    }
    let mut coder = RansEncoder::default();
    attribute::encode(&mut coder, plan, &Quantisation::new(&steps), &mut rows)?;
    let bytes = coder.finish();
    // The encoder leaves in its rows what a decoder returns.
    let mut back = scene.clone();
    for i in 0..plan.len() {
        let v: Vec<f64> = rows.row(i).iter().map(|&v| f64::from(v)).collect();
        let [xy, xz, yz] = [v[3], v[4], v[5]].map(|v| v / root);
        let m = Matrix3::new(v[0], xy, xz, xy, v[1], yz, xz, yz, v[2]);
        let eigen = SymmetricEigen::new(m);
        set_covariance(&mut back, i, &eigen.eigenvectors, eigen.eigenvalues);
    }
    Ok((bytes.len() as u64, back))
}
