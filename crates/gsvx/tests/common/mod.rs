//! A small scene that looks like a trained one: clusters, a spread of scales and opacities.
#![allow(dead_code, reason = "each test binary uses a part")]

pub(crate) mod forge;
pub(crate) mod golden;

use gs_model::Scene;
use voxel::{Cube, Merge, Strategy, Voxelization, merge, voxelize};

/// SplitMix64, whose numbers never change.
pub(crate) struct Rng(pub(crate) u64);

impl Rng {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in -1..1.
    pub(crate) fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }
}

pub(crate) fn scene(n: usize, sh_degree: u8, seed: u64) -> Scene {
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

/// The same with SH degrees 2 and 3 that mostly follow from the degree below, as in trained models;
/// what remains is as it was, a tenth as large.
pub(crate) fn with_related_degrees(mut scene: Scene) -> Scene {
    let k = scene.sh_len();
    for sh in scene.sh.chunks_exact_mut(k) {
        for c in 4..k {
            let below = if c < 9 { 1 + c % 3 } else { 4 + c % 5 };
            sh[c] = std::array::from_fn(|rgb| 0.8 * sh[below][rgb] + 0.1 * sh[c][rgb]);
        }
    }
    scene
}

/// Moves every Gaussian onto one of three walls.
pub(crate) fn on_walls(mut scene: Scene) -> Scene {
    for (i, mean) in scene.means.iter_mut().enumerate() {
        mean[i % 3] = 0.37;
    }
    scene
}

/// Moves three of the Gaussians about a million units away.
pub(crate) fn with_floaters(mut scene: Scene) -> (Scene, [usize; 3]) {
    let at = [scene.len() / 7, scene.len() / 2, scene.len() - 1];
    scene.means[at[0]] = [1e6, 0.3, -0.7];
    scene.means[at[1]] = [0.1, -1.1e6, 0.2];
    scene.means[at[2]] = [-2e5, 3.3, 1e6];
    (scene, at)
}

pub(crate) fn voxelized(scene: &Scene, strategy: &Strategy) -> (Scene, Voxelization) {
    let cube = Cube::of(&scene.means).unwrap();
    let voxels = voxelize(scene, &cube, strategy).unwrap();
    (merge(scene, &voxels, Merge::Moments).unwrap(), voxels)
}

/// The error of a codec on one attribute.
pub(crate) struct Spread {
    pub(crate) rms: f64,
    pub(crate) largest: f64,
}

/// Root mean square and largest magnitude of `errors`.
pub(crate) fn spread(errors: impl IntoIterator<Item = f64>) -> Spread {
    let (mut square, mut largest, mut n) = (0.0, 0f64, 0usize);
    for e in errors {
        square += e * e;
        largest = largest.max(e.abs());
        n += 1;
    }
    Spread { rms: (square / n.max(1) as f64).sqrt(), largest }
}

/// Every bit of Gaussian `i`.
pub(crate) fn bits(s: &Scene, i: usize) -> Vec<u32> {
    let floats = [
        &s.means[i][..],
        &s.rotations[i],
        &s.log_scales[i],
        &[s.opacity_logits[i]],
        s.sh_of(i).as_flattened(),
    ];
    floats.concat().iter().map(|v| v.to_bits()).collect()
}

/// Runs `f` on a pool of so many threads.
pub(crate) fn on_threads<T: Send>(threads: usize, f: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(f)
}

/// A trained scene of the shared data, or the fixture; says loudly if the shared data is absent.
pub(crate) fn trained_scene(shared: &str) -> Option<Scene> {
    let path =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared").join(shared);
    if !path.exists() {
        eprintln!("SKIPPED: {} is not there", path.display());
        return None;
    }
    Some(gs_model::model::read(&path, &Default::default()).unwrap().0)
}

/// The fixture room.
pub(crate) fn room() -> Scene {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/room/point_cloud.ply");
    gs_model::ply::read(path).unwrap().0
}

/// Default options with changes.
pub(crate) fn encoding(change: impl FnOnce(&mut gsvx::EncodeOptions)) -> gsvx::EncodeOptions {
    let mut options = gsvx::EncodeOptions::default();
    change(&mut options);
    options
}

/// Default options with changes.
pub(crate) fn decoding(change: impl FnOnce(&mut gsvx::DecodeOptions)) -> gsvx::DecodeOptions {
    let mut options = gsvx::DecodeOptions::default();
    change(&mut options);
    options
}

/// A positive number of leaves.
pub(crate) fn leaves(n: usize) -> std::num::NonZeroUsize {
    std::num::NonZeroUsize::new(n).unwrap()
}
