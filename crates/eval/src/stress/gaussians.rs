//! Scenes cut to an SH degree, and compared bit for bit.

use gs_model::Scene;
use sha2::{Digest, Sha256};

/// The scene at another SH degree: coefficients are cut, or zeros are added.
pub(super) fn of_degree(scene: &Scene, sh_degree: u8) -> Scene {
    let mut out = Scene { sh_degree, ..Scene::default() };
    out.append(scene);
    out
}

/// Hashes of the bits of every Gaussian.
pub(super) fn rows(s: &Scene) -> Vec<[u8; 16]> {
    (0..s.len())
        .map(|i| {
            let mut sha = Sha256::new();
            let parts: [&[f32]; 5] = [
                &s.means[i],
                &s.rotations[i],
                &s.log_scales[i],
                &s.opacity_logits[i..=i],
                s.sh_of(i).as_flattened(),
            ];
            parts.concat().iter().for_each(|v| sha.update(v.to_bits().to_le_bytes()));
            let mut row = [0; 16];
            row.copy_from_slice(&sha.finalize()[..16]);
            row
        })
        .collect()
}
