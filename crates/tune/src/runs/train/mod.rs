//! [`Train`]: a model from photos and the points of a COLMAP model.
//!
//! It is MCMC training (see [`mcmc`]) in fewer steps. The number of Gaussians grows to its cap in the first half of the
//! run. SH degrees are learned one after the other. Large photos are first matched at a smaller size and then in
//! windows, so a step costs about the same on photos of any size.
//!
//! With bonsai, 180,000 Gaussians and 7500 steps it reaches 30.07 dB at the held-out photos. `gsplat` 1.5.3 from the same
//! photos and points reaches 28.7 dB with the rates of its MCMC example, 29.4 dB with those here, and 30.3 dB after
//! 20,000 steps. With 11,000 steps it is 30.56 dB here.

mod begin;
mod mcmc;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use finetune::optimiser::{Shrinkage, SplitMix, permutation};
use finetune::{Backend, LearningRates, Loss, RenderOptions, TrainView, ViewGradients};
use gs_model::Scene;
use gs_model::colmap::Point;

use crate::checkpoint::{StateReader, StateWriter, fingerprint};
use crate::epochs::Epochs;
use crate::error::{Error, Result};
use crate::photos::smaller;
use crate::progress::{Progress, StageName, StopReason};
use crate::scene_loop::{SceneLoop, extent};
use crate::targets::camera_and_photo;
use crate::trainer::{RunState, Trainer, Work};
use crate::views::Views;

/// Rate of the means over the extent of the cameras, twice that of longer trainings, and the factor by which it falls
/// besides that of all rates.
const MEAN_RATE: f32 = 3.2e-4;
const MEAN_FALL: f64 = 0.1;
/// All rates keep their common factor in this first part of the run. Fox reaches 30.9 dB in 2000 steps with it, and
/// 28.7 dB if the factor falls from the start.
const HELD: f64 = 0.8;
/// Rate of SH degrees 1 to 3 over its default, which is for runs of four times as many steps.
const SH_RATE: f32 = 3.0;
/// Weights in the loss of opacities, and of scales over the extent.
const SHRINKAGE: Shrinkage = Shrinkage { opacity: 0.01, scale: 0.01 };
/// Steps between two relocations.
const EVERY: u64 = 100;
/// Parts of the run: when the last relocation is, when the cap is reached, and when large photos come in windows.
const RELOCATED: f64 = 5.0 / 6.0;
const GROWN: f64 = 0.5;
const COARSE: f64 = 0.6;
/// A further SH degree is learned after each such part of the run.
const DEGREE: f64 = 1.0 / 15.0;
/// Steps between checkpoints.
const KEPT: u64 = 500;

/// How to train.
#[derive(Clone, Debug)]
pub struct TrainOptions {
    /// Steps, one view each.
    pub steps: u64,
    /// Most Gaussians.
    pub cap: usize,
    /// SH degree of the model, at most 3.
    pub sh_degree: u8,
    /// Whether the model is antialiased: see [`Scene::antialiased`].
    pub antialiased: bool,
    /// Most pixels of a step.
    pub pixels: u32,
    /// Seed of the order of the views, the noise and the places of new Gaussians.
    pub seed: u64,
    /// Where to keep a checkpoint. An existing one is continued.
    pub checkpoint: Option<PathBuf>,
    /// Setting it ends the run after the current step.
    pub cancel: Option<Arc<AtomicBool>>,
}

impl Default for TrainOptions {
    fn default() -> Self {
        Self {
            steps: 7500,
            cap: 200_000,
            sh_degree: 3,
            antialiased: false,
            pixels: 250_000,
            seed: 0,
            checkpoint: None,
            cancel: None,
        }
    }
}

/// The result of a training.
#[derive(Clone, Debug)]
pub struct TrainOutcome {
    /// The model.
    pub scene: Scene,
    /// Steps done in all.
    pub steps: u64,
    /// Wall-clock seconds of this run.
    pub seconds: f64,
    /// Why the run ended.
    pub reason: StopReason,
}

/// A training on the processor. The result is a function of points, views and options alone.
pub struct Train {
    trainer: Trainer,
    work: TrainRun,
}

impl std::fmt::Debug for Train {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Train").field("done", &self.trainer.done).finish_non_exhaustive()
    }
}

