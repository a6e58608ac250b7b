//! What the golden streams are made from.

use super::{scene, with_floaters, with_related_degrees};
use gs_model::Scene;
use gsvx::{EncodeOptions, Leaves, encode, encode_lossless};
use std::num::NonZeroUsize;

const SEED: u64 = 42;

/// The quality of most; the default may change.
const QUALITY: f32 = 60.0;

/// Options for chunks of at most `leaves` leaves.
fn in_chunks(leaves: usize) -> EncodeOptions {
    let mut options = EncodeOptions::default();
    options.code.chunk_leaves = NonZeroUsize::new(leaves).expect("a positive number");
    options
}

/// Names and bytes.
pub(crate) fn streams() -> Vec<(String, Vec<u8>)> {
    let default = EncodeOptions::default();
    let mut uniform = default;
    uniform.prepare.leaves = Leaves::Uniform { depth: 10 };
    // Many leaves in few bytes.
    let mut lod = EncodeOptions { prepare: uniform.prepare, ..in_chunks(100) };
    lod.code.lod = true;
    let plain = |n, degree| scene(n, degree, SEED);
    let coded_at = |quality, scene: &Scene, options| {
        encode(scene, None, quality, options).expect("a valid scene").bytes
    };
    let coded = |scene: &Scene, options| coded_at(QUALITY, scene, options);
    let exact = |scene: &Scene, keep| encode_lossless(scene, keep).expect("a scene").bytes;
    let mut georeferenced = with_floaters(plain(200, 1)).0;
    georeferenced.antialiased = true;
    georeferenced.origin = [448_200.25, 5_411_900.5, -46.125];
    let streams = [
        ("empty", coded(&plain(0, 3), &default)),
        ("one", coded(&plain(1, 2), &default)),
        ("default", coded(&plain(600, 3), &default)),
        ("degree-0", coded(&plain(600, 0), &default)),
        ("uniform", coded(&plain(500, 2), &uniform)),
        ("outliers", coded(&with_floaters(plain(400, 1)).0, &default)),
        ("predicted", coded_at(85.0, &with_related_degrees(plain(900, 3)), &default)),
        ("chunks", coded(&plain(1500, 1), &in_chunks(300))),
        ("lod", coded_at(10.0, &plain(12_000, 0), &lod)),
        ("lossless", exact(&plain(300, 2), false)),
        ("lossless-ordered", exact(&plain(100, 1), true)),
        ("antialiased", coded(&georeferenced, &default)),
    ];
    streams.map(|(name, bytes)| (format!("{name}.gsvx"), bytes)).into()
}
