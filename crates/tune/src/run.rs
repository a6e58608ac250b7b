//! [`Tune`]: the run.

use std::sync::atomic::Ordering;

use finetune::TrainView;
use gs_model::Scene;
use gsvx::rate;

use crate::checkpoint::{Reader, Writer, fingerprint};
use crate::clock::Clock;
use crate::codec_loop::{CodecLoop, FITTED, encode_options};
use crate::error::{Error, Result};
use crate::options::{Options, Target};
use crate::plan::{Plan, Spare, quality_for_psnr, voxel_options};
use crate::progress::{Outcome, Progress, StageName};
use crate::stage::{self, Stage};
use crate::steering;
use crate::views::Views;

/// Bytes of a tuned stream over those of one of the same plan without tuning, about: where a search for
/// a size begins.
const TUNED_OVER_PROBED: f64 = 0.85;
/// Steps between two reports.
const REPORTED: u64 = 10;
/// From this share of the loop on, the best state is kept.
const BEST_FROM: f64 = 0.5;
/// A view of the loop takes this much longer than one without the codec.
const LOOP_OVER_STEP: f64 = 1.4;
/// Time of a step grows with the number of Gaussians to this power.
const TIME_EXPONENT: f64 = 0.6;

/// A tune of one scene to one target.
///
/// The result is a function of the scene, the views and the options alone, for any number of threads and
/// after any resumption.
pub struct Tune {
    options: Options,
    plan: Plan,
    views: Views,
    stage: Stage,
    /// Gaussians of the input.
    input: usize,
    input_psnr: f64,
    /// Seconds of a step on the input.
    step_seconds: f64,
    /// Steps done, of both stages.
    done: u64,
    fingerprint: u32,
    /// The values of least cost so far in the last part of the loop, and that cost.
    best: Option<(f64, (Vec<f32>, f32))>,
    aside_psnr: Option<f64>,
    checkpoint_failed: Option<Error>,
}

impl std::fmt::Debug for Tune {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tune").field("plan", &self.plan).field("done", &self.done).finish()
    }
}

impl Tune {
    /// Prepares a run on the training views. If the options name a checkpoint that exists, the run goes
    /// on from it.
    ///
    /// # Errors
    /// Those of [`Error`].
    pub fn new(scene: Scene, views: Vec<TrainView>, mut options: Options) -> Result<Self> {
        scene.validate()?;
        options.backend = finetune::backend::choose(options.backend)?.used;
        if let Target::Psnr(db) = options.target
            && !db.is_finite()
        {
            return Err(Error::target("target PSNR", db, "a number of dB"));
        }
        let fingerprint = fingerprint(&scene, &views, &options);
        let mut set = Views::new(&scene, views, options.seed)?;
        let input_psnr = set.check(&scene)?;
        let plan = plan(&scene, &set, &options, input_psnr)?;
        let step_seconds = seconds_of_a_step(&scene, &mut set);
        let input = scene.len();
        let (mut done, mut best, mut aside_psnr) = (0, None, None);
        let existing = options.checkpoint.as_deref().filter(|p| p.exists());
        let mut stage = match existing {
            Some(path) => {
                let mut file = Reader::open(path, fingerprint)?;
                done = match file.integers()?[..] {
                    [done] => done,
                    _ => return Err(file.error("steps")),
                };
                if let [db] = file.numbers()?[..] {
                    aside_psnr = Some(db);
                }
                if let [cost, quality] = file.numbers()?[..] {
                    best = Some((cost, (file.floats()?, quality as f32)));
                }
                Stage::read(&mut file, &set)?
            }
            None => stage::round(&plan, &set, scene, input, 1)?,
        };
        if let Stage::Loop(state) = &mut stage {
            place(state, &options, &mut set)?;
        }
        set.gradients.move_means(matches!(stage, Stage::Round { .. }));
        let checkpoint_failed = None;
        Ok(Self {
            options,
            plan,
            views: set,
            stage,
            input,
            input_psnr,
            step_seconds,
            done,
            fingerprint,
            best,
            aside_psnr,
            checkpoint_failed,
        })
    }

