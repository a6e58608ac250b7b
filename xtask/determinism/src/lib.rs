//! One text of hashes that every machine, build and number of threads must agree on.

#[path = "../../../crates/gsvx/tests/common/mod.rs"]
#[allow(dead_code, reason = "a part is used")]
mod common;

use std::fmt::Write as _;
use std::sync::OnceLock;

use gs_model::{Scene, ply};
use gsvx::{CovarianceMode, DecodeOptions, EncodeOptions, Entropy, PaperQp, Prepared};
use sha2::{Digest, Sha256};
use voxel::Strategy;

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
        for lod in [None, Some(5)] {
            let options = DecodeOptions { lod, ..Default::default() };
            let scene = gsvx::decode(bytes, &options).expect(name).scene;
            let decoded = common::golden::hash(&scene);
            let what = if lod.is_some() { ", LoD 5" } else { "" };
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

/// The fixture in every mode and voxelization.
fn streams(room: &Scene) -> Vec<(String, Vec<u8>)> {
    let base = EncodeOptions::default();
    let qp = PaperQp { ac: 28, dc: 16, opacity: 16 };
    let modes = [
        ("default", None, base.clone()),
        ("symbols", None, EncodeOptions { entropy: Entropy::Symbols, ..base.clone() }),
        ("fast", None, EncodeOptions { entropy: Entropy::Fast, ..base.clone() }),
        ("vq", None, EncodeOptions { covariance: CovarianceMode::Vq { bits: 8 }, ..base.clone() }),
        ("uniform", Some(Strategy::Uniform { depth: 11 }), base),
        (
            "paper",
            Some(Strategy::paper(8, 12)),
            EncodeOptions::paper(qp, CovarianceMode::Lossless { bits: 16 }),
        ),
    ];
    let mut out = Vec::new();
    for (name, strategy, options) in modes {
        let choose = |importance: &[f32], seen| match strategy {
            Some(strategy) => Ok(strategy),
            None => gsvx::default_strategy(gsvx::DEFAULT_QUALITY, importance, seen),
        };
        let Prepared { scene, voxels, importance } =
            gsvx::prepare(room, choose, None).expect(name);
        let options = EncodeOptions { importance: Some(importance), ..options };
        let bytes = gsvx::encode(&scene, &voxels, &options).expect(name).bytes;
        out.push((format!("room, {name}"), bytes));
    }
    let lossless = gsvx::encode_lossless(room).expect("lossless").bytes;
    out.push(("room, lossless".into(), lossless));
    out
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
