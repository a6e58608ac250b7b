//! [`Progress`] and [`Outcome`], and the [`Tracker`] that computes them.

use std::time::Instant;

use gs_model::Scene;

use super::options::FineTuneOptions;
use crate::backend::{Backend, BackendReport};
use crate::stages::loss::LossValue;

/// A report from a running fine-tune.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Steps done.
    pub step: u64,
    /// Steps that the run will do at most.
    pub steps: u64,
    /// Mean loss over the last epoch's worth of steps (or as many as there were).
    pub loss: f64,
    /// Mean PSNR in dB over the same steps, each view as rendered in its step.
    pub psnr: f64,
    /// Steps per second since the start or the resumption.
    pub steps_per_second: f64,
    /// Seconds to the last step at this speed.
    pub eta_seconds: f64,
    /// Which executor did the last step: it changes if the GPU fails under [`Backend::Auto`].
    pub backend: Backend,
}

/// Why a fine-tune ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
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
            Self::TargetReached => "the target PSNR is reached",
            Self::NoImprovement => "the PSNR no longer improves",
            Self::Cancelled => "cancelled",
        })
    }
}

/// The result of a fine-tune.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The scene with its new attributes; means and order as given.
    pub scene: Scene,
    /// Steps done in all, including those before a resumption.
    pub steps: u64,
    /// Wall-clock seconds of this run.
    pub seconds: f64,
    /// Why the run ended.
    pub reason: StopReason,
    /// Mean PSNR over each whole epoch, each view as rendered in its step, dB.
    pub epoch_psnr: Vec<f64>,
    /// Which executor finished the run, and why.
    pub backend: BackendReport,
}

/// Losses of the current epoch and PSNRs of the past ones.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tracker {
    pub(crate) views: usize,
    /// Losses and PSNRs of the last `views` steps, as a ring.
    recent: Vec<(f64, f64)>,
    next: usize,
    pub(crate) epochs: Vec<f64>,
    /// PSNRs of the steps of the epoch that is under way.
    pub(crate) current: Vec<f64>,
}

impl Tracker {
    pub(crate) fn new(views: usize) -> Self {
        Self { views, recent: Vec::new(), next: 0, epochs: Vec::new(), current: Vec::new() }
    }

    /// Continues from what a checkpoint holds.
    pub(crate) fn resume(&mut self, epochs: Vec<f64>, current: Vec<f64>) {
        (self.epochs, self.current) = (epochs, current);
    }

    pub(crate) fn add(&mut self, loss: LossValue) {
        // A perfect view would make the mean infinite. 100 dB is beyond what 8-bit photos allow.
        let psnr = (-10.0 * libm::log10(loss.mse)).min(100.0);
        if self.recent.len() < self.views {
            self.recent.push((loss.loss, psnr));
        } else {
            self.recent[self.next] = (loss.loss, psnr);
            self.next = (self.next + 1) % self.views;
        }
        self.current.push(psnr);
        if self.current.len() == self.views {
            self.epochs.push(self.current.iter().sum::<f64>() / self.views as f64);
            self.current.clear();
        }
    }

    /// Why the run ends at the end of an epoch, if it does.
    pub(crate) fn stop(&self, options: &FineTuneOptions) -> Option<StopReason> {
        if !self.current.is_empty() {
            return None;
        }
        let last = *self.epochs.last()?;
        if options.target_psnr.is_some_and(|target| last >= target) {
            return Some(StopReason::TargetReached);
        }
        let patience = options.patience? as usize;
        let since = self.epochs.len().checked_sub(patience)?;
        let best = |e: &[f64]| e.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let (before, after) = self.epochs.split_at(since);
        let stale = !before.is_empty() && best(after) < best(before) + options.min_gain_db;
        stale.then_some(StopReason::NoImprovement)
    }

    pub(crate) fn progress(
        &self,
        step: u64,
        first: u64,
        started: Instant,
        options: &FineTuneOptions,
        backend: Backend,
    ) -> Progress {
        let n = self.recent.len().max(1) as f64;
        let seconds = started.elapsed().as_secs_f64().max(1e-9);
        let steps_per_second = (step - first) as f64 / seconds;
        Progress {
            step,
            steps: options.steps,
            loss: self.recent.iter().map(|r| r.0).sum::<f64>() / n,
            psnr: self.recent.iter().map(|r| r.1).sum::<f64>() / n,
            steps_per_second,
            eta_seconds: options.steps.saturating_sub(step) as f64 / steps_per_second,
            backend,
        }
    }

    pub(crate) fn outcome(
        self,
        scene: Scene,
        steps: u64,
        started: Instant,
        reason: StopReason,
        backend: BackendReport,
    ) -> Outcome {
        let seconds = started.elapsed().as_secs_f64();
        Outcome { scene, steps, seconds, reason, epoch_psnr: self.epochs, backend }
    }
}