impl Train {
    /// Prepares a run. If the options name a checkpoint that exists, the run goes on from it.
    ///
    /// # Errors
    /// [`Error::Option`] if there are no points, or more of them than the cap; [`Error::Finetune`] for views that cannot
    /// be used; [`Error::Io`], [`Error::Checkpoint`] and [`Error::OtherRun`] for a checkpoint.
    pub fn new(points: &[Point], views: Vec<TrainView>, options: TrainOptions) -> Result<Self> {
        let TrainOptions { cap, sh_degree, pixels, seed, .. } = options;
        let (checkpoint, cancel) = (options.checkpoint.clone(), options.cancel.clone());
        let out_of = |option, value, range| Error::Option { option, value, range };
        if points.is_empty() || cap < points.len() {
            let range = "at least the number of points, which is not zero";
            return Err(out_of("cap", cap as f64, range));
        }
        if sh_degree > 3 {
            return Err(out_of("SH degree", sh_degree.into(), "at most 3"));
        }
        finetune::check_views(&views)?;
        let mut scene = begin::begin(points, sh_degree);
        scene.antialiased = options.antialiased;
        // What a view shows lies together in memory. Later Gaussians are added in the order of their hosts.
        let scene = scene.select(&gs_model::morton_order(&scene.means));
        let drawn = if options.antialiased { " antialiased" } else { "" };
        let told = format!("train {} {cap} {pixels} {seed}{drawn}", options.steps);
        let fingerprint = fingerprint(&scene, views.iter().map(camera_and_photo), &told);
        let coarse: Vec<TrainView> = views.iter().map(|view| smaller(view, pixels)).collect();
        let fine = if coarse.iter().zip(&views).any(|(a, b)| a.camera.width < b.camera.width) {
            let render = RenderOptions::default();
            let mut fine = ViewGradients::new(views, Loss::L1_SSIM, &render)?;
            fine.split(pixels);
            fine.move_means(true);
            Some(fine)
        } else {
            None
        };
        let mut views = Views::all(coarse, Loss::L1_SSIM, seed)?;
        views.gradients.move_means(true);
        let mut trainer = Trainer::new(views, fingerprint, Backend::Cpu, checkpoint, cancel)?;
        let extent = extent(&trainer.views.cameras);
        // Cameras at one place do not tell how large the scene is.
        let extent = if extent > 0.0 { extent } else { 1.0 };
        let mut work = TrainRun::new(scene, fine, extent, options);
        trainer.resume(&mut work)?;
        Ok(Self { trainer, work })
    }

    /// Steps already done by the run whose checkpoint this one goes on from.
    #[must_use]
    pub fn steps_done(&self) -> u64 {
        self.trainer.done
    }

    /// Runs to the end, calling `progress` now and then. The state at the end is kept in the checkpoint, if there is
    /// one.
    ///
    /// # Errors
    /// Those of [`Error`].
    pub fn run(self, mut progress: impl FnMut(&Progress<'_>)) -> Result<TrainOutcome> {
        let Self { mut trainer, mut work } = self;
        let reason = trainer.run(&mut work, &mut progress)?;
        trainer.keep(&work);
        let (steps, seconds) = (trainer.done, trainer.clock.seconds());
        work.prepare();
        Ok(TrainOutcome { scene: work.run.optimiser.take_scene(), steps, seconds, reason })
    }
}

/// The scene that is trained.
struct TrainRun {
    options: TrainOptions,
    run: SceneLoop,
    /// Large photos in windows.
    fine: Option<ViewGradients>,
    /// Of the cameras: see [`extent`].
    extent: f32,
    /// Number of points that the run began with.
    points: usize,
    passes: Epochs,
}

impl TrainRun {
    fn new(scene: Scene, fine: Option<ViewGradients>, extent: f32, options: TrainOptions) -> Self {
        let points = scene.len();
        let run = SceneLoop::new(scene, 0.0, options.steps);
        Self { options, run, fine, extent, points, passes: Epochs::default() }
    }

    /// The part of the run that is done.
    fn part(&self) -> f64 {
        self.run.done as f64 / self.options.steps.max(1) as f64
    }

