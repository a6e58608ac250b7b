//! Scenes as a number that programs in other languages compute too.

use gs_model::Scene;
use gsvx::{DecodeOptions, decode_with};

/// Adds a number to those before it.
#[must_use]
pub fn join(digest: u32, number: u32) -> u32 {
    digest.rotate_left(5) ^ number
}

/// What a decoder makes of a whole stream with default options, then with salvage; 0 for a stream that is refused.
#[must_use]
pub fn scenes(bytes: &[u8]) -> [u32; 2] {
    [false, true].map(|salvage| {
        let mut options = DecodeOptions::default();
        options.salvage = salvage;
        decode_with(bytes, &options).map_or(0, |decoded| of(&decoded.scene))
    })
}

/// 1, then the CRC-32 of each array, joined.
fn of(scene: &Scene) -> u32 {
    let arrays: [&[f32]; 5] = [
        scene.means.as_flattened(),
        scene.rotations.as_flattened(),
        scene.log_scales.as_flattened(),
        &scene.opacity_logits,
        scene.sh.as_flattened(),
    ];
    arrays.into_iter().fold(1, |digest, floats| {
        let mut crc = crc32fast::Hasher::new();
        floats.iter().for_each(|v| crc.update(&v.to_le_bytes()));
        join(digest, crc.finalize())
    })
}
