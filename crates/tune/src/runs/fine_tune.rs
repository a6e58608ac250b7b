//! [`FineTune`]: the paper's fine-tune. Means stay at the centres of the voxels, and bits have no price.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[cfg(feature = "gpu")]
use finetune::Adapter;
use finetune::{Backend, BackendReport, Loss, TrainView, ViewLoss};
use gs_model::Scene;

use crate::checkpoint::{StateReader, StateWriter, fingerprint};
use crate::epochs::Epochs;
use crate::error::{Error, Result};
use crate::progress::{Progress, StageName, StopReason};
use crate::scene_loop::SceneLoop;
use crate::targets::camera_and_photo;
use crate::trainer::{RunState, Trainer, Work};
use crate::views::Views;

/// How to fine-tune.
#[derive(Clone, Debug)]
pub struct FineTuneOptions {
    /// Largest number of steps; one view each. The paper uses 8000.
    pub steps: u64,
    /// What is minimised.
    pub loss: Loss,
    /// Stop when the mean PSNR over a pass over the views, each as rendered in its step, reaches this
    /// many dB: usually what the model had before voxelization.
    pub target_psnr: Option<f64>,
    /// Stop when so many passes have brought no more than 0.01 dB.
    pub patience: Option<u32>,
    /// Seed of the order of the views.
    pub seed: u64,
    /// Where to keep a checkpoint. An existing one is continued; the number of steps and the rules for stopping may
    /// differ.
    pub checkpoint: Option<PathBuf>,
    /// Steps between checkpoints, at least 1. If a GPU fails, the run goes back this far.
    pub checkpoint_every: u64,
    /// Setting it ends the run after the current step.
    pub cancel: Option<Arc<AtomicBool>>,
    /// Where the steps are made.
    pub backend: Backend,
}

impl Default for FineTuneOptions {
    fn default() -> Self {
        Self {
            steps: 8000,
            loss: Loss::L1_SSIM,
            target_psnr: None,
            patience: None,
            seed: 0,
            checkpoint: None,
            checkpoint_every: 1000,
            cancel: None,
            backend: Backend::Cpu,
        }
    }
}

/// The result of a fine-tune.
#[derive(Clone, Debug)]
pub struct FineTuneOutcome {
    /// The scene with its new attributes; means and order as given.
    pub scene: Scene,
    /// Steps done in all, including those before a resumption.
    pub steps: u64,
    /// Wall-clock seconds of this run.
    pub seconds: f64,
    /// Why the run ended.
    pub reason: StopReason,
    /// Mean PSNR over each whole pass over the views, each as rendered in its step, dB.
    pub pass_psnr: Vec<f64>,
    /// Where the run ended, and why there.
    pub backend: BackendReport,
}

/// A fine-tune of the attributes of one scene.
///
/// Means are frozen; nothing is added, removed or reset (the reference implementation resets
/// opacities every 3000 steps, which hurts a mature model). The result is a function of the
/// scene, the views and the options alone, whatever the number of threads.
pub struct FineTune {
    trainer: Trainer,
    work: Attributes,
}

impl std::fmt::Debug for FineTune {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Trainer { backend, done, .. } = &self.trainer;
        f.debug_struct("FineTune").field("backend", backend).field("done", done).finish()
    }
}

impl FineTune {
    /// Prepares a run. If the options name a checkpoint that exists, the run goes on from it.
    ///
    /// # Errors
    /// Those of [`Error`], but for [`Error::Codec`].
    pub fn new(scene: Scene, views: Vec<TrainView>, options: FineTuneOptions) -> Result<Self> {
        scene.validate()?;
        let FineTuneOptions { loss, seed, backend, checkpoint, cancel, .. } = options.clone();
        for weight in [loss.l1, loss.mse, loss.ssim] {
            if !(weight.is_finite() && weight >= 0.0) {
                let (value, range) = (weight.into(), "0 or more");
                return Err(Error::Option { option: "weight of the loss", value, range });
            }
        }
        let told = format!("attributes {loss:?} {seed}");
        let fingerprint = fingerprint(&scene, views.iter().map(camera_and_photo), &told);
        let views = Views::all(views, loss, seed)?;
        let mut trainer = Trainer::new(views, fingerprint, backend, checkpoint, cancel)?;
        let mut work = Attributes::new(scene, trainer.views.gradients.views(), options);
        trainer.resume(&mut work)?;
        Ok(Self { trainer, work })
    }

