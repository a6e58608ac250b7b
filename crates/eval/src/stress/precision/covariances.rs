//! Covariances taken apart, in log-Euclidean coordinates and back, and W2 barycenters.

use gs_model::math::{Symmetric, axes_product, eigen_of, quaternion, rotation};
use gsvx::covariance::{coordinates, decompose_into};
use nalgebra::Matrix3;
use testing::Rng;
use voxel::w2::{Gaussian, barycenter};

use super::{Figure, Greatest, U};

/// By how much the size of a Gaussian is off in the worst direction, of its size there; and its greatest size over its
/// least.
pub(super) fn sizes_off(found: &Symmetric, wanted: &Symmetric) -> (f64, f64) {
    let (variances, axes) = eigen_of(wanted);
    let sizes = variances.map(f64::sqrt);
    let along = |i: usize, j: usize| {
        let [xx, yy, zz, xy, xz, yz] = [0, 1, 2, 3, 4, 5].map(|k| found[k] - wanted[k]);
        let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let of = |row: usize| (0..3).map(|c| rows[row][c] * axes[c][j]).sum::<f64>();
        (0..3).map(|row| axes[row][i] * of(row)).sum::<f64>() / (sizes[i] * sizes[j])
    };
    // Relative to the covariance wanted: half of it is the error of a size.
    let worst = (0..9).map(|k| along(k / 3, k % 3).abs()).fold(0.0, f64::max);
    let largest = sizes.into_iter().fold(0.0, f64::max);
    let least = sizes.into_iter().fold(f64::MAX, f64::min);
    (0.5 * worst, largest / least)
}

/// Log-scales of random numbers in -1 to 1.
type Make = fn([f32; 3]) -> [f32; 3];

const FAMILIES: [(&str, Make); 5] = [
    ("ordinary", |r| r.map(|r| -3.0 + 2.0 * r)),
    ("needles of 1:1e5", |[a, b, _]| [2.0 + a, -9.5 + a, -9.5 + a + 1e-3 * b]),
    ("pancakes of 1e5:1", |[a, b, _]| [a, a + 1e-3 * b, -11.5 + a]),
    ("equal sizes but for 1e-6", |r| r.map(|r| -2.0 + 1e-6 * r)),
    ("scales 1e-30 to 1e30", |r| r.map(|r| 69.0 * r)),
];

pub(super) fn figures() -> Vec<Figure> {
    FAMILIES.into_iter().flat_map(|(name, make)| family(name, make)).collect()
}

fn family(name: &'static str, make: Make) -> Vec<Figure> {
    let mut r = Rng::seeded(9);
    let [mut logarithms, mut variances, mut w2] = [Greatest::default(); 3];
    for _ in 0..2000 {
        let q: [f32; 4] = [r.signed(), r.signed(), r.signed(), 1.01 + r.signed()];
        let l = make([r.signed(), r.signed(), r.signed()]);
        logarithms_there_and_back(&mut logarithms, q, l);
        taken_apart(&mut variances, q, l);
    }
    for _ in 0..100 {
        let q: [f32; 4] = [r.signed(), r.signed(), r.signed(), 1.01 + r.signed()];
        let all = [0; 5].map(|_| make([r.signed(), r.signed(), r.signed()]));
        barycenter_of_one_frame(&mut w2, q, &all);
    }
    vec![
        logarithms.figure("log-Euclidean and back, log-scales", name),
        variances.figure("covariance taken apart, of the greatest size", name),
        w2.figure("W2 barycenter, of the greatest variance", name),
    ]
}

/// The matrix logarithm, against quaternion and log-scales in double precision.
fn logarithms_there_and_back(greatest: &mut Greatest, q: [f32; 4], l: [f32; 3]) {
    let (mut rotations, mut log_scales) = ([[0.0; 4]], [[0.0; 3]]);
    decompose_into(&[coordinates(q, l)], &mut rotations, &mut log_scales);
    let wanted = axes_product(&rotation(q), l.map(f64::from));
    let found = axes_product(&rotation(rotations[0]), log_scales[0].map(f64::from));
    let largest = l.iter().fold(0.0, |m: f64, l| m.max(f64::from(l.abs())));
    for (found, wanted) in found.iter().zip(wanted) {
        greatest.add((found - wanted).abs(), 32.0 * U * largest.max(1e-30));
    }
}

/// Eigenvalues and axes of a covariance.
fn taken_apart(greatest: &mut Greatest, q: [f32; 4], l: [f32; 3]) {
    let sizes = l.map(|l| libm::exp(f64::from(l)));
    let largest = sizes.into_iter().fold(0.0, f64::max);
    let wanted = axes_product(&rotation(q), sizes.map(|s| (s / largest) * (s / largest)));
    let (variances, axes) = eigen_of(&wanted);
    let q = quaternion(&axes).map(|v| v as f32);
    let found = axes_product(&rotation(q), variances);
    for (found, wanted) in found.iter().zip(wanted) {
        greatest.add((found - wanted).abs(), 4.0 * U);
    }
    let mut roots = variances.map(|v| v.max(0.0).sqrt());
    let mut sizes = sizes.map(|s| s / largest);
    roots.sort_by(f64::total_cmp);
    sizes.sort_by(f64::total_cmp);
    for (found, wanted) in roots.iter().zip(sizes) {
        // The error of a variance, 1e-15 of the greatest, is all of one that is smaller.
        greatest
            .add((found - wanted).abs(), (1e-15f64).sqrt().min(1e-15 / wanted) + 4.0 * U * wanted);
    }
}

/// Gaussians of one set of axes: their barycenter has the means of their sizes.
fn barycenter_of_one_frame(greatest: &mut Greatest, q: [f32; 4], all: &[[f32; 3]]) {
    let r = rotation(q);
    let sizes = |l: &[f32; 3]| l.map(|l| libm::exp(f64::from(l)));
    let largest = all.iter().flat_map(sizes).fold(0.0, f64::max);
    let gaussian = |l: &[f32; 3]| {
        let [xx, yy, zz, xy, xz, yz] =
            axes_product(&r, sizes(l).map(|s| (s / largest) * (s / largest)));
        Gaussian::new([0.0; 3], [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    };
    let gaussians: Vec<Gaussian> = all.iter().map(gaussian).collect();
    let found = barycenter(&gaussians, &vec![1.0; all.len()]).gaussian.covariance;
    let mean = [0, 1, 2]
        .map(|k| all.iter().map(|l| sizes(l)[k] / largest).sum::<f64>() / all.len() as f64);
    let [xx, yy, zz, xy, xz, yz] = axes_product(&r, mean.map(|s| s * s));
    let wanted = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    // Directions of less than 1e-7 of the greatest size count as flat.
    let least = all.iter().flat_map(sizes).fold(f64::MAX, f64::min);
    let bound = if least > 1e-7 * largest { 1e-9 } else { 1e-6 };
    greatest.add((found - wanted).amax(), bound);
}
