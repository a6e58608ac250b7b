//! One text of hashes that every machine, build and number of threads must agree on.

#[path = "../../../crates/gsvx/tests/common/mod.rs"]
#[allow(dead_code, reason = "a part is used")]
mod common;

use std::fmt::Write as _;
use std::num::NonZeroUsize;
use std::sync::OnceLock;

use finetune::framing::{self, Constraints};
use gs_model::{Scene, ply};
use gsvx::{DEFAULT_QUALITY, DecodeOptions, EncodeOptions, Leaves};
use sha2::{Digest, Sha256};
use tune::{Target, Targets, Tune, TuneOptions, TunePlan};

const ROOM: &[u8] = include_bytes!("../../../fixtures/room/point_cloud.ply");

fn sha(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().take(12).map(|b| format!("{b:02x}")).collect()
}

/// Lines of `name, SHA-256 of the coded bytes, SHA-256 of the decoded floats` (12 bytes each).
///
/// # Panics
/// If something is refused.
#[must_use]
pub fn report() -> String {
    let mut text = String::new();
    let mut add = |name: &str, bytes: &[u8]| {
        let coarsest = gsvx::Index::parse(bytes).expect(name).coarsest_lod();
        for lod in 0..=coarsest {
            let mut options = DecodeOptions::default();
            options.lod = lod;
            let scene = gsvx::decode_with(bytes, &options).expect(name).scene;
            let decoded = testing::sha256(&scene);
            let what = if lod > 0 { format!(", level {lod}") } else { String::new() };
            let _ = writeln!(text, "{name}{what} {} {}", sha(bytes), &decoded[..24]);
        }
    };
    for (name, bytes) in common::golden::streams() {
        add(&name, &bytes);
    }
    let (room, _) = ply::read_bytes(ROOM).expect("fixtures/room");
    for (name, bytes) in streams(&room) {
        add(&name, &bytes);
    }
    text
}

/// The fixture in every mode.
fn streams(room: &Scene) -> Vec<(String, Vec<u8>)> {
    let default = EncodeOptions::default();
    let mut small_chunks = default;
    small_chunks.code.chunk_leaves = NonZeroUsize::new(1000).expect("a positive number");
    let mut levels = small_chunks;
    levels.code.lod = true;
    let modes = [
        ("default", default),
        ("levels of detail", levels),
        ("small chunks", small_chunks),
    ];
    let coded = |(name, options): (&str, EncodeOptions)| {
        (format!("room, {name}"), gsvx::encode(room, None, DEFAULT_QUALITY, &options).expect(name).bytes)
    };
    let mut out: Vec<(String, Vec<u8>)> = modes.into_iter().map(coded).collect();
    let mut uniform = default;
    uniform.prepare.leaves = Leaves::Uniform { depth: 11 };
    out.push(coded(("uniform", uniform)));
    let lossless = gsvx::encode_lossless(room, false).expect("lossless").bytes;
    out.push(("room, lossless".into(), lossless));
    out.push(("room, tuned".into(), tuned(room)));
    out
}

/// A short tune of the fixture to its own renders: a round of pruning, and a loop with two fits.
fn tuned(room: &Scene) -> Vec<u8> {
    let tangents = [0.6, 0.45];
    let constraints = Constraints { up: None, radius: None, elevation: None, tangents };
    let placement = framing::find(room, &constraints).expect("something to look at");
    let targets = Targets::Renders(placement.cameras(6, "tuned", [48, 36], 40.0));
    let mut options = TuneOptions::new(Target::Quality(50.0));
    options.plan =
        Some(TunePlan { quality: 50.0, fraction: 0.5, rounds: 1, round_steps: 6, loop_steps: 54 });
    let run = Tune::new(room.clone(), targets, options);
    run.expect("tune").run(|_| ()).expect("tune").encoded.bytes
}

static TEXT: OnceLock<String> = OnceLock::new();

/// For WebAssembly, which has no standard output: where the report is.
#[unsafe(no_mangle)]
pub extern "C" fn report_start() -> *const u8 {
    TEXT.get_or_init(report).as_ptr()
}

/// Its length.
#[unsafe(no_mangle)]
pub extern "C" fn report_length() -> usize {
    TEXT.get_or_init(report).len()
}
