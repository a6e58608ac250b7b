//! [`Encoder`]: the one way from a model to a stream, whatever the stream aims for.

mod assemble;
mod bounded;
mod check;
mod coarse;
mod decimate;
mod encode;
mod encoded;
mod exact;
mod join;
pub mod latents;
mod lod;
mod measure;
mod options;
mod outliers;
mod plan;
mod prepare;
mod preset;
pub mod rate;
mod sequence;
mod source;
mod strategy;
mod survey;
mod tiled;
mod warning;

pub use check::check_values;
pub use decimate::decimate;
pub use encode::encode_voxels;
pub use encoded::{CoarseCells, EncodedStream, LEFT_OUT};
pub use exact::encode_lossless;
pub use join::{JoinOutcome, join};
pub use measure::Measure;
pub use options::{
    CodeOptions, DEFAULT_QUALITY, EncodeOptions, ImportanceFrom, Leaves, MaxError, PrepareOptions,
};
pub use plan::{Choices, Plan};
pub use prepare::{VoxelScene, encode, prepare, prune};
pub use preset::Preset;
pub use sequence::{SequenceEncoder, SequenceOptions};
pub use survey::Survey;
pub use warning::{EncodeWarning, MissedAim};

use crate::error::{Error, Result};
use crate::head::Steps;
use gs_model::Scene;
use prepare::{encode_keeping, encode_within};
use rate::SearchResult;
use std::ops::ControlFlow;
use warning::warnings;

/// What a stream aims for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// A quality from 0 (smallest) to 100 (best).
    Quality(f32),
    /// The best stream of at most so many bytes.
    Bytes(u64),
    /// The smallest stream whose renders are so alike to those of its model.
    Alike {
        /// By what measure.
        measure: Measure,
        /// Its value at least.
        target: f64,
    },
    /// No Gaussian is merged, and no attribute is off by more.
    MaxError(MaxError),
    /// Every float of every Gaussian bit for bit, in another order.
    Lossless,
}

/// How far an encoder is.
#[derive(Clone, Copy, Debug)]
pub enum EncodeProgress<'a> {
    /// It begins a stream of this quality.
    Begins(f32),
    /// It has made a stream of this quality. A search makes several.
    Made(f32, &'a EncodedStream),
}

type OnProgress<'a> = Box<dyn FnMut(EncodeProgress<'_>) -> ControlFlow<()> + 'a>;
type MeasureBy<'a> = Box<dyn FnMut(Measure, &Scene) -> f64 + 'a>;

/// Makes streams of scenes in memory.
///
/// ```
/// use gsvx::{Aim, Encoder, Scene};
///
/// # fn main() -> gsvx::Result<()> {
/// let model = Scene::default();
/// let mut encoder = Encoder::new(Aim::Bytes(1_000_000));
/// encoder.options.code.lod = true;
/// let made = encoder.encode(&model, None)?;
/// made.warnings.iter().for_each(|warning| eprintln!("{warning}"));
/// let decoded = gsvx::decode(&made.encoded.bytes)?;
/// # assert_eq!(decoded, model);
/// # Ok(())
/// # }
/// ```
pub struct Encoder<'a> {
    aim: Aim,
    /// What is kept, and the layout of the stream. With bounds on errors, nothing is merged, and precision follows from
    /// the bounds; lossless coding leaves no choice.
    pub options: EncodeOptions,
    /// Keep the decoded scene of [`Aim::Quality`] in [`EncodedStream::decoded`], which saves decoding the stream.
    pub keep_decoded: bool,
    progress: Option<OnProgress<'a>>,
    measure: Option<MeasureBy<'a>>,
}

/// A stream, and what is to be said of it.
#[derive(Clone, Debug, Default)]
pub struct EncoderOutput {
    /// The stream.
    pub encoded: EncodedStream,
    /// Its quality, unless errors are bounded.
    pub quality: Option<f32>,
    /// The value of the measure that was aimed for.
    pub measured: Option<(Measure, f64)>,
    /// Streams that were encoded to find it.
    pub encodes: usize,
    /// Why it misses its aim, if it does. It comes as near as a stream can.
    pub missed: Option<MissedAim>,
    /// What its user should know.
    pub warnings: Vec<EncodeWarning>,
}

impl<'a> Encoder<'a> {
    /// With default options.
    #[must_use]
    pub fn new(aim: Aim) -> Self {
        let options = EncodeOptions::default();
        Self { aim, options, keep_decoded: false, progress: None, measure: None }
    }

    /// Measures decoded scenes by `measure` for [`Aim::Alike`], as `tune::encode` does with renders of the model.
    pub fn measure_by(&mut self, measure: impl FnMut(Measure, &Scene) -> f64 + 'a) {
        self.measure = Some(Box::new(measure));
    }