    /// Gaussians at this time: their number grows by the same factor at each relocation.
    fn wanted(&self) -> usize {
        let grown =
            libm::pow(self.options.cap as f64 / self.points as f64, (self.part() / GROWN).min(1.0));
        ((self.points as f64 * grown) as usize).min(self.options.cap)
    }

    /// Puts Gaussians where they are needed.
    fn densify(&mut self) {
        // The rates, for rows that catch up now.
        self.prepare();
        let mut random = SplitMix::new(self.options.seed ^ self.run.done.wrapping_mul(0x9e6d));
        let more = self.wanted().saturating_sub(self.run.optimiser.scene().len());
        self.run.change(|scene, moments| {
            mcmc::relocate(scene, moments, &mut random);
            mcmc::grow(scene, moments, &mut random, more);
        });
    }

    /// Sets the rates of the next step. That of the means is returned.
    fn prepare(&mut self) -> f32 {
        let part = self.part();
        let rate = MEAN_RATE * self.extent * libm::pow(MEAN_FALL, part) as f32;
        self.run.held = (HELD * self.options.steps as f64) as u64;
        let optimiser = &mut self.run.optimiser;
        optimiser.mean_rate = rate;
        optimiser.shrinkage = Shrinkage { scale: SHRINKAGE.scale / self.extent, ..SHRINKAGE };
        let default = LearningRates::default();
        optimiser.rates = LearningRates { sh_rest: SH_RATE * default.sh_rest, ..default };
        optimiser.learned_degree = (part / DEGREE).min(3.0) as u8;
        rate
    }
}

impl Work for TrainRun {
    fn steps(&self) -> u64 {
        self.options.steps
    }

    fn advance(&mut self, _: &mut Views) -> Result<Option<StopReason>> {
        let done = self.run.done;
        if done >= self.options.steps {
            return Ok(Some(StopReason::Steps));
        }
        if done > 0 && done.is_multiple_of(EVERY) && self.part() <= RELOCATED {
            self.densify();
        }
        Ok(None)
    }

    fn due(&self) -> bool {
        // Not in the step of a relocation: a run that goes on from there would relocate again.
        self.run.done % KEPT == EVERY / 2
    }

    fn measure(&mut self, _: &Views) -> Result<()> {
        Ok(())
    }

    fn place(&mut self, _: &mut Views) -> Result<()> {
        Ok(())
    }

    fn step(&mut self, views: &mut Views, view: usize) -> Result<f64> {
        let rate = self.prepare() * self.run.decay();
        let (seed, done, part) = (self.options.seed, self.run.done, self.part());
        let photos = views.photos();
        match &mut self.fine {
            Some(fine) if part >= COARSE => {
                let n = fine.views() as u64;
                let window = permutation(seed, done / n, n as usize)[(done % n) as usize];
                self.run.step(fine, window as usize)?;
            }
            _ => drop(self.run.step(&mut views.gradients, view)?),
        }
        let random = |i: usize| SplitMix::new(seed ^ (done << 32) ^ i as u64);
        // MCMC's constants are for scenes of extent 1. The noise is a covariance times the rate, so it grows with the
        // cube of the extent; divided by the square, it grows as the scene does.
        let noise = rate / (self.extent * self.extent);
        self.run.optimiser.move_means(|scene, i| mcmc::noise(scene, i, noise, random(i)));
        self.passes.add(self.run.psnr, photos);
        Ok(self.run.psnr)
    }

    fn fetch(&mut self, _: &Views) -> Result<()> {
        Ok(())
    }

    fn write(&self, out: &mut StateWriter) {
        out.numbers(&self.passes.past);
        out.numbers(&self.passes.current);
        self.run.write(out);
    }

    fn read(&mut self, input: &mut StateReader<'_>, _: &mut Views) -> Result<()> {
        self.passes.past = input.numbers()?;
        self.passes.current = input.numbers()?;
        self.run = SceneLoop::read(input, 0.0, self.options.steps)?;
        Ok(())
    }

    fn state(&self) -> RunState<'_> {
        RunState {
            stage: StageName::Training,
            scene: self.run.optimiser.scene(),
            aside_psnr: None,
            pass_psnr: self.passes.psnr(),
            bytes: None,
        }
    }
}
