//! Merging by moments against the shortest code that says the same.

mod common;

use common::{at, clustered, cube};
use gs_model::Scene;
use nalgebra::{Matrix3, Vector3};
use voxel::w2::Gaussian;
use voxel::{Importance, Merge, Merging, Place, Strategy, Voxelization, merge, voxelize};

fn alpha(logit: f32) -> f64 {
    1.0 / (1.0 + libm::exp(-f64::from(logit)))
}

/// Root mean square of the principal cross-sections.
fn area(log_scale: [f32; 3]) -> f64 {
    let [a, b, c] = log_scale.map(|l| libm::exp(f64::from(l)));
    ((a * a * b * b + b * b * c * c + c * c * a * a) / 3.0).sqrt()
}

/// Uniform voxels of a depth.
fn uniform(scene: &Scene, depth: u8) -> Voxelization {
    voxelize(scene, &cube(scene), &Strategy::Uniform { depth }).unwrap()
}

#[test]
fn a_merged_gaussian_has_the_colours_moments_and_optical_depth_of_its_members() {
    let scene = clustered(800, 3);
    let voxels = uniform(&scene, 4);
    let merged = merge(&scene, &voxels, Merge::Moments).unwrap();
    let mut shared = 0;
    for leaf in 0..voxels.len() {
        let members: Vec<usize> = voxels.members_of(leaf).iter().map(|&m| m as usize).collect();
        if members.len() == 1 {
            continue;
        }
        shared += 1;
        let weight = |m: usize| alpha(scene.opacity_logits[m]) * area(scene.log_scales[m]);
        let all: f64 = members.iter().map(|&m| weight(m)).sum();
        let shares: Vec<(usize, f64)> = members.iter().map(|&m| (m, weight(m) / all)).collect();
        for (i, sh) in merged.sh_of(leaf).iter().enumerate() {
            for c in 0..3 {
                let wanted: f64 =
                    shares.iter().map(|&(m, w)| w * f64::from(scene.sh_of(m)[i][c])).sum();
                assert!((f64::from(sh[c]) - wanted).abs() < 1e-5);
            }
        }
        let mean: Vector3<f64> =
            shares.iter().map(|&(m, w)| w * Gaussian::of_scene(&scene, m).mean).sum();
        let moments = |&(m, w): &(usize, f64)| {
            let Gaussian { mean: at, covariance } = Gaussian::of_scene(&scene, m);
            w * (covariance + (at - mean) * (at - mean).transpose())
        };
        let wanted: Matrix3<f64> = shares.iter().map(moments).sum();
        let covariance = Gaussian::of_scene(&merged, leaf).covariance;
        assert!((covariance - wanted).amax() < 1e-5 * wanted.amax(), "{covariance} {wanted}");
        let depth = |m: usize| -libm::log(1.0 - alpha(scene.opacity_logits[m]).min(0.99));
        let density: f64 = members.iter().map(|&m| depth(m) * area(scene.log_scales[m])).sum();
        let stacked: f64 = members.iter().map(|&m| depth(m)).sum();
        let seen = (density / area(merged.log_scales[leaf])).min(stacked);
        let opacity = (1.0 - libm::exp(-seen)).min(0.99);
        assert!((alpha(merged.opacity_logits[leaf]) - opacity).abs() < 1e-4);
    }
    assert!(shared > 50, "{shared} leaves of several members");
}

#[test]
fn importances_weigh_and_only_their_ratios_count() {
    let mut scene = at(&[[0.1; 3], [0.2; 3]], -4.0);
    scene.sh = vec![[0.0; 3], [1.0; 3]];
    let voxels = uniform(&scene, 0);
    let colour = |given: [f32; 2]| {
        let given = Importance::Given(given.to_vec());
        Merging::new(&scene, &voxels, Merge::Moments, &given).unwrap().scene().sh[0][0]
    };
    for scale in [1.0, 1e-37, 1e37] {
        assert!((colour([scale, 3.0 * scale]) - 0.75).abs() < 1e-6, "{scale}");
    }
    // Nothing counts more than anything else where nothing counts.
    assert_eq!(colour([0.0; 2]), 0.5);
    // Opacity times area of 1e-200, one e times the other.
    scene.log_scales = vec![[-115.0; 3]; 2];
    scene.opacity_logits = vec![-231.0, -230.0];
    let merged = merge(&scene, &voxels, Merge::Moments).unwrap();
    let e = std::f32::consts::E;
    assert!((merged.sh[0][0] - e / (1.0 + e)).abs() < 1e-6);
}

#[test]
fn a_merged_gaussian_may_be_at_the_weighted_mean_of_its_members() {
    let scene = at(&[[0.0; 3], [0.25; 3], [1.0; 3]], -4.0);
    let voxels = uniform(&scene, 1);
    let given = Importance::Given(vec![1.0, 3.0, 1.0]);
    let merging = Merging::new(&scene, &voxels, Merge::Moments, &given).unwrap();
    assert_eq!(merging.at(Place::MemberMean).scene().means, [[0.1875; 3], [1.0; 3]]);
    let centres = [voxels.octree().centre(0), voxels.octree().centre(1)];
    assert_eq!(merging.scene().means, centres);
}

#[test]
fn a_merged_scene_keeps_its_origin_and_how_it_was_trained() {
    let plain = clustered(60, 1);
    let marked = Scene { antialiased: true, origin: [5e5, -4e6, 30.0], ..plain.clone() };
    for scene in [plain, marked] {
        for rule in [Merge::Paper, Merge::Moments] {
            let merged = merge(&scene, &uniform(&scene, 3), rule).unwrap();
            assert_eq!((merged.antialiased, merged.origin), (scene.antialiased, scene.origin));
        }
    }
}
