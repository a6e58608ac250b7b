//! What a running tune tells, whatever its profile.

use crate::output::megabytes;
use crate::progress::Steps;
use anyhow::anyhow;
use finetune::{Backend, BackendReport};
use std::path::Path;
use tune::Progress;

/// A bar with what a run reports.
pub(crate) struct Follower {
    steps: Steps,
    backend: Backend,
}

impl Follower {
    /// Of a run of so many steps.
    pub(crate) fn new(steps: u64, backend: &BackendReport) -> Self {
        Self { steps: Steps::new("tune", steps), backend: backend.used }
    }

    pub(crate) fn see(&mut self, p: &Progress<'_>) {
        if let Some(error) = p.checkpoint_failed {
            let text = gs_model::chain(error);
            self.say(&format!("warning: {text}; the run goes on without checkpoints"));
        }
        if p.backend != self.backend {
            self.say("the GPU failed: going on without it");
            self.backend = p.backend;
        }
        self.steps.set(p.step, &line(p));
    }

    /// Writes a line without disturbing the bar.
    pub(crate) fn say(&self, text: &str) {
        self.steps.say(text);
    }
}

/// The live line.
fn line(p: &Progress<'_>) -> String {
    let aside = p.aside_psnr.map(|db| format!(", {db:.2} dB aside"));
    let psnr = aside.or(p.pass_psnr.map(|db| format!(", {db:.2} dB"))).unwrap_or_default();
    let bytes = p.bytes.map(|b| format!(", {}", megabytes(b))).unwrap_or_default();
    let left = duration(p.eta_seconds);
    format!("{}: {} Gaussians{psnr}{bytes}, {left} left", p.stage, p.gaussians)
}

pub(crate) fn duration(seconds: f64) -> String {
    if seconds < 90.0 {
        format!("{:.0} s", seconds.max(1.0))
    } else {
        format!("{:.0} min", seconds / 60.0)
    }
}

/// Says what to do about a GPU that failed.
pub(crate) fn gpu_hint(error: tune::Error, checkpoint: Option<&Path>) -> anyhow::Error {
    if !matches!(error, tune::Error::Finetune(finetune::Error::Gpu { .. })) {
        return error.into();
    }
    let kept = checkpoint.filter(|p| p.exists());
    let kept = kept.map(|p| format!(", from {}", p.display())).unwrap_or_default();
    anyhow!("{error}: --backend auto or cpu goes on without it{kept}")
}
