//! The hash of decoded floats.

use gs_model::Scene;
use sha2::{Digest, Sha256};

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
