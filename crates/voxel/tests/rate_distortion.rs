//! The rate-distortion pruning against a slow, obvious one, and what its parameters do.

mod common;

use common::{clustered, cube};
use gpcc_lite::{Leaf, morton};
use gs_model::Scene;
use nalgebra::{Matrix3, Vector3};
use testing::shared;
use voxel::{CostModel, Cube, Importance, RateDistortion, ReleasedRule, Strategy, voxelize, w2};

/// Every subtree of the full octree by recursion over explicit member lists, distortions by
/// direct double sums over members, no statistics, no skipping.
struct Naive<'a> {
    scene: &'a Scene,
    cube: &'a Cube,
    o: &'a RateDistortion,
    /// (geometry, feature) weight of each Gaussian.
    weights: Vec<(f64, f64)>,
}

impl<'a> Naive<'a> {
    fn new(scene: &'a Scene, cube: &'a Cube, o: &'a RateDistortion) -> Self {
        let area = |i: usize| {
            let s = scene.log_scales[i].map(|l| libm::exp(f64::from(l)));
            let sides = [s[0] * s[1], s[0] * s[2], s[1] * s[2]];
            (sides.iter().map(|x| x * x).sum::<f64>() / 3.0).sqrt()
        };
        let importance = |i: usize| match &o.importance {
            Importance::Given(given) => f64::from(given[i]),
            _ => area(i) / (1.0 + libm::exp(-f64::from(scene.opacity_logits[i]))),
        };
        let n = scene.len();
        let mean = (0..n).map(importance).sum::<f64>() / n as f64;
        let geometry = |i: usize| importance(i) * libm::pow(area(i), -o.size_exponent);
        let energy = (0..n).map(|i| geometry(i) * area(i)).sum::<f64>() / n as f64;
        let weights = (0..n).map(|i| (geometry(i) / energy, importance(i) / mean)).collect();
        Self { scene, cube, o, weights }
    }

    fn distortion(&self, members: &[usize], index: [u32; 3], depth: u8) -> f64 {
        let cell = self.cube.side / f64::from(1u32 << depth);
        let centre =
            Vector3::from_fn(|k, _| self.cube.origin[k] + (f64::from(index[k]) + 0.5) * cell);
        let g: Vec<_> = members.iter().map(|&i| w2::Gaussian::of_scene(self.scene, i)).collect();
        let roots: Vec<_> = g.iter().map(|g| w2::square_root(&g.covariance)).collect();
        let colour = |i: usize| Vector3::from(self.scene.sh_of(members[i])[0].map(f64::from));
        let w = |i: usize| self.weights[members[i]];
        let (wg, wf): (f64, f64) =
            ((0..g.len()).map(|i| w(i).0).sum(), (0..g.len()).map(|i| w(i).1).sum());
        let root: Matrix3<f64> = (0..g.len()).map(|i| roots[i] * (w(i).0 / wg)).sum();
        let mean: Vector3<f64> = (0..g.len()).map(|i| colour(i) * (w(i).1 / wf)).sum();
        (0..g.len())
            .map(|i| {
                w(i).0 * (g[i].mean - centre).norm_squared()
                    + self.o.shape * w(i).0 * (roots[i] - root).norm_squared()
                    + self.o.colour * w(i).1 * (colour(i) - mean).norm_squared()
            })
            .sum()
    }