    /// Calls `progress` before and after each stream. If that breaks, encoding ends with [`Error::Cancelled`].
    pub fn on_progress(
        &mut self,
        progress: impl FnMut(EncodeProgress<'_>) -> ControlFlow<()> + 'a,
    ) {
        self.progress = Some(Box::new(progress));
    }

    /// Encodes a scene. `importance` is as for [`crate::encode`].
    ///
    /// # Errors
    /// As [`crate::encode`] and [`crate::encode_lossless`]; [`Error::Cancelled`]; [`Error::NotMeasured`].
    pub fn encode(&mut self, scene: &Scene, importance: Option<&[f32]>) -> Result<EncoderOutput> {
        let Self { aim, options, keep_decoded, progress, measure } = self;
        let keep = *keep_decoded && matches!(aim, Aim::Quality(_));
        let mut tell = |event: EncodeProgress<'_>| match progress.as_mut().map(|tell| tell(event)) {
            Some(ControlFlow::Break(())) => Err(Error::Cancelled),
            _ => Ok(()),
        };
        let mut at = |quality: f32| {
            Steps::of_quality(quality)?;
            tell(EncodeProgress::Begins(quality))?;
            let encoded = encode_keeping(scene, importance, quality, options, keep)?;
            tell(EncodeProgress::Made(quality, &encoded))?;
            Ok(encoded)
        };
        let mut made = match *aim {
            Aim::Lossless => {
                return Ok(EncoderOutput {
                    encoded: encode_lossless(scene, false)?,
                    ..EncoderOutput::default()
                });
            }
            Aim::Quality(quality) => {
                let (encoded, quality) = (at(quality)?, Some(quality));
                EncoderOutput { encoded, quality, encodes: 1, ..EncoderOutput::default() }
            }
            Aim::MaxError(bounds) => {
                tell(EncodeProgress::Begins(DEFAULT_QUALITY))?;
                let encoded = encode_within(scene, importance, &bounds, options)?;
                tell(EncodeProgress::Made(DEFAULT_QUALITY, &encoded))?;
                EncoderOutput { encoded, encodes: 1, ..EncoderOutput::default() }
            }
            Aim::Bytes(most) => {
                let found = rate::to_bytes(most, at)?;
                let smallest = found.encoded.bytes.len() as u64;
                let missed = MissedAim::Bytes { wanted: most, smallest };
                EncoderOutput::of(found, None, missed)
            }
            Aim::Alike { measure: by, target } => {
                let measure = measure.as_mut().ok_or(Error::NotMeasured)?;
                let value = |encoded: &EncodedStream| Ok(measure(by, &encoded.decode()?));
                let found = rate::to_measure(by, target, at, value)?;
                let best = found.measured.unwrap_or(f64::NAN);
                let missed = MissedAim::Alike { measure: by, wanted: target, best };
                EncoderOutput::of(found, Some(by), missed)
            }
        };
        made.warnings = warnings(scene, &made.encoded);
        Ok(made)
    }
}

impl EncoderOutput {
    /// The result of a search.
    fn of(found: SearchResult<EncodedStream>, measure: Option<Measure>, missed: MissedAim) -> Self {
        let SearchResult { encoded, quality, encodes, measured, reached } = found;
        Self {
            encoded,
            quality: Some(quality),
            measured: measure.zip(measured),
            encodes,
            missed: (!reached).then_some(missed),
            warnings: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Scene {
        testing::trained_like(500, 1, &mut testing::Rng::seeded(1))
    }

    #[test]
    fn each_aim_is_reached_or_said_to_be_missed() {
        let scene = scene();
        let made = Encoder::new(Aim::Bytes(3000)).encode(&scene, None).unwrap();
        assert!(made.encoded.bytes.len() <= 3000 && made.encodes > 1 && made.missed.is_none());
        let made = Encoder::new(Aim::Bytes(10)).encode(&scene, None).unwrap();
        assert!(matches!(made.missed, Some(MissedAim::Bytes { wanted: 10, .. })));
        let mut encoder = Encoder::new(Aim::Alike { measure: Measure::Psnr, target: 1e9 });
        assert!(matches!(encoder.encode(&scene, None), Err(Error::NotMeasured)));
        encoder.measure_by(|_, scene| scene.len() as f64);
        let made = encoder.encode(&scene, None).unwrap();
        assert!(
            matches!(made.missed, Some(MissedAim::Alike { .. })) && made.quality == Some(100.0)
        );
        let bounds = MaxError::all(0.1);
        let made = Encoder::new(Aim::MaxError(bounds)).encode(&scene, None).unwrap();
        assert!(made.encoded.max_error.is_some_and(|e| e.mean <= 0.1));
        let made = Encoder::new(Aim::Lossless).encode(&scene, None).unwrap();
        assert_eq!(made.encoded.exact(), scene.len());
        let refused = Encoder::new(Aim::Quality(101.0)).encode(&scene, None);
        assert!(matches!(refused, Err(Error::Option { option: "quality", .. })));
    }

    #[test]
    fn a_search_can_be_cancelled() {
        let mut encoder = Encoder::new(Aim::Bytes(3000));
        let mut made = 0;
        encoder.on_progress(|event| {
            made += u32::from(matches!(event, EncodeProgress::Made(..)));
            if made == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        assert!(matches!(encoder.encode(&scene(), None), Err(Error::Cancelled)));
        drop(encoder);
        assert_eq!(made, 2);
    }
}
