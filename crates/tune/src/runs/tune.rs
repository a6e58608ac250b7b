//! [`Tune`]: the run.

use std::ops::ControlFlow;

use finetune::metrics::Scores;
use finetune::{BackendReport, Removal};
use gs_model::Scene;

use crate::checkpoint::fingerprint;
use crate::codec_loop::CodecLoop;
use crate::course::Course;
use crate::error::{Error, Result};
use crate::forecast::Forecast;
use crate::options::{Target, TuneOptions};
use crate::plan::{TuneEffort, TunePlan};
use crate::probe::plans;
use crate::progress::{Progress, StopReason, TuneOutcome};
use crate::stage::at_degree;
use crate::steering;
use crate::targets::Targets;
use crate::trainer::{Clock, Trainer, Work};
use crate::views::{self, FirstLook, Views};

/// Views that are timed.
const TIMED: usize = 4;

/// A tune of one scene to one target.
///
/// The result is a function of the scene, the views and the options alone, for any number of threads and
/// after any resumption.
pub struct Tune {
    trainer: Trainer,
    course: Course,
    target: Target,
    input_scores: Scores,
}

impl std::fmt::Debug for Tune {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (plan, done) = (self.plan(), &self.trainer.done);
        f.debug_struct("Tune").field("plan", plan).field("done", done).finish()
    }
}

impl Tune {
    /// Prepares a run on the training views. If the options name a checkpoint that exists, the run goes
    /// on from it.
    ///
    /// # Errors
    /// Those of [`Error`].
    pub fn new(scene: Scene, targets: Targets, options: TuneOptions) -> Result<Self> {
        Self::with_progress(scene, targets, options, |_, _| ())
    }

    /// As [`Tune::new`]. `looked` is told from how many views the input has been seen, and how many there are: for a million
    /// Gaussians that takes half a minute.
    ///
    /// # Errors
    /// Those of [`Tune::new`].
    pub fn with_progress(
        mut scene: Scene,
        targets: Targets,
        options: TuneOptions,
        looked: impl FnMut(usize, usize),
    ) -> Result<Self> {
        scene.validate()?;
        gsvx::check_values(&scene, scene.sh_degree, 0)?;
        // What a view shows lies together in memory.
        scene = scene.select(&gs_model::morton_order(&scene.means));
        if let Target::Psnr(db) = options.target
            && !db.is_finite()
        {
            return Err(Error::Option {
                option: "target PSNR",
                value: db,
                range: "a number of dB",
            });
        }
        let TuneOptions { effort, plan: given, further, drop_unseen, seed, .. } = &options;
        let goal = options.goal();
        let renders = targets.are_renders();
        let shared =
            format!("{goal:?} {effort:?} {given:?} {further:?} {renders} {drop_unseen} {seed}");
        let fingerprint = fingerprint(&scene, targets.each(), &shared);
        let started = Clock::start();
        let looked = Views::look(&scene, targets, &options, looked)?;
        let pass = started.seconds();
        let plans = plans(&scene, &looked, &options)?;
        let FirstLook { mut views, removal: Removal { effects, .. }, input_scores } = looked;
        views.of_quality(plans[0].quality);
        let TuneOptions { backend, checkpoint, cancel, .. } = options;
        let mut trainer = Trainer::new(views, fingerprint, backend, checkpoint, cancel)?;
        let render = seconds_of_a_render(&scene, &mut trainer.views);
        let forecast = Forecast { input: scene.len(), render, pass };
        let mut course = Course::new(plans, goal, forecast, scene, effects);
        if !trainer.resume(&mut course)? {
            // Views that see nothing are an error before the run.
            course.advance(&mut trainer.views)?;
        }
        Ok(Self { trainer, course, target: goal.target, input_scores })
    }

    /// What the run will do for its first stream.
    #[must_use]
    pub fn plan(&self) -> &TunePlan {
        &self.course.plans()[0]
    }

