//! The paper's criteria (section 3.2.2) and initialisation (section 3.3) against the shortest code that says the same.

mod common;

use common::{at, clustered, cube};
use gs_model::Scene;
use testing::Rng;
use voxel::{Cube, Merge, Strategy, merge, voxelize};

/// Volume of a Gaussian: the product of its scales.
fn volume(scene: &Scene, i: usize) -> f64 {
    scene.log_scales[i].iter().map(|&l| libm::exp(f64::from(l))).product()
}

/// The voxel of a mean at a depth.
fn voxel_of(cube: &Cube, mean: [f32; 3], depth: u8) -> [u64; 3] {
    let sides = f64::from(1u32 << depth) / cube.side;
    std::array::from_fn(|k| ((f64::from(mean[k]) - cube.origin[k]) * sides) as u64)
}

/// Figure 5, word by word: the depth of the leaf of each Gaussian.
fn depths(scene: &Scene, cube: &Cube, strategy: &Strategy) -> Vec<u8> {
    let &Strategy::Paper { large_percent, j_low, j_high, tau1, tau2 } = strategy else {
        unreachable!()
    };
    let mut volumes: Vec<f64> = (0..scene.len()).map(|i| volume(scene, i)).collect();
    volumes.sort_by(f64::total_cmp);
    let large = (scene.len() as f64 * large_percent / 100.0).round() as usize;
    let least = volumes.get(scene.len() - large).copied().unwrap_or(f64::INFINITY);
    let depth_of = |i: usize| {
        let stops = |depth: &u8| {
            let voxel = voxel_of(cube, scene.means[i], *depth);
            let inside = |&m: &usize| voxel_of(cube, scene.means[m], *depth) == voxel;
            let members: Vec<usize> = (0..scene.len()).filter(inside).collect();
            let side = cube.side / f64::from(1u32 << depth);
            let far = |m: &usize| {
                let off = |k: usize| {
                    let centre = cube.origin[k] + (voxel[k] as f64 + 0.5) * side;
                    f64::from(scene.means[*m][k]) - centre
                };
                (0..3).map(|k| off(k) * off(k)).sum::<f64>().sqrt() > tau2 * side
            };
            let is_large = |m: &usize| volume(scene, *m) >= least;
            members.len() <= tau1 as usize
                && !members.iter().any(far)
                && !members.iter().any(is_large)
        };
        (j_low..j_high).find(stops).unwrap_or(j_high)
    };
    (0..scene.len()).map(depth_of).collect()
}

/// The depth at which the voxelizer puts each Gaussian.
fn found(scene: &Scene, cube: &Cube, strategy: &Strategy) -> Vec<u8> {
    let voxels = voxelize(scene, cube, strategy).unwrap();
    let leaf = voxels.leaf_of_each(scene.len());
    leaf.iter().map(|&l| voxels.octree().leaves()[l as usize].depth).collect()
}

#[test]
fn the_criteria_are_those_of_figure_5() {
    for seed in 0..6 {
        let scene = clustered(500, seed);
        let cube = cube(&scene);
        for (large_percent, tau1, tau2) in
            [(20.0, 30, 0.5), (0.0, 4, 1.0), (0.0, 500, 0.5), (5.0, 500, 1.0), (0.0, 3, 0.7)]
        {
            let strategy = Strategy::Paper { large_percent, j_low: 1, j_high: 7, tau1, tau2 };
            assert_eq!(
                found(&scene, &cube, &strategy),
                depths(&scene, &cube, &strategy),
                "{strategy:?}"
            );
        }
    }
}

/// A voxel with as many Gaussians as tau1 stays whole, as the text says ("exceeds"); the authors' code divides it.
#[test]
fn a_voxel_of_tau1_gaussians_is_not_divided() {
    // Five in a row near the centre of an octant, one in the far corner.
    let near = |i: usize| [0.25 + 0.01 * i as f32, 0.25, 0.25];
    let scene = at(&[near(0), near(1), near(2), near(3), near(4), [0.999; 3]], -8.0);
    let cube = Cube { origin: [0.0; 3], side: 1.0 };
    let of = |tau1| {
        let strategy = Strategy::Paper { large_percent: 0.0, j_low: 1, j_high: 4, tau1, tau2: 1.0 };
        found(&scene, &cube, &strategy)
    };
    assert_eq!(of(5)[..5], [1; 5]);
    assert!(of(4)[..5].iter().all(|&d| d > 1));
}

