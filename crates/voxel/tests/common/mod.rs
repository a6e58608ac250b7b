//! Scenes for the tests.
#![allow(dead_code, reason = "each test file uses its own part")]

use gs_model::Scene;
use testing::Rng;
use voxel::{CostModel, Cube, Importance, RateDistortion, ReleasedRule, Strategy, cube_of};

/// Clusters of Gaussians of mixed sizes, SH degree 1.
pub(crate) fn clustered(len: usize, seed: u64) -> Scene {
    testing::clustered(len, &mut Rng::seeded(seed))
}

/// A scene of plain Gaussians at given means.
pub(crate) fn at(means: &[[f32; 3]], log_scale: f32) -> Scene {
    let len = means.len();
    Scene {
        means: means.to_vec(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; len],
        log_scales: vec![[log_scale; 3]; len],
        opacity_logits: vec![0.0; len],
        sh_degree: 0,
        sh: vec![[0.5; 3]; len],
        ..Scene::default()
    }
}

/// One of every kind, over the depths `j_low` to `j_high`.
pub(crate) fn strategies(len: usize, j_low: u8, j_high: u8) -> Vec<Strategy> {
    let rd = RateDistortion { j_low, j_high, ..RateDistortion::new(0.01) };
    let mut r = Rng::seeded(len as u64);
    let given = (0..len).map(|_| r.signed_exact().abs()).collect();
    vec![
        Strategy::Uniform { depth: j_high },
        Strategy::Uniform { depth: j_low },
        Strategy::paper(j_low, j_high),
        Strategy::Paper { large_percent: 0.0, j_low, j_high, tau1: 2, tau2: 1.0 },
        Strategy::RateDistortion(rd.clone()),
        Strategy::RateDistortion(RateDistortion { lambda: 0.0, ..rd.clone() }),
        Strategy::RateDistortion(RateDistortion { lambda: 1e3, ..rd.clone() }),
        Strategy::RateDistortion(RateDistortion {
            importance: Importance::Given(given),
            size_exponent: 0.5,
            cost: CostModel { gaussian: 20.0, ..CostModel::default() },
            drop: Some(0.5),
            ..rd
        }),
        Strategy::Released(ReleasedRule {
            max_depth: j_high.min(19),
            ..ReleasedRule::new(j_low.min(19))
        }),
    ]
}

pub(crate) fn cube(scene: &Scene) -> Cube {
    cube_of(&scene.means).expect("finite means")
}