    /// What the run will do.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// PSNR of the input model at the views kept aside, dB.
    #[must_use]
    pub fn input_psnr(&self) -> f64 {
        self.input_psnr
    }

    /// Number of views that gradients come from, and number of those kept aside.
    #[must_use]
    pub fn views(&self) -> (usize, usize) {
        (self.views.gradients.views(), self.views.kept_aside())
    }

    /// Steps already done by the run whose checkpoint this one goes on from.
    #[must_use]
    pub fn steps_done(&self) -> u64 {
        self.done
    }

    /// Seconds that the rest of the run will take, about.
    #[must_use]
    pub fn estimated_seconds(&self) -> f64 {
        let share = |kept: f64| libm::pow(kept, TIME_EXPONENT);
        let of_round = |r: u64| self.plan.kept(self.input, r) as f64 / self.input.max(1) as f64;
        let rounds: f64 = (1..=self.plan.rounds).map(|r| share(of_round(r))).sum();
        let in_loop = LOOP_OVER_STEP * share(1.0 - self.plan.fraction);
        let all = rounds * self.plan.round_steps as f64 + in_loop * self.plan.loop_steps as f64;
        let left = 1.0 - self.done as f64 / self.plan.steps().max(1) as f64;
        self.step_seconds * all * left
    }