    /// Where the steps are made, and why there.
    #[must_use]
    pub fn backend(&self) -> &BackendReport {
        &self.trainer.backend
    }

    /// Steps already done by the run whose checkpoint this one goes on from.
    #[must_use]
    pub fn steps_done(&self) -> u64 {
        self.trainer.done
    }

    /// Runs to the end, calling `progress` now and then, and once more at the end. In every case the state at the
    /// end is kept in the checkpoint, if there is one.
    ///
    /// If a GPU fails under [`Backend::Auto`], the processor goes on from the last state that was kept. A checkpoint
    /// that cannot be written does not end the run: see [`Progress::checkpoint_failed`].
    ///
    /// # Errors
    /// [`Error::Interrupted`]; [`Error::Finetune`] if a GPU that was asked for fails.
    pub fn run(self, mut progress: impl FnMut(&Progress<'_>)) -> Result<FineTuneOutcome> {
        let Self { mut trainer, mut work } = self;
        let reason = trainer.run(&mut work, &mut progress)?;
        trainer.keep(&work);
        progress(&trainer.progress(&work, work.run.psnr));
        Ok(FineTuneOutcome {
            scene: work.run.take_scene()?,
            steps: trainer.done,
            seconds: trainer.clock.seconds(),
            reason,
            pass_psnr: work.epochs.past,
            backend: trainer.backend,
        })
    }
}

/// The scene whose attributes a [`FineTune`] moves.
struct Attributes {
    options: FineTuneOptions,
    run: SceneLoop,
    epochs: Epochs,
    views: usize,
}

impl Attributes {
    fn new(scene: Scene, views: usize, options: FineTuneOptions) -> Self {
        Self {
            run: SceneLoop::new(scene, 0.0, options.steps),
            options,
            epochs: Epochs::default(),
            views,
        }
    }

    fn add(&mut self, losses: &[ViewLoss]) {
        losses.iter().for_each(|loss| self.epochs.add(loss.psnr(), self.views));
    }

    /// The losses of the steps that a device has made.
    fn listen(&mut self) -> Result<()> {
        let losses = self.run.losses()?;
        self.add(&losses);
        Ok(())
    }
}

impl Work for Attributes {
    fn steps(&self) -> u64 {
        self.options.steps
    }

    fn advance(&mut self, _: &mut Views) -> Result<Option<StopReason>> {
        if self.run.done >= self.run.steps {
            return Ok(Some(StopReason::Steps));
        }
        if self.run.done.is_multiple_of(self.views as u64) {
            self.listen()?;
        }
        Ok(self.epochs.stop(self.options.target_psnr, self.options.patience))
    }

    fn due(&self) -> bool {
        self.run.done.is_multiple_of(self.options.checkpoint_every.max(1))
    }

    /// Fetches what a device has made since the last time.
    fn measure(&mut self, _: &Views) -> Result<()> {
        self.listen()?;
        self.run.fetch()
    }

    fn place(&mut self, views: &mut Views) -> Result<()> {
        #[cfg(feature = "gpu")]
        self.run.place(Adapter::Hardware, &views.gradients)?;
        let _ = views;
        Ok(())
    }

    fn step(&mut self, views: &mut Views, view: usize) -> Result<f64> {
        let losses = self.run.step(&mut views.gradients, view)?;
        self.add(&losses);
        Ok(self.run.psnr)
    }

    fn fetch(&mut self, views: &Views) -> Result<()> {
        self.measure(views)?;
        self.run.leave_device()
    }

    fn write(&self, out: &mut StateWriter) {
        out.numbers(&self.epochs.past);
        out.numbers(&self.epochs.current);
        self.run.write(out);
    }

    fn read(&mut self, input: &mut StateReader<'_>, _: &mut Views) -> Result<()> {
        let (past, current) = (input.numbers()?, input.numbers()?);
        // A pass ends when its length is reached, so a longer one would never end.
        if current.len() >= self.views {
            return Err(input.error("more steps in a pass than views"));
        }
        let run = SceneLoop::read(input, 0.0, self.options.steps)?;
        if run.optimiser.scene().means != self.run.optimiser.scene().means {
            return Err(input.error("other means"));
        }
        (self.epochs, self.run) = (Epochs { past, current }, run);
        Ok(())
    }

    fn state(&self) -> RunState<'_> {
        RunState {
            stage: StageName::Attributes,
            scene: self.run.optimiser.scene(),
            aside_psnr: None,
            pass_psnr: self.epochs.psnr(),
            bytes: None,
        }
    }
}
