//! What the golden streams are made from.

use super::{scene, with_floaters, with_related_degrees};
use gs_model::Scene;
use gsvx::{EncodeOptions, Leaves, encode, encode_lossless};
use std::num::NonZeroUsize;

const SEED: u64 = 42;

/// The quality of most; the default may change.
fn usual() -> EncodeOptions {
    EncodeOptions::from_quality(60.0).expect("a quality")
}

/// Options for chunks of at most `leaves` leaves.
fn in_chunks(leaves: usize) -> EncodeOptions {
    let mut options = usual();
    options.chunk_leaves = NonZeroUsize::new(leaves).expect("a positive number");
    options
}

/// Names and bytes.
pub(crate) fn streams() -> Vec<(String, Vec<u8>)> {
    let default = usual();
    let mut lod = in_chunks(100);
    lod.lod = true;
    // Many leaves in few bytes.
    lod.steps = EncodeOptions::from_quality(10.0).expect("a quality").steps;
    let high = EncodeOptions::from_quality(85.0).expect("a quality");
    let plain = |n, degree| scene(n, degree, SEED);
    let coded = |scene: &Scene, options| encode(scene, options).expect("a valid scene").bytes;
    let exact = |scene: &Scene, keep| encode_lossless(scene, keep).expect("a scene").bytes;
    lod.leaves = Leaves::Uniform { depth: 10 };
    let mut uniform = default.clone();
    uniform.leaves = lod.leaves;
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
        ("predicted", coded(&with_related_degrees(plain(900, 3)), &high)),
        ("chunks", coded(&plain(1500, 1), &in_chunks(300))),
        ("lod", coded(&plain(12_000, 0), &lod)),
        ("lossless", exact(&plain(300, 2), false)),
        ("lossless-ordered", exact(&plain(100, 1), true)),
        ("antialiased", coded(&georeferenced, &default)),
    ];
    streams.map(|(name, bytes)| (format!("{name}.gsvx"), bytes)).into()
}
