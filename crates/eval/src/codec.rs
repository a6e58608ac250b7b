//! The measurement: a codec, a scene and qualities in, a rate-distortion curve out.

use std::time::Instant;

use anyhow::{Context, Result};
use finetune::TrainView;
use gs_model::Scene;
use gsvx::EncodeOptions;
use serde::{Deserialize, Serialize};

use crate::bd::{self, Method};
use crate::measure::{self, Score};
use crate::progress::Bar;
use crate::scenes::TestScene;

/// A codec under test.
pub trait Codec {
    /// Its name in tables and legends.
    fn name(&self) -> String;

    /// Encodes the model of `scene`. A greater `quality` gives a larger stream; a codec with one
    /// setting ignores it. The training cameras may be used, the held-out views must not be.
    ///
    /// # Errors
    /// Those of the codec.
    fn encode(&self, scene: &TestScene, quality: f32) -> Result<Vec<u8>>;

    /// Decodes a stream, from nothing but its bytes.
    ///
    /// # Errors
    /// Those of the codec.
    fn decode(&self, stream: &[u8]) -> Result<Scene>;

    /// The size that counts for the rate: the length of the stream, unless its authors count
    /// otherwise.
    ///
    /// # Errors
    /// If the stream is not one of this codec.
    fn counted_bytes(&self, stream: &[u8]) -> Result<u64> {
        Ok(stream.len() as u64)
    }
}

/// One stream, decoded and compared with the photos.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CodedPoint {
    /// What the codec was asked for.
    pub quality: f32,
    /// Size of the stream.
    pub bytes: u64,
    /// Gaussians decoded.
    pub gaussians: usize,
    /// Quality of the decoded model at the held-out views.
    pub score: Score,
    /// Wall-clock seconds to encode.
    pub encode_seconds: f64,
    /// Wall-clock seconds to decode.
    pub decode_seconds: f64,
}

/// The points of one codec on one scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CodecCurve {
    /// Name of the codec.
    pub codec: String,
    /// One point per quality, in the order asked for.
    pub points: Vec<CodedPoint>,
}

impl CodecCurve {
    /// Sizes in bytes with PSNRs.
    #[must_use]
    pub fn rates(&self) -> Vec<bd::Point> {
        let point = |p: &CodedPoint| bd::Point { rate: p.bytes as f64, psnr_db: p.score.psnr_db };
        self.points.iter().map(point).collect()
    }

    /// Mean difference in bytes at equal PSNR against `anchor` (the [`CodecCurve::rates`] of another curve,
    /// or the [`rates`](crate::published::Other::rates) of a recorded one), per cent, between the
    /// convex hulls by monotone interpolation. Negative: this curve is smaller. `None` if the two
    /// share no range of PSNR or have fewer than two points on their hulls.
    #[must_use]
    pub fn bd_rate(&self, anchor: &[bd::Point]) -> Option<f64> {
        bd::bd_rate(&bd::hull(anchor), &bd::hull(&self.rates()), Method::Pchip)
    }
}

/// Measures `codec` on `scene` at each quality.
///
/// # Errors
/// Those of the codec.
pub fn curve(codec: &dyn Codec, scene: &TestScene, qualities: &[f32]) -> Result<CodecCurve> {
    let points = qualities.iter().map(|&quality| measure_point(codec, scene, quality));
    Ok(CodecCurve { codec: codec.name(), points: points.collect::<Result<_>>()? })
}

/// Measures `codec` on `scene` at one quality.
///
/// # Errors
/// Those of the codec.
pub fn measure_point(codec: &dyn Codec, scene: &TestScene, quality: f32) -> Result<CodedPoint> {
    let label = format!("{}, quality {quality:.0}", codec.name());
    let encode = || codec.encode(scene, quality);
    let trip = round_trip(&label, &scene.held_out, encode, |stream| codec.decode(stream))?;
    Ok(CodedPoint {
        quality,
        bytes: codec.counted_bytes(&trip.stream)?,
        gaussians: trip.decoded.len(),
        score: trip.score,
        encode_seconds: trip.encode_seconds,
        decode_seconds: trip.decode_seconds,
    })
}

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

/// This project's codec with its defaults.
pub struct Gsvx {
    importance: Option<Vec<f32>>,
}

impl Gsvx {
    /// Importances come from the training cameras of `scene`, and what they do not see is left out. The
    /// codec is then for that scene only.
    #[must_use]
    pub fn with_cameras(scene: &TestScene) -> Self {
        let seen = || finetune::saliency(&scene.model, &scene.training).squared;
        Self { importance: (!scene.training.is_empty()).then(seen) }
    }

    /// Importances are guessed from opacity and size.
    #[must_use]
    pub fn without_cameras() -> Self {
        Self { importance: None }
    }
}

impl Codec for Gsvx {
    fn name(&self) -> String {
        let cameras = if self.importance.is_some() { "with" } else { "without" };
        format!("gsvx, {cameras} cameras")
    }

    fn encode(&self, scene: &TestScene, quality: f32) -> Result<Vec<u8>> {
        let mut options = EncodeOptions::from_quality(quality)?;
        options.importance.clone_from(&self.importance);
        options.drop_unseen = true;
        Ok(gsvx::encode(&scene.model, &options)?.bytes)
    }

    fn decode(&self, stream: &[u8]) -> Result<Scene> {
        Ok(gsvx::decode(stream)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_rises_and_cameras_make_it_smaller() {
        let scene = TestScene::open("room", 1).unwrap();
        let qualities = [30.0, 60.0, 90.0];
        let guessed = curve(&Gsvx::without_cameras(), &scene, &qualities).unwrap();
        let seen = curve(&Gsvx::with_cameras(&scene), &scene, &qualities).unwrap();
        for c in [&guessed, &seen] {
            let rises = |w: &[CodedPoint]| {
                w[0].bytes < w[1].bytes && w[0].score.psnr_db < w[1].score.psnr_db
            };
            assert!(c.points.windows(2).all(rises), "{c:?}");
        }
        let rate = seen.bd_rate(&guessed.rates()).unwrap();
        assert!(rate < -10.0, "{rate}");
    }
}
