//! What a running tune tells.

use crate::exit::note;
use crate::progress::Meter;
use finetune::{Backend, BackendReport};
use gs_model::chain;
use indicatif::{DecimalBytes, HumanDuration};
use std::time::Duration;
use tune::Progress;

/// A bar with what a run reports.
pub(crate) struct Follower {
    bar: Meter,
    begun: Backend,
    backend: Backend,
}

impl Follower {
    /// Follows a run of `steps` steps.
    pub(crate) fn new(steps: u64, backend: &BackendReport) -> Self {
        let (bar, begun) = (Meter::new("tune", steps as usize), backend.used);
        Self { bar, begun, backend: begun }
    }

    pub(crate) fn see(&mut self, p: &Progress<'_>) {
        if let Some(error) = p.checkpoint_failed {
            self.say(&format!("warning: {}; the run goes on without checkpoints", chain(error)));
        }
        if p.backend != self.backend {
            self.say("the GPU failed: going on without it");
            self.backend = p.backend;
        }
        self.bar.set(p.step, line(p));
    }

    /// Writes a line without disturbing the bar.
    pub(crate) fn say(&self, text: &str) {
        self.bar.say(text);
    }

    /// The run has ended there.
    pub(crate) fn end(self, backend: &BackendReport) {
        let begun = self.begun;
        drop(self);
        if backend.used != begun {
            note(format_args!("backend: {}", backend.reason));
        }
    }
}

/// The live line.
fn line(p: &Progress<'_>) -> String {
    let aside = p.aside_psnr.map(|db| format!(", {db:.2} dB aside"));
    let psnr = aside.or(p.pass_psnr.map(|db| format!(", {db:.2} dB"))).unwrap_or_default();
    let bytes = p.bytes.map(|b| format!(", {}", DecimalBytes(b))).unwrap_or_default();
    let left = duration(p.eta_seconds);
    format!("{}: {} Gaussians{psnr}{bytes}, {left} left", p.stage, p.gaussians)
}

/// Seconds as a person reads them.
pub(crate) fn duration(seconds: f64) -> HumanDuration {
    HumanDuration(Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX))
}
