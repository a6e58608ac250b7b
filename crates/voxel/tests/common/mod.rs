//! Scenes for the tests.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::path::PathBuf;

use gs_model::Scene;
use voxel::{CostModel, Cube, Importance, RateDistortion, Released, Strategy};

/// A small random generator (splitmix64).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [-1, 1), on a lattice of 2^-20 so that translations by integers are exact.
    pub(crate) fn unit(&mut self) -> f32 {
        (self.next() >> 43) as f32 / (1u32 << 20) as f32 - 1.0
    }
}

/// Clusters of Gaussians of mixed sizes, SH degree 1.
pub(crate) fn clustered(len: usize, seed: u64) -> Scene {
    let mut r = Random(seed);
    let mut scene = Scene { sh_degree: 1, ..Scene::default() };
    let mut centre = [0.0; 3];
    for i in 0..len {
        if i % 7 == 0 {
            centre = std::array::from_fn(|_| r.unit());
        }
        let spread = [0.5, 0.0625, 0.000_976_562_5][i % 3];
        // Rounded to 2^-20, so that translating by a power of two is exact.
        scene.means.push(std::array::from_fn(|k| {
            let x = centre[k] + spread * r.unit();
            (x * 1_048_576.0).round() / 1_048_576.0
        }));
        scene.rotations.push(std::array::from_fn(|_| r.unit() + 0.01));
        scene.log_scales.push(std::array::from_fn(|_| -4.0 + 2.0 * r.unit()));
        scene.opacity_logits.push(3.0 * r.unit());
        for _ in 0..4 {
            scene.sh.push(std::array::from_fn(|_| r.unit()));
        }
    }
    scene
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
    }
}

/// Strategies of every kind, over the depths `j_low` to `j_high`.
pub(crate) fn strategies(len: usize, j_low: u8, j_high: u8) -> Vec<Strategy> {
    let rd = RateDistortion { j_low, j_high, ..RateDistortion::new(0.01) };
    let mut r = Random(len as u64);
    let given = (0..len).map(|_| r.unit().abs()).collect();
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
        Strategy::Released(Released { max_depth: j_high.min(19), ..Released::new(j_low.min(19)) }),
    ]
}

pub(crate) fn cube(scene: &Scene) -> Cube {
    Cube::of(&scene.means).expect("finite means")
}

/// A path below the shared data. If it is not there, `None`, and a line that says so.
pub(crate) fn shared(path: &str) -> Option<PathBuf> {
    let full = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared").join(path);
    if full.exists() {
        return Some(full);
    }
    eprintln!("SKIPPED: ../shared/{path} is not here");
    None
}
