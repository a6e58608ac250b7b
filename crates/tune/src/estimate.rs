//! [`encode_judged`]: a stream, and how much less it shows than its model.

use finetune::{LossEstimate, References, Visibility, doubted_loss, estimate_loss};
use gs_model::{Camera, Scene};
use gsvx::{Aim, DecodeOptions, Encoder, Made, Measure};
use std::convert::Infallible;

use crate::trainer::Clock;

/// A stream, and what was judged of it.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The stream.
    pub made: Made,
    /// How much less it shows than its model; `None` if nobody asked.
    pub loss: Option<LossEstimate>,
    /// The loss of the stream by the cameras' importances, if that is why they were not used.
    pub doubted: Option<LossEstimate>,
    /// How long the judgement took.
    pub seconds: f64,
}

impl Judged {
    /// A sentence, if the importances of the cameras were not used.
    #[must_use]
    pub fn doubt(&self) -> Option<String> {
        let LossEstimate { at_cameras, around } = self.doubted?;
        let around = around?.psnr;
        let found = match at_cameras.map(|at| at.psnr) {
            Some(at) => format!(
                "where these cameras look, a stream by their importances has {at:.0} dB, but around the model \
                 {around:.0} dB"
            ),
            None => format!(
                "these cameras show nothing of the model, and a stream by their importances has {around:.0} dB around it"
            ),
        };
        Some(format!("{found}; are they its own? {}", finetune::MISFIT_CAUSES))
    }
}

/// The smallest stream whose renders are so alike to renders of the input.
#[must_use]
pub fn alike(references: &References, measure: Measure, target: f64) -> Aim<'_> {
    let value = move |scene: &Scene| match measure {
        Measure::Psnr => references.psnr(scene),
        Measure::Ssimulacra2 => references.ssimulacra2(scene),
    };
    Aim::Alike { measure, target, value: Box::new(value) }
}

/// Encodes `scene`, and estimates how much less the stream shows if that is `told`.
///
/// Importances from cameras that are not the model's own destroy it. If the stream shows well to the cameras and badly to
/// views that do not depend on them ([`LossEstimate::doubts_cameras`]), it is encoded once more without these
/// importances, unless the options drop what is not seen.
///
/// # Errors
/// Those of the encoder and of the decoder.
pub fn encode_judged(
    encoder: &mut Encoder<'_>,
    scene: &Scene,
    cameras: Option<&[Camera]>,
    told: bool,
) -> gsvx::Result<Judged> {
    let made = encoder.encode(scene)?;
    let clock = Clock::start();
    // Lossless streams and bounds on errors have no quality, and no cameras can harm them.
    let refusable = encoder.options.importance.is_some()
        && !encoder.options.drop_unseen
        && made.quality.is_some();
    let version = if told || refusable { Some(decoded(&made)?) } else { None };
    let estimate = |version: &Scene| estimate_loss(scene, version, cameras);
    let loss = version.as_ref().filter(|_| told).map(estimate);
    let doubted = match (&version, loss) {
        _ if !refusable => None,
        (_, Some(loss)) => Some(loss).filter(LossEstimate::doubts_cameras),
        (Some(version), None) => doubted_loss(scene, version, cameras.unwrap_or_default()),
        (None, None) => None,
    };
    let mut judged = Judged { made, loss, doubted, seconds: clock.seconds() };
    if doubted.is_some() {
        encoder.options.importance = None;
        judged.made = encoder.encode(scene)?;
        let clock = Clock::start();
        judged.loss = if told { Some(estimate(&decoded(&judged.made)?)) } else { None };
        judged.seconds += clock.seconds();
    }
    Ok(judged)
}

/// Cameras that [`doubt`] looks from, and their greatest size, pixels.
const TRIED: usize = 24;
const TRIED_PIXELS: u32 = 120_000;

/// A sentence, if cameras seem not to be those of a model: a stream by their importances says so, see [`encode_judged`].
///
/// # Errors
/// Those of the encoder and of the decoder.
pub fn doubt(scene: &Scene, cameras: &[Camera], quality: f32) -> gsvx::Result<Option<String>> {
    let (cameras, _) = finetune::that_see(scene, cameras);
    let step = cameras.len().div_ceil(TRIED).max(1);
    let cameras: Vec<Camera> =
        cameras.into_iter().step_by(step).map(|c| c.within(TRIED_PIXELS)).collect();
    let Ok(seen) = Visibility::of(scene, &cameras, |_| Ok::<_, Infallible>(()));
    let mut encoder = Encoder::new(Aim::Quality(quality));
    encoder.options.importance = Some(seen.weights);
    let made = encoder.encode(scene)?;
    let doubted = doubted_loss(scene, &decoded(&made)?, &cameras);
    Ok(Judged { made, loss: None, doubted, seconds: 0.0 }.doubt())
}

fn decoded(made: &Made) -> gsvx::Result<Scene> {
    let mut options = DecodeOptions::default();
    options.max_gaussians = Some(u64::MAX);
    Ok(gsvx::decode_with(&made.encoded.bytes, &options)?.scene)
}
