//! The exact reference `voxel::w2`: closed forms, invariances, optimality, degenerate input.

mod common;

use nalgebra::{Matrix3, Rotation3, Vector3};
use testing::Rng;
use voxel::w2::{
    Gaussian, MAX_ITERATIONS, TOLERANCE, barycenter, bures_squared, distance_squared, square_root,
};

fn random(r: &mut Rng, exponents: [f64; 3]) -> Gaussian {
    let axis = Vector3::from_fn(|_, _| f64::from(r.signed_exact()));
    let rotation = Rotation3::new(axis * 3.0).into_inner();
    let variances = Vector3::from(exponents).map(|e| libm::exp10(e + f64::from(r.signed_exact())));
    let covariance = rotation * Matrix3::from_diagonal(&variances) * rotation.transpose();
    Gaussian { mean: Vector3::from_fn(|_, _| f64::from(r.signed_exact())), covariance }
}

#[test]
fn distance_is_a_metric_and_knows_closed_forms() {
    let mut r = Rng::seeded(1);
    for _ in 0..200 {
        let g: [Gaussian; 3] = std::array::from_fn(|_| random(&mut r, [0.0, -1.0, -3.0]));
        let d = |a: usize, b: usize| distance_squared(&g[a], &g[b]).sqrt();
        assert!(d(0, 0) < 1e-6);
        assert!((d(0, 1) - d(1, 0)).abs() < 1e-9);
        assert!(d(0, 2) <= d(0, 1) + d(1, 2) + 1e-9);
        // Commuting covariances: the distance of the square roots.
        let root = square_root(&g[0].covariance);
        let scaled = Gaussian { covariance: g[0].covariance * 4.0, ..g[0] };
        assert!((distance_squared(&g[0], &scaled) - root.norm_squared()).abs() < 1e-9);
        // In general that is an upper bound: what the rate-distortion strategy minimises.
        let bound = (square_root(&g[1].covariance) - root).norm_squared();
        assert!(bures_squared(&g[0].covariance, &g[1].covariance) <= bound + 1e-9);
    }
}

#[test]
fn barycenter_converges_and_is_a_minimum() {
    let mut r = Rng::seeded(2);
    for n in [1usize, 2, 3, 10] {
        let g: Vec<_> = (0..n).map(|_| random(&mut r, [0.0, -1.0, -2.0])).collect();
        let w: Vec<f64> = (0..n).map(|_| 1.5 + f64::from(r.signed_exact())).collect();
        let b = barycenter(&g, &w);
        assert!(b.iterations < MAX_ITERATIONS && b.residual <= TOLERANCE, "{b:?}");
        let sum = |c: &Gaussian| -> f64 {
            g.iter().zip(&w).map(|(g, w)| w * distance_squared(g, c)).sum()
        };
        let best = sum(&b.gaussian);
        for _ in 0..50 {
            let other = random(&mut r, [0.0, -1.0, -2.0]);
            let t = 0.05;
            let near = Gaussian {
                mean: b.gaussian.mean * (1.0 - t) + other.mean * t,
                covariance: b.gaussian.covariance * (1.0 - t) + other.covariance * t,
            };
            assert!(sum(&near) >= best * (1.0 - 1e-9), "{n}: {} < {best}", sum(&near));
        }
    }
}

/// The paper's printed iteration lacks the weights 1/k; with them, k copies give the original.
#[test]
fn barycenter_of_copies_is_the_original() {
    let mut r = Rng::seeded(3);
    let g = random(&mut r, [2.0, 0.0, -4.0]);
    let b = barycenter(&[g; 7], &[1.0; 7]).gaussian;
    assert!((b.covariance - g.covariance).amax() < 1e-8 * g.covariance.amax());
    assert!((b.mean - g.mean).amax() < 1e-12);
}

/// In one dimension the barycenter's scale is the mean of the scales.
#[test]
fn barycenter_averages_scales_along_common_axes() {
    let g = |s: f64| Gaussian::new([0.0; 3], [[s * s, 0.0, 0.0], [0.0; 3], [0.0; 3]]);
    let b = barycenter(&[g(1.0), g(2.0), g(6.0)], &[1.0, 1.0, 2.0]).gaussian;
    assert!((b.covariance[(0, 0)] - 3.75 * 3.75).abs() < 1e-9);
    assert!(b.covariance[(1, 1)].abs() < 1e-30);
}

#[test]
fn rank_deficient_and_extreme_covariances() {
    let mut r = Rng::seeded(4);
    let zero = Gaussian::new([1.0, 0.0, 0.0], [[0.0; 3]; 3]);
    for exponents in [[60.0, 0.0, -60.0], [-60.0; 3], [60.0; 3], [0.0, -20.0, -40.0]] {
        let g = [random(&mut r, exponents), random(&mut r, exponents), zero];
        let b = barycenter(&g, &[1.0; 3]);
        assert!(b.gaussian.covariance.iter().all(|x| x.is_finite()));
        assert!(b.iterations <= MAX_ITERATIONS);
        for g in &g {
            assert!(distance_squared(g, &b.gaussian).is_finite());
        }
    }
    let points = barycenter(&[zero; 4], &[1.0; 4]);
    assert_eq!(points.gaussian.covariance, Matrix3::zeros());
    // Two needles at a right angle: singular, and not commuting with a third.
    let x = Gaussian::new([0.0; 3], [[1.0, 0.0, 0.0], [0.0; 3], [0.0; 3]]);
    let y = Gaussian::new([0.0; 3], [[0.0; 3], [0.0, 1.0, 0.0], [0.0; 3]]);
    let b = barycenter(&[x, y], &[1.0, 1.0]);
    assert!(b.residual <= TOLERANCE);
}

#[test]
fn odd_weights() {
    let x = Gaussian::new([0.0; 3], [[1.0, 0.0, 0.0], [0.0; 3], [0.0; 3]]);
    let y = Gaussian::new([4.0, 0.0, 0.0], [[9.0, 0.0, 0.0], [0.0; 3], [0.0; 3]]);
    let only_y = barycenter(&[x, y], &[f64::NAN, 1e-300]).gaussian;
    assert!((only_y.mean - y.mean).amax() < 1e-12);
    let alike = barycenter(&[x, y], &[0.0, -1.0]).gaussian;
    assert!((alike.mean[0] - 2.0).abs() < 1e-12);
    assert_eq!(barycenter(&[], &[]).iterations, 0);
}
