//! [`Progress`] and [`TuneOutcome`].

use finetune::metrics::Scores;
use finetune::{Backend, BackendReport};
use gs_model::Scene;
use gsvx::EncodedStream;

use crate::views::AgainstInput;

/// What a run is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StageName {
    /// A round of pruning and recovery.
    Round {
        /// Counted from 1.
        round: u64,
        /// Rounds in all.
        rounds: u64,
    },
    /// The codec in the loop.
    CodecInTheLoop,
    /// The fine-tune of attributes, without a codec.
    Attributes,
    /// The training of a model from points.
    Training,
}

impl std::fmt::Display for StageName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Round { round, rounds } => write!(f, "pruning {round}/{rounds}"),
            Self::CodecInTheLoop => f.write_str("codec in the loop"),
            Self::Attributes => f.write_str("attributes"),
            Self::Training => f.write_str("training"),
        }
    }
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// All steps are done.
    Steps,
    /// The target PSNR was reached.
    TargetReached,
    /// The PSNR stopped improving.
    NoImprovement,
    /// The cancellation flag was set.
    Cancelled,
}

/// In plain words, for messages.
impl std::fmt::Display for StopReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Steps => "all steps are done",
            Self::TargetReached => "the photos are matched as well as asked for",
            Self::NoImprovement => "the match no longer improves",
            Self::Cancelled => "interrupted",
        })
    }
}

/// A report from a run.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// What it is doing.
    pub stage: StageName,
    /// Steps done, of all stages together.
    pub step: u64,
    /// Steps of the whole run, at most.
    pub steps: u64,
    /// Gaussians at present.
    pub gaussians: usize,
    /// PSNR of the last step's view, dB. A GPU tells it now and then.
    pub psnr: f64,
    /// PSNR at the views kept aside when it was last measured, dB.
    pub aside_psnr: Option<f64>,
    /// Mean PSNR over the last pass over the views, each as rendered in its step, dB; in the first pass over the
    /// steps so far. Of [`StageName::Attributes`] and [`StageName::Training`].
    pub pass_psnr: Option<f64>,
    /// Bytes of the stream, with the codec in the loop.
    pub bytes: Option<u64>,
    /// Seconds since the start or the resumption.
    pub seconds: f64,
    /// Seconds to the end, by the forecast of the run and its speed so far.
    pub eta_seconds: f64,
    /// The scene of the last step: with the codec in the loop, what a decoder would return. A GPU tells it now and
    /// then.
    pub scene: &'a Scene,
    /// Where the last step was made: it changes if a GPU fails under [`Backend::Auto`].
    pub backend: Backend,
    /// Why the checkpoint could not be written. Only the first report after that has it: no other is written.
    pub checkpoint_failed: Option<&'a crate::Error>,
}

/// The result of a tune.
#[derive(Clone, Debug)]
pub struct TuneOutcome {
    /// The stream.
    pub encoded: EncodedStream,
    /// What a decoder returns for it.
    pub scene: Scene,
    /// The bytes that the loop counted.
    pub counted_bytes: u64,
    /// Scores of the input model at the views kept aside.
    pub input_scores: Scores,
    /// Scores of [`TuneOutcome::scene`] at the same views.
    pub scores: Scores,
    /// How well the scene shows what the input model shows, also where no photo was taken.
    pub against_input: Option<AgainstInput>,
    /// Final quality.
    pub quality: f32,
    /// Gaussians coded exactly, among those of the scene.
    pub outliers: usize,
    /// Steps done in all.
    pub steps: u64,
    /// Wall-clock seconds of this stream.
    pub seconds: f64,
    /// Where the run ended, and why there.
    pub backend: BackendReport,
    /// Whether the run was cut short.
    pub cancelled: bool,
    /// Whether the stream reaches the target.
    pub reached: bool,
}
