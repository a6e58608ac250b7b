//! A small scene that looks like a trained one: clusters, a spread of scales and opacities.
#![allow(dead_code, reason = "each test binary uses a part")]

use gs_model::Scene;
use voxel::{Cube, Merge, Strategy, Voxelization, merge, voxelize};

/// SplitMix64, so that seeds stay valid for ever.
pub struct Rng(pub u64);

impl Rng {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in -1..1.
    pub fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }
}

pub fn scene(n: usize, sh_degree: u8, seed: u64) -> Scene {
    let mut r = Rng(seed);
    let mut scene = Scene { sh_degree, ..Default::default() };
    for i in 0..n {
        let centre = (i % 7) as f32;
        scene.means.push([centre + 0.3 * r.unit(), r.unit() * r.unit(), 0.1 * r.unit()]);
        scene.rotations.push(std::array::from_fn(|_| r.unit() + 0.01));
        let size = -4.0 + r.unit();
        scene.log_scales.push(std::array::from_fn(|_| size + 1.5 * r.unit()));
        scene.opacity_logits.push(4.0 * r.unit());
        for k in 0..scene.sh_len() {
            let amplitude = if k == 0 { 1.0 } else { 0.05 };
            scene.sh.push(std::array::from_fn(|_| amplitude * r.unit()));
        }
    }
    scene
}

pub fn voxelized(scene: &Scene, strategy: &Strategy) -> (Scene, Voxelization) {
    let cube = Cube::of(&scene.means).unwrap();
    let voxels = voxelize(scene, &cube, strategy).unwrap();
    (merge(scene, &voxels, Merge::Moments).unwrap(), voxels)
}
