//! [`Encoder`]: the one way from a model to a stream, whatever the stream aims for.

mod assemble;
mod bounded;
mod check;
mod coarse;
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
mod source;
mod strategy;
mod survey;
mod tiled;
mod warning;

pub use check::check_values;
pub use encode::encode_voxels;
pub use encoded::{CoarseCells, Encoded, LEFT_OUT};
pub use exact::encode_lossless;
pub use join::{Joined, join};
pub use measure::Measure;
pub use options::{DEFAULT_QUALITY, EncodeOptions, Leaves, MaxError, Seen};
pub use plan::{Choices, Plan};
pub use prepare::{Prepared, encode, prepare, prune};
pub use preset::Preset;
pub use strategy::default_strategy;
pub use survey::Survey;
pub use warning::{EncodeWarning, Missed};

use crate::error::{Error, Result};
use gs_model::Scene;
use rate::Found;
use std::ops::ControlFlow;
use warning::warnings;

/// What a stream aims for.
pub enum Aim<'a> {
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
        /// The value of a decoded scene, for example by `finetune::References`.
        value: Box<dyn FnMut(&Scene) -> f64 + 'a>,
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
    Made(f32, &'a Encoded),
}

type OnProgress<'a> = Box<dyn FnMut(EncodeProgress<'_>) -> ControlFlow<()> + 'a>;

/// Makes streams of scenes in memory.
///
/// ```
/// use gsvx::{Aim, Encoder, Scene};
///
/// # fn main() -> gsvx::Result<()> {
/// let model = Scene::default();
/// let mut encoder = Encoder::new(Aim::Bytes(1_000_000));
/// encoder.options.lod = true;
/// let made = encoder.encode(&model)?;
/// made.warnings.iter().for_each(|warning| eprintln!("{warning}"));
/// let decoded = gsvx::decode(&made.encoded.bytes)?;
/// # assert_eq!(decoded, model);
/// # Ok(())
/// # }
/// ```
pub struct Encoder<'a> {
    aim: Aim<'a>,
    /// What is kept, and what cameras see. Quality, steps and bounds on errors follow from the aim.
    pub options: EncodeOptions,
    progress: Option<OnProgress<'a>>,
}

/// A stream, and what is to be said of it.
#[derive(Clone, Debug, Default)]
pub struct Made {
    /// The stream.
    pub encoded: Encoded,
    /// Its quality, unless errors are bounded.
    pub quality: Option<f32>,
    /// The value of the measure that was aimed for.
    pub measured: Option<(Measure, f64)>,
    /// Streams that were encoded to find it.
    pub encodes: usize,
    /// Why it misses its aim, if it does. It comes as near as a stream can.
    pub missed: Option<Missed>,
    /// What its user should know.
    pub warnings: Vec<EncodeWarning>,
}

impl<'a> Encoder<'a> {
    /// With default options.
    #[must_use]
    pub fn new(aim: Aim<'a>) -> Self {
        Self { aim, options: EncodeOptions::default(), progress: None }
    }

    /// Calls `progress` before and after each stream. If that breaks, encoding ends with [`Error::Cancelled`].
    pub fn on_progress(
        &mut self,
        progress: impl FnMut(EncodeProgress<'_>) -> ControlFlow<()> + 'a,
    ) {
        self.progress = Some(Box::new(progress));
    }

    /// Encodes a scene.
    ///
    /// # Errors
    /// As [`crate::encode`] and [`crate::encode_lossless`]; [`Error::Cancelled`].
    pub fn encode(&mut self, scene: &Scene) -> Result<Made> {
        let Self { aim, options, progress } = self;
        let mut tell = |event: EncodeProgress<'_>| match progress.as_mut().map(|tell| tell(event)) {
            Some(ControlFlow::Break(())) => Err(Error::Cancelled),
            _ => Ok(()),
        };
        options.max_error = if let Aim::MaxError(bounds) = aim { Some(*bounds) } else { None };
        let mut at = |quality: f32| {
            let options = options.at_quality(quality)?;
            tell(EncodeProgress::Begins(quality))?;
            let encoded = encode(scene, &options)?;
            tell(EncodeProgress::Made(quality, &encoded))?;
            Ok(encoded)
        };
        let mut made = match aim {
            Aim::Lossless => {
                return Ok(Made { encoded: encode_lossless(scene, false)?, ..Made::default() });
            }
            Aim::Quality(quality) => {
                let (encoded, quality) = (at(*quality)?, Some(*quality));
                Made { encoded, quality, encodes: 1, ..Made::default() }
            }
            Aim::MaxError(_) => {
                Made { encoded: at(options.quality)?, encodes: 1, ..Made::default() }
            }
            Aim::Bytes(most) => {
                let found = rate::to_bytes(*most, at)?;
                let smallest = found.encoded.bytes.len() as u64;
                let missed = Missed::Bytes { wanted: *most, smallest };
                Made::of(found, None, missed)
            }
            Aim::Alike { measure, target, value } => {
                let (measure, wanted) = (*measure, *target);
                let value = |encoded: &Encoded| Ok(value(&encoded.decode()?));
                let found = rate::to_measure(measure, wanted, at, value)?;
                let best = found.measured.unwrap_or(f64::NAN);
                Made::of(found, Some(measure), Missed::Alike { measure, wanted, best })
            }
        };
        made.warnings = warnings(scene, &made.encoded);
        Ok(made)
    }

