//! The fine-tune: it fits the attributes to the photos and keeps the means.

mod checkpoint;
mod cpu;
pub(crate) mod executor;
pub(crate) mod options;
mod progress;
pub(crate) mod view;

use std::sync::atomic::Ordering;
use std::time::Instant;

use gs_model::Scene;

pub(crate) use checkpoint::Checkpoint;
use executor::Executor;
pub use options::FineTuneOptions;
use progress::Tracker;
pub use progress::{Outcome, Progress, StopReason};
pub use view::TrainView;
use view::check_views;

use crate::backend::{self, Backend, BackendReport};
use crate::error::{Error, Result};
use crate::shuffle::permutation;
use crate::stages::adam::AdamStep;
#[cfg(all(test, feature = "gpu"))]
use crate::stages::adam::Moments;
use crate::stages::loss::LossValue;

/// A fine-tune of one scene on a set of photos.
///
/// Means are frozen; nothing is added, removed or reset (the reference implementation resets
/// opacities every 3000 steps, which hurts a mature model). The result is a function of the
/// scene, the views and the options alone, whatever the number of threads.
///
/// If the GPU fails, is lost or runs out of memory, a run under [`Backend::Auto`] continues in Rust
/// from the last kept step: every [`FineTuneOptions::checkpoint_every`] steps, with or
/// without a checkpoint file. Under [`Backend::Gpu`] it ends with [`Error::Gpu`], and the last
/// checkpoint stays.
pub struct FineTune {
    executor: Box<dyn Executor>,
    report: BackendReport,
    options: FineTuneOptions,
    views: usize,
    fingerprint: u64,
    /// Steps done.
    step: u64,
    tracker: Tracker,
    /// What the Rust executor needs to take over from the GPU, under [`Backend::Auto`].
    fallback: Option<Fallback>,
}

/// The host's copy of a run on the GPU: the views, and the state of the last kept step.
struct Fallback {
    views: Vec<TrainView>,
    state: Checkpoint,
}

impl std::fmt::Debug for FineTune {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FineTune")
            .field("backend", &self.report)
            .field("views", &self.views)
            .field("step", &self.step)
            .finish_non_exhaustive()
    }
}

impl FineTune {
    /// Prepares a run. If [`FineTuneOptions::checkpoint`] names a file that exists, the run
    /// continues from it.
    ///
    /// # Errors
    /// [`Error::Scene`] if the scene is not valid, [`Error::NoViews`], [`Error::PhotoSize`],
    /// [`Error::ViewSize`], [`Error::DistortedView`], [`Error::Option`]; [`Error::NoAdapter`] for
    /// [`Backend::Gpu`] without one; [`Error::Io`], [`Error::Checkpoint`] and [`Error::CheckpointMismatch`] for an
    /// existing checkpoint.
    pub fn new(scene: Scene, views: Vec<TrainView>, options: FineTuneOptions) -> Result<Self> {
        Self::build(scene, views, options, backend::choose, on_gpu)
    }

    fn build(
        scene: Scene,
        views: Vec<TrainView>,
        options: FineTuneOptions,
        choose: impl FnOnce(Backend) -> Result<BackendReport>,
        on_gpu: impl FnOnce(&Checkpoint, &[TrainView], &FineTuneOptions) -> Result<Box<dyn Executor>>,
    ) -> Result<Self> {
        scene.validate()?;
        options.validate()?;
        check_views(&views)?;
        let fingerprint = checkpoint::fingerprint(&scene, &views);
        let mut start = Checkpoint::start(scene, views.len());
        if let Some(path) = options.checkpoint.as_deref().filter(|p| p.exists()) {
            start = Checkpoint::read(path, fingerprint, start)?;
        }
        let (step, count, tracker) = (start.step, views.len(), start.tracker.clone());
        let may_fall_back = options.backend == Backend::Auto;
        let mut report = choose(options.backend)?;
        let mut fallback = None;
        let executor: Box<dyn Executor> = if report.used == Backend::Gpu {
            match on_gpu(&start, &views, &options) {
                Ok(executor) => {
                    fallback = may_fall_back.then_some(Fallback { views, state: start });
                    executor
                }
                Err(Error::Gpu { reason }) if may_fall_back => {
                    report = took_over(&reason, step);
                    on_cpu(start, views, &options)
                }
                Err(e) => return Err(e),
            }
        } else {
            on_cpu(start, views, &options)
        };
        Ok(Self { executor, report, options, views: count, fingerprint, step, tracker, fallback })
    }

    /// Which executor was chosen, and why.
    #[must_use]
    pub fn backend(&self) -> &BackendReport {
        &self.report
    }

    /// Steps already done, by this run or by the one whose checkpoint it continues.
    #[must_use]
    pub fn steps_done(&self) -> u64 {
        self.step
    }

    /// Runs to the end, calling `progress` every [`FineTuneOptions::report_every`] steps.
    ///
    /// Ends after [`FineTuneOptions::steps`] steps, or earlier as the options say, or when the
    /// cancellation flag is set. In every case the last checkpoint is written, if one was asked
    /// for, and the outcome holds the scene as it is then.
    ///
    /// # Errors
    /// [`Error::Io`] if a checkpoint cannot be written; [`Error::Gpu`], but not under
    /// [`Backend::Auto`], which continues in Rust.
    pub fn run(mut self, mut progress: impl FnMut(&Progress)) -> Result<Outcome> {
        let started = Instant::now();
        let first = self.step;
        loop {
            let failure = match self.steps(first, started, &mut progress) {
                Ok((reason, end)) => {
                    let Checkpoint { step, tracker, scene, .. } = end;
                    return Ok(tracker.outcome(scene, step, started, reason, self.report));
                }
                Err(Error::Gpu { reason }) => reason,
                Err(e) => return Err(e),
            };
            let Some(Fallback { views, state }) = self.fallback.take() else {
                return Err(Error::Gpu { reason: failure });
            };
            self.report = took_over(&failure, state.step);
            (self.step, self.tracker) = (state.step, state.tracker.clone());
            self.executor = on_cpu(state, views, &self.options);
        }
    }