    /// Cheapest pruning below a cell: its cost, its leaves, whether nothing is left.
    fn solve(&self, members: &[usize], index: [u32; 3], depth: u8) -> (f64, Vec<Leaf>, bool) {
        let (o, c) = (self.o, &self.o.cost);
        let mut best = (f64::INFINITY, Vec::new(), false);
        let flagged = depth >= o.j_low && depth < o.j_high;
        if depth >= o.j_low {
            let stop = if flagged { c.stop } else { 0.0 };
            let cost = self.distortion(members, index, depth) + o.lambda * (stop + c.gaussian);
            let code = morton::encode(index.map(|i| i << (o.j_high - depth)));
            best = (cost, vec![Leaf { morton: code, depth }], false);
        }
        if depth < o.j_high {
            let mut cost = if flagged { o.lambda * c.go_on } else { 0.0 };
            let (mut leaves, mut occupied) = (Vec::new(), 0);
            for octant in 0..8u32 {
                let child = [0, 1, 2].map(|k| index[k] * 2 + (octant >> (2 - k) & 1));
                let inside: Vec<usize> = members
                    .iter()
                    .copied()
                    .filter(|&i| self.cube.index_of(self.scene.means[i], depth + 1) == Some(child))
                    .collect();
                if !inside.is_empty() {
                    let (child_cost, child_leaves, empty) = self.solve(&inside, child, depth + 1);
                    cost += child_cost;
                    leaves.extend(child_leaves);
                    occupied += usize::from(!empty);
                }
            }
            if occupied == 0 {
                // What is empty needs no flag.
                cost -= if flagged { o.lambda * c.go_on } else { 0.0 };
            } else {
                cost += o.lambda * c.occupancy[occupied - 1];
            }
            if cost < best.0 {
                best = (cost, leaves, occupied == 0);
            }
        }
        if let Some(drop) = o.drop {
            let cost = drop * members.iter().map(|&i| self.weights[i].1).sum::<f64>();
            if cost < best.0 {
                best = (cost, Vec::new(), true);
            }
        }
        best
    }
}

#[test]
fn pruning_is_the_optimum() {
    for (seed, len) in [(1, 1), (2, 2), (3, 40), (4, 150)] {
        let scene = clustered(len, seed);
        let cube = cube(&scene);
        for lambda in [1e-4, 1e-2, 0.3] {
            for (j_low, drop) in [(0, None), (3, None), (0, Some(1.0)), (2, Some(30.0))] {
                let cost = CostModel { gaussian: 30.0, ..CostModel::default() };
                let o =
                    RateDistortion { j_low, j_high: 8, drop, cost, ..RateDistortion::new(lambda) };
                let all: Vec<usize> = (0..len).collect();
                let (_, leaves, _) = Naive::new(&scene, &cube, &o).solve(&all, [0; 3], 0);
                let got = voxelize(&scene, &cube, &Strategy::RateDistortion(o)).unwrap();
                assert_eq!(got.octree().leaves(), leaves, "{seed} {lambda} {j_low} {drop:?}");
            }
        }
    }
}

/// A greater lambda never gives more leaves; 0 gives the full octree's accuracy.
#[test]
fn lambda_orders_the_results() {
    let scene = clustered(5000, 9);
    let cube = cube(&scene);
    let count = |lambda: f64| {
        let o = RateDistortion { j_high: 14, ..RateDistortion::new(lambda) };
        voxelize(&scene, &cube, &Strategy::RateDistortion(o)).unwrap().len()
    };
    let counts: Vec<_> = [0.0, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 1e6].map(count).to_vec();
    assert!(counts.is_sorted_by(|a, b| a >= b), "{counts:?}");
    let full = voxelize(&scene, &cube, &Strategy::Uniform { depth: 14 }).unwrap();
    assert!(counts[0] as f64 >= 0.999 * full.len() as f64);
    assert_eq!(*counts.last().unwrap(), 1);
}

/// Counts recorded from the authors' own voxelizer on the same models.
#[test]
fn released_reproduces_the_recorded_counts() {
    // `adaptive7` to `adaptive10` of each scene's paper-chain.json.
    for (scene, j_low, recorded) in [
        ("fox", 7, 73_977),
        ("fox", 8, 79_364),
        ("fox", 9, 94_338),
        ("bonsai", 9, 133_479),
        ("bonsai", 10, 146_694),
    ] {
        let Some(path) = shared(&format!("scenes/{scene}/point_cloud.ply")) else { return };
        let (scene, _) = gs_model::ply::read(&path).unwrap();
        let v = voxelize(
            &scene,
            &voxel::cube_of(&scene.means).unwrap(),
            &Strategy::Released(ReleasedRule::new(j_low)),
        )
        .unwrap();
        eprintln!(
            "{path:?}: {} leaves, recorded {recorded}, j_high {}",
            v.len(),
            v.octree().depth()
        );
        // Rounding of f32 decides a few Gaussians on cell faces: 1 of 133,479 and 3 of 146,694 differ.
        assert!(v.len().abs_diff(recorded) <= 3, "{} for {recorded}", v.len());
        // Theirs is 12 in all of these; ours has one level more, for the upper faces.
        assert_eq!(v.octree().depth(), 13);
    }
}
