//! Random scenes, and the hash that identifies one.

use gs_model::Scene;
use sha2::{Digest, Sha256};

use crate::Rng;

/// A scene of `n` Gaussians that looks like a trained one: seven clusters, a spread of scales and
/// opacities, small SH coefficients above degree 0.
pub fn trained_like(n: usize, sh_degree: u8, r: &mut Rng) -> Scene {
    let mut scene = Scene { sh_degree, ..Scene::default() };
    for i in 0..n {
        let centre = (i % 7) as f32;
        scene.means.push([centre + 0.3 * r.signed(), r.signed() * r.signed(), 0.1 * r.signed()]);
        scene.rotations.push(std::array::from_fn(|_| r.signed() + 0.01));
        let log_size = -4.0 + r.signed();
        scene.log_scales.push(std::array::from_fn(|_| log_size + 1.5 * r.signed()));
        scene.opacity_logits.push(4.0 * r.signed());
        for k in 0..scene.sh_len() {
            let amplitude = if k == 0 { 1.0 } else { 0.05 };
            scene.sh.push(std::array::from_fn(|_| amplitude * r.signed()));
        }
    }
    scene
}

/// A scene of `n` Gaussians in clusters of seven, of three spreads, with SH degree 1. Means are
/// multiples of 2^-20, so that translating them by a power of two is exact.
pub fn clustered(n: usize, r: &mut Rng) -> Scene {
    let mut scene = Scene { sh_degree: 1, ..Scene::default() };
    let mut centre = [0.0; 3];
    for i in 0..n {
        if i % 7 == 0 {
            centre = std::array::from_fn(|_| r.signed_exact());
        }
        let spread = [0.5, 0.0625, 0.000_976_562_5][i % 3];
        scene.means.push(std::array::from_fn(|k| {
            let x: f32 = centre[k] + spread * r.signed_exact();
            (x * 1_048_576.0).round() / 1_048_576.0
        }));
        scene.rotations.push(std::array::from_fn(|_| r.signed_exact() + 0.01));
        scene.log_scales.push(std::array::from_fn(|_| -4.0 + 2.0 * r.signed_exact()));
        scene.opacity_logits.push(3.0 * r.signed_exact());
        for _ in 0..scene.sh_len() {
            scene.sh.push(std::array::from_fn(|_| r.signed_exact()));
        }
    }
    scene
}

/// The scene with SH degrees 2 and 3 that mostly follow from the degree below, as in trained
/// models. What does not follow is the old value, a tenth as large.
pub fn with_related_degrees(mut scene: Scene) -> Scene {
    let k = scene.sh_len();
    for sh in scene.sh.chunks_exact_mut(k) {
        for c in 4..k {
            let below = if c < 9 { 1 + c % 3 } else { 4 + c % 5 };
            sh[c] = std::array::from_fn(|rgb| 0.8 * sh[below][rgb] + 0.1 * sh[c][rgb]);
        }
    }
    scene
}

/// The scene with three of its Gaussians moved a million units away, and their indices. The scene
/// has at least three Gaussians.
pub fn with_floaters(mut scene: Scene) -> (Scene, [usize; 3]) {
    let at = [scene.len() / 7, scene.len() / 2, scene.len() - 1];
    scene.means[at[0]] = [1e6, 0.3, -0.7];
    scene.means[at[1]] = [0.1, -1.1e6, 0.2];
    scene.means[at[2]] = [-2e5, 3.3, 1e6];
    (scene, at)
}

/// SHA-256, in hexadecimal, of all floats in little-endian order: means, rotations, log-scales,
/// opacity logits, SH. The hashes of `fixtures/streams` are of this form.
#[must_use]
pub fn sha256(scene: &Scene) -> String {
    let mut sha = Sha256::new();
    let parts: [&[f32]; 5] = [
        scene.means.as_flattened(),
        scene.rotations.as_flattened(),
        scene.log_scales.as_flattened(),
        &scene.opacity_logits,
        scene.sh.as_flattened(),
    ];
    for part in parts {
        part.iter().for_each(|v| sha.update(v.to_le_bytes()));
    }
    sha.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

/// What a golden stream says beside its floats: the third column of `fixtures/streams/hashes.txt`, empty for most.
#[must_use]
pub fn marks(scene: &Scene) -> String {
    let [x, y, z] = scene.origin;
    match (scene.antialiased, scene.origin != [0.0; 3]) {
        (false, false) => String::new(),
        (antialiased, _) => format!("antialiased {antialiased}, origin {x} {y} {z}"),
    }
}

/// A binary PLY of one element `vertex` with these columns, all floats.
#[must_use]
pub fn float_ply(comments: &str, columns: &str, rows: &[Vec<f32>]) -> Vec<u8> {
    let columns = columns.split_whitespace().map(|name| format!("property float {name}\n"));
    let columns: String = columns.collect();
    let start =
        format!("ply\nformat binary_little_endian 1.0\n{comments}element vertex {}\n", rows.len());
    let mut out = (start + &columns + "end_header\n").into_bytes();
    out.extend(rows.iter().flatten().flat_map(|v| v.to_le_bytes()));
    out
}

/// The columns of a lite model of SpaceTime Gaussians, as its trainer writes them.
pub const SPACETIME: &str = "x y z trbf_center trbf_scale nx ny nz motion_0 motion_1 motion_2 motion_3 motion_4 \
    motion_5 motion_6 motion_7 motion_8 f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 \
    omega_0 omega_1 omega_2 omega_3";

#[cfg(test)]
mod tests {
    use super::*;

    /// Recorded once: golden streams are made from these scenes.
    #[test]
    fn scenes_are_what_they_were() {
        let hash = |scene: &Scene| sha256(scene)[..16].to_owned();
        assert_eq!(hash(&trained_like(600, 3, &mut Rng::seeded(42))), "bb28e051eaf80f4a");
        assert_eq!(hash(&clustered(200, &mut Rng::seeded(1))), "15a12e44a486ac08");
    }

    #[test]
    fn scenes_are_valid() {
        let scene = trained_like(50, 3, &mut Rng::seeded(3));
        scene.validate().unwrap();
        let (floaters, at) = with_floaters(with_related_degrees(scene));
        floaters.validate().unwrap();
        assert!(at.iter().all(|&i| floaters.means[i].iter().any(|x| x.abs() > 1e5)));
        clustered(50, &mut Rng::seeded(3)).validate().unwrap();
    }
}
