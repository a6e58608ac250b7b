//! A small scene that looks like a trained one: clusters, a spread of scales and opacities.
#![allow(dead_code, reason = "each test binary uses a part")]

use gs_model::Scene;
use voxel::{Cube, Merge, Strategy, Voxelization, merge, voxelize};

/// SplitMix64, so that seeds stay valid for ever.
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

/// Three Gaussians a million units away, of any SH degree, among the others.
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

/// The golden streams: what they are made from, and the hash of what they decode to.
pub(crate) mod golden {
    use super::{scene, voxelized};
    use gs_model::Scene;
    use gsvx::{CovarianceMode, EncodeOptions, Entropy, PaperQp};
    use sha2::{Digest, Sha256};
    use std::num::NonZeroUsize;
    use voxel::Strategy;

    /// SHA-256 of all floats, little-endian: means, rotations, log-scales, opacity logits, SH.
    pub(crate) fn hash(s: &Scene) -> String {
        let mut sha = Sha256::new();
        let parts: [&[f32]; 5] = [
            s.means.as_flattened(),
            s.rotations.as_flattened(),
            s.log_scales.as_flattened(),
            &s.opacity_logits,
            s.sh.as_flattened(),
        ];
        for v in parts.concat() {
            sha.update(v.to_le_bytes());
        }
        sha.finalize().iter().map(|b| format!("{b:02x}")).collect()
    }

    /// Names and bytes.
    pub(crate) fn streams() -> Vec<(String, Vec<u8>)> {
        let mut out = Vec::new();
        let mut add = |name: &str, n, degree, strategy: Strategy, options: &EncodeOptions| {
            let (merged, voxels) = voxelized(&scene(n, degree, 42), &strategy);
            let bytes = gsvx::encode(&merged, &voxels, options).expect(name).bytes;
            out.push((format!("{name}.gsvx"), bytes));
        };
        let uniform = Strategy::Uniform { depth: 10 };
        let adaptive = Strategy::paper(4, 12);
        let base = EncodeOptions::default();
        let vq = EncodeOptions { covariance: CovarianceMode::Vq { bits: 8 }, ..base.clone() };
        let paper = EncodeOptions::paper(
            PaperQp { ac: 34, dc: 16, opacity: 16 },
            CovarianceMode::Lossless { bits: 16 },
        );
        add("empty", 0, 3, uniform.clone(), &base);
        add("one", 1, 2, uniform.clone(), &base);
        add("default", 600, 3, adaptive.clone(), &base);
        add("codebook", 500, 1, uniform.clone(), &vq);
        add("paper", 400, 3, uniform, &paper);
        let symbols = EncodeOptions { entropy: Entropy::Symbols, ..base.clone() };
        add("symbols", 600, 3, adaptive.clone(), &symbols);
        let steps = EncodeOptions::from_quality(10.0).expect("a quality").steps;
        let slices = EncodeOptions { slices: NonZeroUsize::new(2), steps, ..symbols };
        add("slices", 9000, 0, Strategy::Uniform { depth: 10 }, &slices);
        add("degree-0", 600, 0, adaptive, &base);
        let (floaters, _) = super::with_floaters(scene(400, 1, 42));
        let split = gsvx::split_outliers(&floaters).expect("finite").expect("floaters");
        let (merged, voxels) =
            voxelized(&floaters.select(&split.inside), &Strategy::Uniform { depth: 10 });
        let outliers = Some(floaters.select(&split.outliers));
        let options = EncodeOptions { outliers, ..base };
        let bytes = gsvx::encode(&merged, &voxels, &options).expect("outliers").bytes;
        out.push(("outliers.gsvx".into(), bytes));
        let related = super::with_related_degrees(scene(700, 3, 42));
        let (merged, voxels) = voxelized(&related, &Strategy::Uniform { depth: 10 });
        let options = EncodeOptions::from_quality(85.0).expect("a quality");
        let bytes = gsvx::encode(&merged, &voxels, &options).expect("predicted").bytes;
        out.push(("predicted.gsvx".into(), bytes));
        let lossless = gsvx::encode_lossless(&scene(300, 2, 42)).expect("lossless");
        out.push(("lossless.gsvx".into(), lossless.bytes));
        out
    }
}
