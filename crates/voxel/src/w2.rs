//! Reference: 2-Wasserstein distances and barycenters of Gaussians (the paper's eq. 3 to 5).
//!
//! With the feature `reference`. Everything here is exact up to rounding in `f64`, and slow. No strategy calls it; tests and
//! measurements compare the strategies with it.
//!
//! ```
//! use voxel::w2::{Gaussian, barycenter, distance_squared};
//!
//! let a = Gaussian::new([0.0, 0.0, 0.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
//! let b = Gaussian::new([2.0, 0.0, 0.0], [[9.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
//! // Squared distance of the means, plus (3 - 1)^2 for the scales along x.
//! assert!((distance_squared(&a, &b) - 8.0).abs() < 1e-12);
//!
//! let middle = barycenter(&[a, b], &[1.0, 1.0]).gaussian;
//! assert!((middle.covariance[(0, 0)] - 4.0).abs() < 1e-9);
//! ```

use gs_model::Scene;
use gs_model::math::{axes_product, rotation};
use nalgebra::{Matrix3, SVD, SymmetricEigen, Vector3};
use rayon::prelude::*;

use crate::gaussian::scale;
use crate::order::CHUNK;
use crate::voxelization::Voxelization;

/// A Gaussian distribution in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian {
    /// Mean.
    pub mean: Vector3<f64>,
    /// Covariance: symmetric, positive semi-definite; may be rank-deficient.
    pub covariance: Matrix3<f64>,
}

impl Gaussian {
    /// From a mean and the rows of a covariance.
    #[must_use]
    pub fn new(mean: [f64; 3], covariance: [[f64; 3]; 3]) -> Self {
        let covariance = Matrix3::from_fn(|i, j| covariance[i][j]);
        Self { mean: Vector3::from(mean), covariance }
    }

