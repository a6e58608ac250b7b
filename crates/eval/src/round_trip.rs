//! What all measurements share: a stream is made, decoded, rendered at the held-out views and compared with the
//! photos.

use std::time::Instant;

use anyhow::{Context, Result};
use finetune::TrainView;
use gs_model::Scene;

use crate::measure::{self, Score};
use crate::progress::Bar;

/// A stream with what came out of it.
pub(crate) struct RoundTrip {
    pub(crate) stream: Vec<u8>,
    pub(crate) decoded: Scene,
    pub(crate) score: Score,
    pub(crate) encode_seconds: f64,
    pub(crate) decode_seconds: f64,
    pub(crate) render_seconds: f64,
}

/// Encodes, decodes, renders at `views` and compares with the photos. `label` names the progress.
pub(crate) fn round_trip(
    label: &str,
    views: &[TrainView],
    encode: impl FnOnce() -> Result<Vec<u8>>,
    decode: impl FnOnce(&[u8]) -> Result<Scene>,
) -> Result<RoundTrip> {
    let (stream, encode_seconds) = timed(encode);
    let stream = stream.with_context(|| format!("encode {label}"))?;
    let (decoded, decode_seconds) = timed(|| decode(&stream));
    let decoded = decoded.with_context(|| format!("decode {label}"))?;
    let bar = Bar::new(&format!("render {label}"), views.len() as u64);
    let (score, _) = measure::score(&decoded, views, &bar);
    let render_seconds = bar.done();
    Ok(RoundTrip { stream, decoded, score, encode_seconds, decode_seconds, render_seconds })
}

/// The result of `work` and its wall-clock seconds.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let value = work();
    (value, start.elapsed().as_secs_f64())
}