    /// What a [`crate::Plan`] has to know, for a scene larger than memory. `by_cameras` tells whether importances
    /// will come from cameras.
    ///
    /// # Errors
    /// [`Error::NotAtScale`] names an option that needs the whole scene in memory.
    pub fn choices(&self, by_cameras: bool) -> Result<Choices> {
        let options = &self.options;
        let (quality, option) = match self.aim {
            Aim::Quality(quality) => (quality, None),
            Aim::Bytes(_) => (0.0, Some("a target size")),
            Aim::Alike { .. } => (0.0, Some("a target PSNR or SSIMULACRA2")),
            Aim::MaxError(_) => (0.0, Some("a bound on the errors")),
            Aim::Lossless => (0.0, Some("lossless coding")),
        };
        let option = match options {
            _ if option.is_some() => option,
            o if o.prune > 0.0 => Some("pruning"),
            o if o.leaves != Leaves::RateDistortion => Some("another voxelization"),
            o if o.uniform_precision => Some("uniform precision"),
            _ => None,
        };
        if let Some(option) = option {
            return Err(Error::NotAtScale { option });
        }
        let seen = options.seen(by_cameras);
        let EncodeOptions { max_sh_degree, chunk_leaves, lod, .. } = *options;
        Ok(Choices { quality, max_sh_degree, chunk_leaves, seen, lod })
    }
}

impl Made {
    /// The result of a search.
    fn of(found: Found<Encoded>, measure: Option<Measure>, missed: Missed) -> Self {
        let Found { encoded, quality, encodes, measured, reached } = found;
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
        let made = Encoder::new(Aim::Bytes(3000)).encode(&scene).unwrap();
        assert!(made.encoded.bytes.len() <= 3000 && made.encodes > 1 && made.missed.is_none());
        let made = Encoder::new(Aim::Bytes(10)).encode(&scene).unwrap();
        assert!(matches!(made.missed, Some(Missed::Bytes { wanted: 10, .. })));
        let value = Box::new(|scene: &Scene| scene.len() as f64);
        let aim = Aim::Alike { measure: Measure::Psnr, target: 1e9, value };
        let made = Encoder::new(aim).encode(&scene).unwrap();
        assert!(matches!(made.missed, Some(Missed::Alike { .. })) && made.quality == Some(100.0));
        let bounds = MaxError::all(0.1);
        let made = Encoder::new(Aim::MaxError(bounds)).encode(&scene).unwrap();
        assert!(made.encoded.max_error.is_some_and(|e| e.mean <= 0.1));
        let made = Encoder::new(Aim::Lossless).encode(&scene).unwrap();
        assert_eq!(made.encoded.exact(), scene.len());
        let refused = Encoder::new(Aim::Quality(101.0)).encode(&scene);
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
        assert!(matches!(encoder.encode(&scene()), Err(Error::Cancelled)));
        drop(encoder);
        assert_eq!(made, 2);
    }

    #[test]
    fn a_plan_refuses_what_needs_the_whole_scene() {
        for aim in [Aim::Bytes(1), Aim::Lossless, Aim::MaxError(MaxError::all(1.0))] {
            assert!(matches!(Encoder::new(aim).choices(false), Err(Error::NotAtScale { .. })));
        }
        let mut encoder = Encoder::new(Aim::Quality(70.0));
        encoder.options.for_web();
        let choices = encoder.choices(true).unwrap();
        assert_eq!((choices.quality, choices.lod, choices.seen), (70.0, true, Seen::ByCameras));
        encoder.options.prune = 0.1;
        assert!(matches!(encoder.choices(true), Err(Error::NotAtScale { option: "pruning" })));
    }
}
