//! The exact reference `voxel::w2`: closed forms, invariances, optimality, degenerate input.

mod common;

use nalgebra::{Matrix3, Rotation3, Vector3};
use testing::Rng;
use voxel::Strategy;
use voxel::w2::{
    Gaussian, MAX_ITERATIONS, TOLERANCE, barycenter, bures_squared, distance_squared,
    replaced_distortion, square_root, total_distortion,
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
            // One at a time: a move of the mean would hide that the covariance is not the best.
            let mean = b.gaussian.mean * (1.0 - t) + other.mean * t;
            let covariance = b.gaussian.covariance * (1.0 - t) + other.covariance * t;
            for near in [Gaussian { mean, ..b.gaussian }, Gaussian { covariance, ..b.gaussian }] {
                assert!(sum(&near) >= best * (1.0 - 1e-9), "{n}: {} < {best}", sum(&near));
            }
        }
    }
}

/// Equations 3 to 5 in plain steps: the sum of distances at the covariance S, and its minimum by descent on square roots of S.
#[test]
fn barycenter_is_where_plain_descent_ends() {
    let mut r = Rng::seeded(8);
    for _ in 0..4 {
        let g: Vec<_> = (0..4).map(|_| random(&mut r, [0.0, -1.0, -2.0])).collect();
        let found = barycenter(&g, &[1.0; 4]).gaussian;
        let mean: Vector3<f64> = g.iter().map(|g| g.mean).sum::<Vector3<f64>>() / 4.0;
        assert!((found.mean - mean).amax() < 1e-12);
        // With the mean held: only the covariance counts.
        let sum =
            |s: &Matrix3<f64>| -> f64 { g.iter().map(|g| bures_squared(&g.covariance, s)).sum() };
        let mut root = square_root(&g[0].covariance);
        let (mut least, mut step) = (sum(&(root * root.transpose())), 0.2);
        while step > 1e-6 {
            let before = least;
            for _ in 0..40 {
                let next = root + step * Matrix3::from_fn(|_, _| f64::from(r.signed_exact()));
                let at = sum(&(next * next.transpose()));
                if at < least {
                    (root, least) = (next, at);
                }
            }
            if least == before {
                step /= 2.0;
            }
        }
        let best = sum(&found.covariance);
        assert!(best <= least && best >= least * (1.0 - 1e-4), "{best} {least}");
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

/// Where the paper's criteria pay: tight clusters of small Gaussians, and large ones that cross at nearly one place, all
/// over an unbounded scene. One depth must be deep enough to keep the large apart, and then divides the clusters too.
#[test]
fn the_criteria_pay_where_large_gaussians_cross_among_tight_clusters() {
    let mut r = Rng::seeded(9);
    let mut scene = common::at(&[], 0.0);
    let mut put = |mean: [f32; 3], log_scales: [f32; 3]| {
        let one = common::at(&[mean], 0.0);
        scene.means.extend(one.means);
        scene.rotations.extend(one.rotations);
        scene.opacity_logits.extend(one.opacity_logits);
        scene.sh.extend(one.sh);
        scene.log_scales.push(log_scales);
    };
    for _ in 0..400 {
        let centre: [f32; 3] = std::array::from_fn(|_| 100.0 * r.signed_exact());
        for _ in 0..20 {
            put(centre.map(|c| c + 0.02 * r.signed_exact()), [-6.0; 3]);
        }
        let place: [f32; 3] = std::array::from_fn(|_| 100.0 * r.signed_exact());
        for axis in 0..3 {
            let needle = std::array::from_fn(|k| if k == axis { 3.0 } else { -2.0 });
            put(place.map(|c| c + 0.05 * r.signed_exact()), needle);
        }
    }
    let cube = common::cube(&scene);
    let cost = |strategy: &Strategy| {
        let voxels = voxel::voxelize(&scene, &cube, strategy).unwrap();
        let bytes = gpcc_lite::geometry::encode(voxels.octree()).unwrap().len();
        (voxels.len(), bytes, total_distortion(&scene, &voxels))
    };
    let (leaves, bytes, distortion) = cost(&Strategy::Paper {
        large_percent: 100.0 * 3.0 / 23.0,
        j_low: 7,
        j_high: 16,
        tau1: 30,
        tau2: 0.5,
    });
    // A depth that has at most 300 times their equation 4 needs three times the Gaussians and twice the bytes.
    for depth in 5..=18 {
        let uniform = cost(&Strategy::Uniform { depth });
        let more = (uniform.0 as f64 / leaves as f64, uniform.1 as f64 / bytes as f64);
        assert!(
            uniform.2 > 300.0 * distortion || more.0 > 3.0 && more.1 > 1.9,
            "{depth}: {more:?}"
        );
    }
}

/// No Gaussian in a voxel's place has less of equation 4 than the barycenter, and the sum is that of the plain distances.
#[test]
fn what_replaces_a_voxel_has_at_least_the_distortion_of_the_barycenter() {
    let scene = common::clustered(400, 3);
    let cube = voxel::cube_of(&scene.means).unwrap();
    let voxels = voxel::voxelize(&scene, &cube, &Strategy::Uniform { depth: 3 }).unwrap();
    for merge in [voxel::Merge::Paper, voxel::Merge::Moments] {
        let merged = voxel::merge(&scene, &voxels, merge).unwrap();
        let mut plain = 0.0;
        for leaf in 0..voxels.len() {
            for &i in voxels.members_of(leaf) {
                let [g, by] =
                    [(&scene, i as usize), (&merged, leaf)].map(|(s, i)| Gaussian::of_scene(s, i));
                plain += distance_squared(&g, &by);
            }
        }
        let replaced = replaced_distortion(&scene, &voxels, &merged);
        assert!((replaced - plain).abs() <= 1e-9 * plain, "{merge:?}: {replaced} {plain}");
        assert!(replaced >= total_distortion(&scene, &voxels), "{merge:?}");
    }
}