    /// Steps on the present executor until the run ends; returns why, and its last state.
    fn steps(
        &mut self,
        first: u64,
        started: Instant,
        progress: &mut impl FnMut(&Progress),
    ) -> Result<(StopReason, Checkpoint)> {
        let mut order = Vec::new();
        let mut losses = Vec::new();
        let reason = loop {
            if self.options.cancel.as_ref().is_some_and(|c| c.load(Ordering::Relaxed)) {
                break StopReason::Cancelled;
            }
            if self.step >= self.options.steps {
                break StopReason::Steps;
            }
            if let Some(reason) = self.tracker.stop(&self.options) {
                break reason;
            }
            let (epoch, within) = (self.step / self.views as u64, self.step % self.views as u64);
            if order.is_empty() || within == 0 {
                order = permutation(self.options.seed, epoch, self.views);
            }
            let step = self.step + 1;
            let adam = AdamStep::new(&self.options.rates, step, self.options.decay_at(step));
            self.executor.step(order[within as usize] as usize, step, &adam)?;
            self.step = step;
            let epoch_ends = within + 1 == self.views as u64;
            let reports =
                step.is_multiple_of(self.options.report_every) || step == self.options.steps;
            if reports || epoch_ends {
                self.drain(&mut losses)?;
            }
            if reports {
                let used = self.report.used;
                progress(&self.tracker.progress(step, first, started, &self.options, used));
            }
            let due = step.is_multiple_of(self.options.checkpoint_every);
            let wanted = self.fallback.is_some() || self.options.checkpoint.is_some();
            if due && wanted && step < self.options.steps {
                let state = self.checkpoint(&mut losses)?;
                match &mut self.fallback {
                    Some(fallback) => fallback.state = state,
                    None => self.executor.restore(state.scene, state.moments),
                }
            }
        };
        Ok((reason, self.checkpoint(&mut losses)?))
    }

    fn drain(&mut self, losses: &mut Vec<LossValue>) -> Result<()> {
        losses.clear();
        self.executor.drain_losses(losses)?;
        for loss in losses {
            self.tracker.add(*loss);
        }
        Ok(())
    }

    /// The state after the last step, taken from the executor and written if the options name a
    /// checkpoint file.
    fn checkpoint(&mut self, losses: &mut Vec<LossValue>) -> Result<Checkpoint> {
        self.drain(losses)?;
        let (scene, moments) = self.executor.take_state()?;
        let state = Checkpoint { step: self.step, tracker: self.tracker.clone(), moments, scene };
        if let Some(path) = &self.options.checkpoint {
            state.write(path, self.fingerprint)?;
        }
        Ok(state)
    }
}

/// The report of a run that the processor took over.
fn took_over(reason: &str, step: u64) -> BackendReport {
    let threads = rayon::current_num_threads();
    let reason = format!("cpu: the GPU failed ({reason}); from step {step} on; {threads} threads");
    BackendReport { used: Backend::Cpu, reason }
}

fn on_cpu(
    start: Checkpoint,
    views: Vec<TrainView>,
    options: &FineTuneOptions,
) -> Box<dyn Executor> {
    Box::new(cpu::CpuExecutor::new(start.scene, start.moments, views, options))
}

#[cfg(feature = "gpu")]
fn on_gpu(
    start: &Checkpoint,
    views: &[TrainView],
    options: &FineTuneOptions,
) -> Result<Box<dyn Executor>> {
    on_device(crate::gpu::Context::hardware()?, start, views, options)
}

#[cfg(not(feature = "gpu"))]
fn on_gpu(_: &Checkpoint, _: &[TrainView], _: &FineTuneOptions) -> Result<Box<dyn Executor>> {
    Err(Error::NoAdapter { reason: "built without the feature `gpu`".into() })
}

#[cfg(feature = "gpu")]
fn on_device(
    context: crate::gpu::Context,
    start: &Checkpoint,
    views: &[TrainView],
    options: &FineTuneOptions,
) -> Result<Box<dyn Executor>> {
    let (scene, moments) = (start.scene.clone(), &start.moments);
    Ok(Box::new(crate::gpu::GpuExecutor::new(context, scene, moments, views, options)?))
}

/// A run on a given device, for tests of what happens when it fails.
#[cfg(all(test, feature = "gpu"))]
pub(crate) fn fine_tune_on(
    context: crate::gpu::Context,
    scene: Scene,
    views: Vec<TrainView>,
    options: FineTuneOptions,
) -> Result<FineTune> {
    let choose = |_| Ok(BackendReport { used: Backend::Gpu, reason: "gpu: given".into() });
    FineTune::build(scene, views, options, choose, |start, views, options| {
        on_device(context, start, views, options)
    })
}

/// The Rust executor, for comparison.
#[cfg(all(test, feature = "gpu"))]
pub(crate) fn cpu_executor(
    scene: Scene,
    moments: Moments,
    views: Vec<TrainView>,
    options: &FineTuneOptions,
) -> Box<dyn Executor> {
    Box::new(cpu::CpuExecutor::new(scene, moments, views, options))
}