    /// Gaussian `i` of a scene, without its opacity and colour. Log-scales beyond +-115
    /// (scales of 1e+-50) are clamped.
    #[must_use]
    pub fn of_scene(scene: &Scene, i: usize) -> Self {
        let s = scene.log_scales[i].map(scale).map(|s| s * s);
        let [xx, yy, zz, xy, xz, yz] = axes_product(&rotation(scene.rotations[i]), s);
        Self::new(scene.means[i].map(f64::from), [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    }
}

/// Greatest number of iterations of an eigenvalue decomposition of a 3x3 matrix.
const MAX_EIGEN: usize = 100;

/// Square root of a symmetric positive semi-definite matrix; eigenvalues that rounding made
/// negative count as zero.
#[must_use]
pub fn square_root(m: &Matrix3<f64>) -> Matrix3<f64> {
    // At unit scale, because the iteration has absolute thresholds.
    let scale = m.amax();
    if !(scale > 0.0 && scale.is_finite()) {
        return Matrix3::zeros();
    }
    let symmetric = (m + m.transpose()) * (0.5 / scale);
    match SymmetricEigen::try_new(symmetric, f64::EPSILON, MAX_EIGEN) {
        Some(eigen) => {
            let root = eigen.eigenvalues.map(|v| (v.max(0.0) * scale).sqrt());
            eigen.eigenvectors * Matrix3::from_diagonal(&root) * eigen.eigenvectors.transpose()
        }
        None => Matrix3::zeros(),
    }
}

/// Squared 2-Wasserstein distance (eq. 3), never negative.
#[must_use]
pub fn distance_squared(a: &Gaussian, b: &Gaussian) -> f64 {
    (a.mean - b.mean).norm_squared() + bures_squared(&a.covariance, &b.covariance)
}

/// The covariance part of [`distance_squared`]: `Tr(A + B - 2 (A^1/2 B A^1/2)^1/2)`.
#[must_use]
pub fn bures_squared(a: &Matrix3<f64>, b: &Matrix3<f64>) -> f64 {
    let cross = cross_root(&square_root(a), &square_root(b)).trace();
    (a.trace() + b.trace() - 2.0 * cross).max(0.0)
}

/// `(A^1/2 B A^1/2)^1/2` from the two square roots.
///
/// With the singular values `A^1/2 B^1/2 = U s V^T` it is `U s U^T`. To square first, and take the
/// root of the product, would lose half the digits of small eigenvalues; the iteration of flat
/// Gaussians would then stop converging at 1e-8.
fn cross_root(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let product = a * b;
    let scale = product.amax();
    if !(scale > 0.0 && scale.is_finite()) {
        return Matrix3::zeros();
    }
    let svd = SVD::try_new_unordered(product / scale, true, false, f64::EPSILON, MAX_EIGEN);
    match svd.map(|svd| (svd.u, svd.singular_values)) {
        Some((Some(u), s)) => u * Matrix3::from_diagonal(&(s * scale)) * u.transpose(),
        _ => square_root(&(product * product.transpose())),
    }
}

/// Result of [`barycenter`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Barycenter {
    /// The barycenter.
    pub gaussian: Gaussian,
    /// Fixed-point iterations made.
    pub iterations: u32,
    /// Relative change of the greatest entry in the last one. At most [`TOLERANCE`], unless the
    /// number of iterations reached its limit.
    pub residual: f64,
}

/// The fixed-point iteration stops at this relative change.
pub const TOLERANCE: f64 = 1e-10;

/// The fixed-point iteration stops after this many iterations; trained scenes take 5 to 20.
pub const MAX_ITERATIONS: u32 = 200;

/// Directions in which the barycenter's variance is less than this part of the greatest are left
/// out of the inverse, where they would amplify rounding. Their variance becomes zero.
const FLAT: f64 = 1e-14;

/// The weighted 2-Wasserstein barycenter: the Gaussian that minimises the weighted sum of
/// squared distances (eq. 4 and 5).
///
/// The covariance is the fixed point of `S = sum w_i (S^1/2 S_i S^1/2)^1/2` with weights that
/// sum to 1. The paper's eq. 5 prints that map **without** the weights `1/k`, and then it has
/// another fixed point (for k copies of one Gaussian, k^2 times its covariance). The iteration
/// uses the map of the paper's source (Alvarez-Esteban et al. 2016), which has the same fixed
/// point, always converges, and converges much faster:
/// `S <- S^-1/2 (sum w_i (S^1/2 S_i S^1/2)^1/2)^2 S^-1/2`. It starts with the square of the
/// weighted mean of the square roots, which is the solution if all covariances commute. The start
/// extends in every direction in which any member does, and the inverse is taken in these
/// directions only, so covariances may be rank-deficient.
///
/// The result does not depend on the scale of the weights. Weights that are negative or not finite
/// count as zero; if no weight is positive, all count alike. An empty list gives a Gaussian of
/// mean and covariance zero.
#[must_use]
pub fn barycenter(gaussians: &[Gaussian], weights: &[f64]) -> Barycenter {
    let clean =
        |i: usize| weights.get(i).copied().filter(|w| *w > 0.0 && w.is_finite()).unwrap_or(0.0);
    let greatest = (0..gaussians.len()).map(clean).fold(0.0, f64::max);
    let relative = |i: usize| if greatest > 0.0 { clean(i) / greatest } else { 1.0 };
    let total: f64 = (0..gaussians.len()).map(relative).sum();
    let share = |i: usize| relative(i) / total;

    let mean: Vector3<f64> = gaussians.iter().enumerate().map(|(i, g)| g.mean * share(i)).sum();
    // Work at the scale of the greatest covariance.
    let scale = gaussians.iter().map(|g| g.covariance.amax()).fold(0.0, f64::max);
    if !(scale > 0.0 && scale.is_finite()) {
        let gaussian = Gaussian { mean, covariance: Matrix3::zeros() };
        return Barycenter { gaussian, iterations: 0, residual: 0.0 };
    }
    let roots: Vec<_> = gaussians.iter().map(|g| square_root(&(g.covariance / scale))).collect();
    let sum_roots = |term: &dyn Fn(&Matrix3<f64>) -> Matrix3<f64>| -> Matrix3<f64> {
        roots.iter().enumerate().map(|(i, r)| term(r) * share(i)).sum()
    };
    let root = sum_roots(&|r| *r);
    let mut s = root * root;
    let (mut iterations, mut residual) = (0, f64::INFINITY);
    while iterations < MAX_ITERATIONS && residual > TOLERANCE {
        let (root, inverse) = root_and_inverse(&s);
        let map = inverse * sum_roots(&|r| cross_root(&root, r));
        let next = map * map.transpose();
        residual = (next - s).amax() / next.amax().max(f64::MIN_POSITIVE);
        s = next;
        iterations += 1;
    }
    let gaussian = Gaussian { mean, covariance: s * scale };
    Barycenter { gaussian, iterations, residual }
}

/// Square root of a covariance and the inverse of it, zero in [`FLAT`] directions.
fn root_and_inverse(m: &Matrix3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
    let Some(eigen) = SymmetricEigen::try_new(*m, f64::EPSILON, MAX_EIGEN) else {
        return (Matrix3::zeros(), Matrix3::zeros());
    };
    let floor = eigen.eigenvalues.amax() * FLAT;
    let root = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    let inverse = eigen.eigenvalues.map(|v| if v > floor { v.sqrt().recip() } else { 0.0 });
    let compose = |d: &Vector3<f64>| {
        eigen.eigenvectors * Matrix3::from_diagonal(d) * eigen.eigenvectors.transpose()
    };
    (compose(&root), compose(&inverse))
}

/// Eq. 4 of one voxel: the sum of squared distances of `members` to their
/// barycenter, all weights equal.
pub(crate) fn voxel_distortion(scene: &Scene, members: &[u32]) -> f64 {
    if members.len() < 2 {
        return 0.0;
    }
    let gaussians: Vec<_> =
        members.iter().map(|&i| Gaussian::of_scene(scene, i as usize)).collect();
    let centre = barycenter(&gaussians, &vec![1.0; gaussians.len()]).gaussian;
    gaussians.iter().map(|g| distance_squared(g, &centre)).sum()
}

/// The sum of eq. 4 over all leaves, at their barycenters: the least that Gaussians in their place can have.
#[must_use]
pub fn total_distortion(scene: &Scene, voxelization: &Voxelization) -> f64 {
    sum_over_leaves(voxelization, |leaf| voxel_distortion(scene, voxelization.members_of(leaf)))
}

/// The sum of eq. 4 over all leaves, at the Gaussians of `merged` that replace their members: leaf `i` is its row `i`.
#[must_use]
pub fn replaced_distortion(scene: &Scene, voxelization: &Voxelization, merged: &Scene) -> f64 {
    sum_over_leaves(voxelization, |leaf| {
        let centre = Gaussian::of_scene(merged, leaf);
        let members = voxelization.members_of(leaf).iter();
        members.map(|&i| distance_squared(&Gaussian::of_scene(scene, i as usize), &centre)).sum()
    })
}

/// The sum in an order that the number of threads does not change.
fn sum_over_leaves(voxelization: &Voxelization, of: impl Fn(usize) -> f64 + Sync) -> f64 {
    let leaves: Vec<usize> = (0..voxelization.len()).collect();
    let chunks = leaves.par_chunks(CHUNK).map(|chunk| chunk.iter().map(|&i| of(i)).sum());
    chunks.collect::<Vec<f64>>().iter().sum()
}
