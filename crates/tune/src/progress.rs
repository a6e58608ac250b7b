//! [`Progress`] and [`Outcome`].

use gs_model::Scene;
use gsvx::Encoded;

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
}

impl std::fmt::Display for StageName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Round { round, rounds } => write!(f, "pruning {round}/{rounds}"),
            Self::CodecInTheLoop => f.write_str("codec in the loop"),
        }
    }
}

/// A report from a running tune.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// What it is doing.
    pub stage: StageName,
    /// Steps done, of both stages together.
    pub step: u64,
    /// Steps of the whole run.
    pub steps: u64,
    /// Gaussians at present.
    pub gaussians: usize,
    /// PSNR of the last step's view, dB. A GPU tells it every 48 steps.
    pub psnr: f64,
    /// PSNR at the views kept aside when it was last measured, dB.
    pub aside_psnr: Option<f64>,
    /// Bytes of the stream, with the codec in the loop.
    pub bytes: Option<u64>,
    /// Seconds since the start or the resumption.
    pub seconds: f64,
    /// Seconds to the end at this speed.
    pub eta_seconds: f64,
    /// The scene of the last step: with the codec in the loop, what a decoder would return. A GPU tells it every 48
    /// steps.
    pub scene: &'a Scene,
    /// Why the checkpoint could not be written, the first time that it could not.
    pub checkpoint_failed: Option<&'a crate::Error>,
}

/// The result of a tune.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The stream.
    pub encoded: Encoded,
    /// What a decoder returns for it.
    pub scene: Scene,
    /// The bytes that the loop counted.
    pub counted_bytes: u64,
    /// PSNR of the input model at the views kept aside, dB.
    pub input_psnr: f64,
    /// PSNR of [`Outcome::scene`] at the same views, dB.
    pub psnr: f64,
    /// Final quality.
    pub quality: f32,
    /// Gaussians coded exactly, among those of the scene.
    pub outliers: usize,
    /// Steps done in all.
    pub steps: u64,
    /// Wall-clock seconds of this run.
    pub seconds: f64,
    /// Whether the run was cut short.
    pub cancelled: bool,
    /// Whether the stream reaches the target.
    pub reached: bool,
}
