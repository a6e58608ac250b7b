//! What the golden streams are made from.

use super::{scene, with_floaters, with_related_degrees};
use gs_model::Scene;
use gsvx::sequence::{Sequence, is_sequence};
use gsvx::{
    EncodeOptions, Leaves, SequenceEncoder, SequenceOptions, decode, encode, encode_lossless,
};
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

/// Frames in which the Gaussians of a model turn about y, and a quarter moves by itself and changes; `births` leaves out
/// another tenth in each frame.
pub(crate) fn frames(n: usize, sh_degree: u8, count: usize, births: bool) -> Vec<Scene> {
    let model = scene(n, sh_degree, SEED);
    let frame = |t: usize| {
        let mut frame = model.clone();
        let (sin, cos) = (libm::sinf(0.05 * t as f32), libm::cosf(0.05 * t as f32));
        for i in 0..n {
            let own = if i % 4 == 0 { 0.02 * libm::sinf(0.3 * (t + i / 100) as f32) } else { 0.0 };
            let [x, y, z] = frame.means[i];
            frame.means[i] = [cos * x + sin * z, y + own, cos * z - sin * x];
            frame.opacity_logits[i] += 20.0 * own;
            let dc = i * frame.sh_len();
            frame.sh[dc][0] += 5.0 * own;
        }
        let there = |i: &usize| !births || t == 0 || i % 10 != t % 10;
        frame.select(&(0..n).filter(there).collect::<Vec<_>>())
    };
    (0..count).map(frame).collect()
}

/// A sequence of frames.
pub(crate) fn sequence(frames: Vec<Scene>, quality: f32, group: usize) -> Vec<u8> {
    let options = SequenceOptions { quality, group, ..SequenceOptions::default() };
    let mut encoder = SequenceEncoder::new(options).expect("valid options");
    frames.into_iter().for_each(|frame| encoder.push(frame).expect("a valid frame"));
    encoder.finish().expect("a sequence")
}

/// Names and bytes of sequences.
pub(crate) fn sequences() -> Vec<(String, Vec<u8>)> {
    let streams = [
        ("tracked", sequence(frames(400, 1, 12, false), QUALITY, 8)),
        ("births", sequence(frames(400, 0, 10, true), QUALITY, 60)),
    ];
    streams.map(|(name, bytes)| (format!("{name}.gsvx"), bytes)).into()
}

/// The Gaussians of a stream, or of all frames of a sequence.
pub(crate) fn decoded(bytes: &[u8]) -> Scene {
    if !is_sequence(bytes) {
        return decode(bytes).expect("a golden stream");
    }
    let sequence = Sequence::parse(bytes).expect("a golden sequence");
    let mut all = Scene::default();
    for number in 0..sequence.groups.len() {
        let group = sequence.group(bytes, number, None).expect("a golden group");
        for frame in (0..group.len()).map(|t| group.frame(t)) {
            if all.is_empty() {
                all.sh_degree = frame.sh_degree;
            }
            all.append(&frame);
        }
    }
    all
}