    /// Steps of the whole run, of all streams.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.course.steps()
    }

    /// Scores of the input model at the views kept aside.
    #[must_use]
    pub fn input_scores(&self) -> Scores {
        self.input_scores
    }

    /// Number of views, and how many of them are kept aside to judge the result. If there are too few to keep one aside,
    /// the first view judges.
    #[must_use]
    pub fn views(&self) -> (usize, usize) {
        let views = self.trainer.views.cameras.len();
        (views, views::kept_aside(views))
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

    /// Seconds that the rest of the run will take, about.
    #[must_use]
    pub fn estimated_seconds(&self) -> f64 {
        self.course.seconds_after(self.trainer.done)
    }

    /// Seconds that this run would take with another effort, about.
    #[must_use]
    pub fn seconds_with(&self, effort: TuneEffort) -> f64 {
        self.course.seconds_with(effort)
    }

    /// Runs to the end, calling `progress` now and then.
    ///
    /// Ends early when the cancellation flag is set; the stream is then that of what has been reached, unless that is
    /// the input itself.
    /// A checkpoint that cannot be written does not end the run, which goes on without checkpoints:
    /// [`Progress::checkpoint_failed`] says so once, and the last one that could be written stays. If a GPU fails under [`Backend::Auto`](finetune::Backend),
    /// the processor goes on from the last state that was kept.
    ///
    /// # Errors
    /// [`Error::Codec`], [`Error::NothingSeen`]; [`Error::Interrupted`]; [`Error::Finetune`] if a GPU that was asked for fails.
    pub fn run(mut self, progress: impl FnMut(&Progress<'_>)) -> Result<TuneOutcome> {
        self.stream(progress)
    }

    /// As [`Tune::run`], for all streams of the options: `made` gets each as soon as it is there, and may end the run.
    /// A run that goes on from a checkpoint makes the streams that were not there yet. Of a run that is cancelled a
    /// further stream under way is not made.
    ///
    /// # Errors
    /// Those of [`Tune::run`].
    pub fn run_all(
        mut self,
        mut progress: impl FnMut(&Progress<'_>),
        mut made: impl FnMut(TuneOutcome) -> ControlFlow<()>,
    ) -> Result<()> {
        loop {
            let outcome = self.stream(&mut progress)?;
            if outcome.cancelled && self.course.is_further() {
                return Ok(());
            }
            if outcome.cancelled || self.course.is_last() {
                let _ = made(outcome);
                return Ok(());
            }
            let scene = outcome.scene.clone();
            if made(outcome).is_break() {
                return Ok(());
            }
            self.course.next(&mut self.trainer.views, scene)?;
        }
    }

    /// The stream under way.
    fn stream(&mut self, progress: impl FnMut(&Progress<'_>)) -> Result<TuneOutcome> {
        let Self { trainer, course, target, input_scores } = self;
        let (target, input_scores) = (*target, *input_scores);
        let cancelled = trainer.run(course, progress)? == StopReason::Cancelled;
        let Trainer { views, done: steps, backend, clock, .. } = trainer;
        let mut state = course.finish(views, cancelled)?;
        let encoded = steering::fitting(&mut state, target)?;
        let scores = views.scores(&state.scene);
        let against_input = views.against_input(&state.scene);
        let reached = match target {
            Target::Quality(_) => true,
            Target::Bytes(bytes) => encoded.bytes.len() as u64 <= bytes,
            Target::Psnr(db) => scores.psnr >= db,
        };
        let CodecLoop { scene: last, quality, bytes: counted_bytes, leaves, .. } = state;
        // The stream leaves out SH degrees that are zero everywhere.
        let scene = at_degree(&last, encoded.index.header.sh_degree);
        Ok(TuneOutcome {
            encoded,
            scene,
            counted_bytes,
            input_scores,
            scores,
            against_input,
            quality,
            outliers: leaves.outliers.map_or(0, |o| o.len()),
            steps: *steps,
            seconds: clock.seconds(),
            backend: backend.clone(),
            cancelled,
            reached,
        })
    }
}

/// Seconds of a render with its gradients, the mean over some views.
fn seconds_of_a_render(scene: &Scene, views: &mut Views) -> f64 {
    let n = views.gradients.views();
    // The first one makes room.
    views.gradients.run(scene, 0);
    let timed: Vec<usize> = (0..n).step_by(n.div_ceil(TIMED)).collect();
    let started = Clock::start();
    timed.iter().for_each(|&view| {
        views.gradients.run(scene, view);
    });
    started.seconds() / timed.len() as f64
}

#[cfg(all(test, feature = "gpu"))]
mod tests {
    use super::*;
    use finetune::{Adapter, Backend};
    use gs_model::{View, dataset, ply};

    /// A short tune of the room.
    fn room() -> Tune {
        let room = testing::fixture("room");
        let scene = ply::read(room.join("point_cloud.ply")).unwrap().0;
        let load = |view: View| crate::photo(&view.camera, &view.image_path).unwrap();
        let photos = dataset::open_views(room).unwrap().into_iter().map(load).collect();
        let mut options = TuneOptions::new(Target::Quality(58.0));
        options.plan = Some(TunePlan {
            quality: 58.0,
            fraction: 0.5,
            rounds: 2,
            round_steps: 60,
            loop_steps: 96,
        });
        options.backend = Backend::Cpu;
        Tune::new(scene, Targets::Photos(photos), options).unwrap()
    }

    /// The same on the software adapter, which a user cannot ask for.
    fn on_adapter(mut tune: Tune) -> Tune {
        tune.trainer.views.summed.adapter = Some(Adapter::Software);
        tune.trainer.backend.used = Backend::Gpu;
        tune
    }

    #[test]
    #[ignore = "takes 74 s on a software adapter: 42,961 bytes as on the processor, 0.06 dB apart"]
    fn a_whole_tune_on_a_device_is_as_good() {
        if let Err(e) = Adapter::Software.name() {
            return println!("SKIPPED: {e}; install mesa-vulkan-drivers to compare");
        }
        let run = |tune: Tune| {
            let mut told = Vec::new();
            let outcome = tune.run(|p| told.push((p.backend, p.psnr))).unwrap();
            (outcome, told)
        };
        let (host, _) = run(room());
        let (device, told) = run(on_adapter(room()));
        assert_eq!(device.backend.used, Backend::Gpu);
        assert!(told.iter().all(|t| t.0 == Backend::Gpu && t.1 > 10.0), "{told:?}");
        let (a, b) = (device.encoded.bytes.len() as f64, host.encoded.bytes.len() as f64);
        let (x, y) = (device.scores.psnr, host.scores.psnr);
        println!("device {a} bytes, {x} dB; host {b} bytes, {y} dB");
        assert!(device.encoded.bytes != host.encoded.bytes, "the adapter was not asked");
        assert!((a / b - 1.0).abs() < 0.01 && (x - y).abs() < 0.1);
    }

    #[test]
    fn the_processor_takes_over_from_an_adapter_that_failed_in_a_sum() {
        let host = room().run(|_| ()).unwrap();
        let mut tune = on_adapter(room());
        tune.trainer.may_fall_back();
        tune.trainer.views.summed.adapter = None;
        let outcome = tune.run(|_| ()).unwrap();
        assert_eq!(outcome.encoded.bytes, host.encoded.bytes);
        assert_eq!(outcome.backend.used, Backend::Cpu);
        assert!(outcome.backend.reason.contains("the GPU failed"), "{}", outcome.backend.reason);
    }
}