    /// Runs to the end, calling `progress` now and then.
    ///
    /// Ends early when the cancellation flag is set; the stream is then that of what has been reached.
    /// A checkpoint that cannot be written does not end the run: [`Progress::checkpoint_failed`] says so
    /// once, and the last one that could be written stays.
    ///
    /// # Errors
    /// [`Error::Codec`].
    pub fn run(mut self, mut progress: impl FnMut(&Progress<'_>)) -> Result<Outcome> {
        let (started, first) = (Clock::start(), self.done);
        let cancelled = loop {
            if self.options.cancel.as_ref().is_some_and(|c| c.load(Ordering::Relaxed)) {
                break true;
            }
            if self.next_stage()? {
                break false;
            }
            if self.done > first && self.whole() {
                self.measure()?;
                self.checkpoint();
            }
            let view = self.views.at(self.done);
            let loss = match &mut self.stage {
                Stage::Round { recovery, .. } => recovery.step(&mut self.views.gradients, view),
                Stage::Loop(state) => state.step(&mut self.views.gradients, view)?,
            };
            self.done += 1;
            if self.done.is_multiple_of(REPORTED) || self.done == self.plan.steps() {
                self.report(loss.psnr(), (started, first), &mut progress);
            }
        };
        self.finish(started, cancelled)
    }

    /// Goes to the next stage if this one is done; true if there is none.
    fn next_stage(&mut self) -> Result<bool> {
        match &mut self.stage {
            Stage::Round { recovery, .. } if recovery.done < recovery.steps => Ok(false),
            Stage::Round { round, recovery } => {
                let (round, scene) = (*round, std::mem::take(&mut recovery.scene));
                if round < self.plan.rounds {
                    self.stage =
                        stage::round(&self.plan, &self.views, scene, self.input, round + 1)?;
                } else {
                    self.enter_loop(scene)?;
                }
                Ok(false)
            }
            Stage::Loop(state) => Ok(state.done >= state.steps),
        }
    }

    fn enter_loop(&mut self, scene: Scene) -> Result<()> {
        self.views.gradients.move_means(false);
        let mut state = stage::codec_loop(&self.plan, &self.views, &scene)?;
        steering::begin(&mut state, self.options.target)?;
        place(&mut state, &self.options, &mut self.views)?;
        self.stage = Stage::Loop(Box::new(state));
        Ok(())
    }

    /// Whether the state between two steps is whole without the predictions of the codec.
    fn whole(&self) -> bool {
        match &self.stage {
            Stage::Round { recovery, .. } => recovery.done.is_multiple_of(FITTED),
            Stage::Loop(state) => state.at_fit(),
        }
    }

    /// Scores the views kept aside, steers, and keeps the best.
    fn measure(&mut self) -> Result<()> {
        match &mut self.stage {
            // Nothing is coded yet, so there is no scene.
            Stage::Loop(state) if state.done == 0 => return Ok(()),
            Stage::Loop(state) => state.settle()?,
            Stage::Round { .. } => (),
        }
        let (mse, psnr) = self.views.aside(self.stage.scene());
        self.aside_psnr = Some(psnr);
        let Stage::Loop(state) = &mut self.stage else { return Ok(()) };
        if state.done as f64 >= BEST_FROM * state.steps as f64 {
            let cost = mse + state.lambda() * 8.0 * state.bytes as f64;
            if self.best.as_ref().is_none_or(|best| cost < best.0) {
                self.best = Some((cost, state.snapshot()));
            }
        }
        steering::steer(state, self.options.target, psnr)
    }

    /// Writes the checkpoint, if there is to be one.
    fn checkpoint(&mut self) {
        let Some(path) = &self.options.checkpoint else { return };
        if self.checkpoint_failed.is_some() {
            return;
        }
        let mut out = Writer::new(self.fingerprint);
        out.integers(&[self.done]);
        out.numbers(self.aside_psnr.as_slice());
        match &self.best {
            Some((cost, (values, quality))) => {
                out.numbers(&[*cost, (*quality).into()]);
                out.floats(values);
            }
            None => out.numbers(&[]),
        }
        self.stage.write(&mut out);
        self.checkpoint_failed = out.write(path).err();
    }

    fn report(
        &self,
        psnr: f64,
        (started, first): (Clock, u64),
        progress: &mut impl FnMut(&Progress<'_>),
    ) {
        let seconds = started.seconds();
        let per_step = seconds / (self.done - first).max(1) as f64;
        let (stage, bytes) = match &self.stage {
            Stage::Round { round, .. } => {
                (StageName::Round { round: *round, rounds: self.plan.rounds }, None)
            }
            Stage::Loop(state) => (StageName::CodecInTheLoop, Some(state.bytes)),
        };
        progress(&Progress {
            stage,
            step: self.done,
            steps: self.plan.steps(),
            gaussians: self.stage.scene().len(),
            psnr,
            aside_psnr: self.aside_psnr,
            bytes,
            seconds,
            eta_seconds: per_step * self.plan.steps().saturating_sub(self.done) as f64,
            scene: self.stage.scene(),
            checkpoint_failed: self.checkpoint_failed.as_ref(),
        });
    }

    /// The stream of what has been reached.
    fn finish(mut self, started: Clock, cancelled: bool) -> Result<Outcome> {
        if let Stage::Round { recovery, .. } = &mut self.stage {
            let scene = std::mem::take(&mut recovery.scene);
            self.enter_loop(scene)?;
        }
        if let Stage::Loop(state) = &mut self.stage {
            state.settle()?;
        }
        if !cancelled {
            self.measure_last()?;
        }
        let Stage::Loop(mut state) = self.stage else { return Err(Error::NothingSeen) };
        let encoded = steering::fitting(&mut state, self.options.target)?;
        let (_, psnr) = self.views.aside(&state.scene);
        let reached = match self.options.target {
            Target::Quality(_) => true,
            Target::Bytes(bytes) => encoded.bytes.len() as u64 <= bytes,
            Target::Psnr(db) => psnr >= db,
        };
        let CodecLoop { scene: last, quality, bytes, outliers, .. } = *state;
        // The stream leaves out SH degrees that are zero everywhere.
        let sh_degree = encoded.index.header.sh_degree;
        let mut scene = Scene { sh_degree, ..Scene::default() };
        scene.append(&last);
        Ok(Outcome {
            encoded,
            scene,
            counted_bytes: bytes,
            input_psnr: self.input_psnr,
            psnr,
            quality,
            outliers: outliers.map_or(0, |o| o.len()),
            steps: self.done,
            seconds: started.seconds(),
            cancelled,
            reached,
        })
    }

    /// Comes back to the best state if the last one costs more.
    fn measure_last(&mut self) -> Result<()> {
        let (mse, _) = self.views.aside(self.stage.scene());
        let Stage::Loop(state) = &mut self.stage else { return Ok(()) };
        let cost = mse + state.lambda() * 8.0 * state.bytes as f64;
        match self.best.take() {
            // With a target the quality was steered until the end: the last state is closest to it.
            Some((best, snapshot))
                if best < cost && matches!(self.options.target, Target::Quality(_)) =>
            {
                state.restore(snapshot)
            }
            _ => Ok(()),
        }
    }
}

/// Moves the steps of a loop to a graphics adapter, if one is asked for.
fn place(state: &mut CodecLoop, options: &Options, views: &mut Views) -> Result<()> {
    #[cfg(feature = "gpu")]
    if options.backend == finetune::Backend::Gpu {
        return state.place(finetune::Adapter::Hardware, &mut views.gradients);
    }
    let _ = (state, options, views);
    Ok(())
}

/// The plan for the target.
fn plan(scene: &Scene, views: &Views, options: &Options, input_psnr: f64) -> Result<Plan> {
    if let Some(plan) = options.plan {
        return plan.checked();
    }
    let (effects, importance) = (views.removal_effects(scene), views.importance(scene));
    let spare = Spare::new(&effects, &importance);
    let quality = match options.target {
        Target::Quality(quality) => quality,
        Target::Psnr(db) => quality_for_psnr(db, input_psnr),
        Target::Bytes(bytes) => {
            let seen = (effects.as_slice(), importance.as_slice());
            let probe = |quality: f32| probe(scene, seen, &spare, quality, options);
            let found = rate::to_bytes((bytes as f64 / TUNED_OVER_PROBED) as u64, &probe)?;
            if !found.reached || is_empty(&found.encoded)? {
                let smallest = smallest(probe)? as f64 * TUNED_OVER_PROBED;
                return Err(Error::TargetTooSmall { target: bytes, smallest: smallest as u64 });
            }
            found.quality
        }
    };
    Plan::new(quality, options.effort, &spare)
}

/// Bytes of the smallest stream that has a Gaussian, to five points of quality.
fn smallest(mut probe: impl FnMut(f32) -> gsvx::Result<Vec<u8>>) -> Result<usize> {
    for quality in (0..=100u8).step_by(5) {
        let stream = probe(quality.into())?;
        if !is_empty(&stream)? {
            return Ok(stream.len());
        }
    }
    Err(Error::NothingSeen)
}

fn is_empty(stream: &[u8]) -> Result<bool> {
    Ok(gsvx::Index::parse(stream)?.header.count == 0)
}

/// The stream of a plan without any tuning.
fn probe(
    scene: &Scene,
    (effects, importance): (&[f32], &[f32]),
    spare: &Spare,
    quality: f32,
    options: &Options,
) -> gsvx::Result<Vec<u8>> {
    let as_codec = |e: Error| match e {
        Error::Codec(e) => e,
        _ => gsvx::Error::Option { option: "quality", value: quality.into(), range: "0 to 100" },
    };
    let plan = Plan::new(quality, options.effort, spare).map_err(as_codec)?;
    let kept = gsvx::prune(effects, plan.fraction)?;
    let importance = kept.iter().map(|&i| importance[i]).collect();
    let prepared = gsvx::prepare(&scene.select(&kept), &voxel_options(quality, importance)?)?;
    let encode = encode_options(quality, prepared.importance).map_err(as_codec)?;
    Ok(gsvx::encode_voxels(&prepared.scene, prepared.voxels.octree(), None, &encode)?.bytes)
}

/// Seconds of a render with its gradients, the second time.
fn seconds_of_a_step(scene: &Scene, views: &mut Views) -> f64 {
    views.gradients.run(scene, 0);
    let started = Clock::start();
    views.gradients.run(scene, 1);
    started.seconds()
}