/// Nor is one with a mean at exactly tau2 from its centre.
#[test]
fn a_voxel_with_a_mean_at_tau2_is_not_divided() {
    // In a voxel of side 0.5: the second is half a side from the centre.
    let scene = at(&[[0.25; 3], [0.25, 0.25, 0.0], [0.999; 3]], -8.0);
    let cube = Cube { origin: [0.0; 3], side: 1.0 };
    let of = |tau2| {
        let strategy = Strategy::Paper { large_percent: 0.0, j_low: 1, j_high: 4, tau1: 30, tau2 };
        found(&scene, &cube, &strategy)
    };
    assert_eq!(of(0.5)[..2], [1; 2]);
    assert!(of(0.49)[..2].iter().all(|&d| d > 1));
}

/// Figure 4: 18 Gaussians, tau = 5, depths 1 to 4. A sparse voxel stays at depth 1, a dense one is divided until no voxel
/// has more than five, and the large one goes to depth 4.
#[test]
fn the_tree_of_figure_4() {
    let mut r = Rng::seeded(4);
    let mut means = vec![[0.0; 3]; 0];
    let mut near = |centre: [f32; 3], spread: f32, count: usize| {
        means.extend((0..count).map(|_| centre.map(|c| c + spread * r.signed_exact())));
    };
    near([0.25, 0.25, 0.25], 0.1, 5); // One voxel of depth 1 with exactly tau.
    near([0.875, 0.125, 0.125], 0.05, 4); // One of depth 2 ...
    near([0.625, 0.375, 0.375], 0.05, 4); // ... and its sibling: eight in their parent.
    near([0.25, 0.75, 0.75], 0.1, 4);
    near([0.75, 0.75, 0.75], 0.1, 1);
    let mut scene = at(&means, -8.0);
    scene.log_scales[17] = [-1.0; 3];
    let cube = Cube { origin: [0.0; 3], side: 1.0 };
    let percent = 100.0 / 18.0;
    let tau =
        Strategy::Paper { large_percent: percent, j_low: 1, j_high: 4, tau1: 5, tau2: f64::MAX };
    let depths = found(&scene, &cube, &tau);
    let wanted: Vec<u8> = [[1; 5].as_slice(), &[2; 8], &[1; 4], &[4]].concat();
    assert_eq!(depths, wanted);
    let uniform = voxelize(&scene, &cube, &Strategy::Uniform { depth: 4 }).unwrap();
    assert!(voxelize(&scene, &cube, &tau).unwrap().len() == 5 && uniform.len() > 10);
}

/// Section 3.3, word by word.
#[test]
fn the_initialisation_averages_and_takes_the_covariance_of_the_largest() {
    let scene = clustered(800, 3);
    let voxels = voxelize(&scene, &cube(&scene), &Strategy::Uniform { depth: 4 }).unwrap();
    let merged = merge(&scene, &voxels, Merge::Paper).unwrap();
    let mut shared = 0;
    for leaf in 0..voxels.len() {
        let members: Vec<usize> = voxels.members_of(leaf).iter().map(|&m| m as usize).collect();
        shared += usize::from(members.len() > 2);
        let mean = |of: &dyn Fn(usize) -> f64| {
            members.iter().map(|&m| of(m)).sum::<f64>() / members.len() as f64
        };
        let alpha = |logit: f32| 1.0 / (1.0 + libm::exp(-f64::from(logit)));
        let opacity = mean(&|m| alpha(scene.opacity_logits[m]));
        assert!((alpha(merged.opacity_logits[leaf]) - opacity).abs() < 1e-6);
        for (i, sh) in merged.sh_of(leaf).iter().enumerate() {
            for c in 0..3 {
                let wanted = mean(&|m| f64::from(scene.sh_of(m)[i][c]));
                assert!((f64::from(sh[c]) - wanted).abs() < 1e-5);
            }
        }
        let by_volume =
            |a: &&usize, b: &&usize| volume(&scene, **a).total_cmp(&volume(&scene, **b));
        let largest = *members.iter().max_by(by_volume).unwrap();
        assert_eq!(merged.rotations[leaf], scene.rotations[largest]);
        assert_eq!(merged.log_scales[leaf], scene.log_scales[largest]);
        assert_eq!(merged.means[leaf], voxels.octree().centre(leaf));
    }
    assert!(shared > 20, "{shared} leaves of three or more");
}

#[test]
fn of_equally_large_gaussians_the_first_of_a_voxel_gives_the_covariance() {
    let mut scene = clustered(200, 0);
    scene.log_scales.fill([-3.0; 3]);
    let voxels = voxelize(&scene, &cube(&scene), &Strategy::Uniform { depth: 1 }).unwrap();
    let merged = merge(&scene, &voxels, Merge::Paper).unwrap();
    for leaf in 0..voxels.len() {
        let first = voxels.members_of(leaf)[0] as usize;
        assert_eq!(merged.rotations[leaf], scene.rotations[first]);
    }
}
