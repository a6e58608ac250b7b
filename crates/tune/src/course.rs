//! [`Course`]: rounds of pruning, then the codec in the loop; the same again for each further stream.

use gs_model::Scene;

use crate::checkpoint::{StateReader, StateWriter};
use crate::codec_loop::{CodecLoop, FITTED, Snapshot};
use crate::error::Result;
use crate::forecast::Forecast;
use crate::options::{Goal, Target};
use crate::plan::{TuneEffort, TunePlan};
use crate::progress::{StageName, StopReason};
use crate::stage::{self, Stage};
use crate::steering;
use crate::trainer::{RunState, Work};
use crate::views::Views;

/// The best state is kept after this share of the loop.
const BEST_FROM: f64 = 0.5;

/// A run of [`crate::Tune`].
pub(crate) struct Course {
    /// One for each stream, in descending order of quality.
    plans: Vec<TunePlan>,
    /// The stream under way.
    stream: usize,
    goal: Goal,
    pub(crate) forecast: Forecast,
    /// Removal effects of the input, until it is pruned.
    effects: Option<Vec<f32>>,
    stage: Stage,
    /// The values of least cost so far in the last part of the loop, and that cost.
    best: Option<(f64, Snapshot)>,
    aside_psnr: Option<f64>,
}

impl Course {
    /// Begins with a round of no steps, which keeps all Gaussians. The next one prunes.
    /// `effects` are the removal effects of the scene.
    pub(crate) fn new(
        plans: Vec<TunePlan>,
        goal: Goal,
        forecast: Forecast,
        scene: Scene,
        effects: Vec<f32>,
    ) -> Self {
        let (stage, effects) = (stage::before_pruning(scene), Some(effects));
        Self { plans, stream: 0, goal, forecast, effects, stage, best: None, aside_psnr: None }
    }

    /// The plan of the stream under way.
    pub(crate) fn plan(&self) -> &TunePlan {
        &self.plans[self.stream]
    }

    /// Plans of all streams.
    pub(crate) fn plans(&self) -> &[TunePlan] {
        &self.plans
    }

    /// Seconds of the whole run with another effort, about.
    pub(crate) fn seconds_with(&self, effort: TuneEffort) -> f64 {
        let with = |(i, plan): (usize, &TunePlan)| match i {
            0 => plan.with(effort),
            _ => plan.with(effort).further(),
        };
        let plans: Vec<TunePlan> = self.plans.iter().enumerate().map(with).collect();
        self.forecast.seconds_after(&plans, 0)
    }

    /// Whether a stream before the one under way is made.
    pub(crate) fn is_further(&self) -> bool {
        self.stream > 0
    }

    /// Whether no stream follows the one under way.
    pub(crate) fn is_last(&self) -> bool {
        self.stream + 1 == self.plans.len()
    }

    /// Goes on to the next stream from the scene of this one.
    pub(crate) fn next(&mut self, views: &mut Views, scene: Scene) -> Result<()> {
        self.stream += 1;
        (self.effects, self.best, self.aside_psnr) = (None, None, None);
        self.stage = stage::before_pruning(scene);
        views.of_quality(self.plan().quality);
        // Views that see nothing are an error before its first step.
        self.advance(views).map(drop)
    }

    /// Prunes to what remains after a round.
    fn pruned(&mut self, views: &mut Views, scene: &Scene, round: u64) -> Result<Scene> {
        let effects = match self.effects.take() {
            Some(effects) => effects,
            None => views.removal(scene)?.effects,
        };
        let kept = self.plan().kept(self.forecast.input, round).min(scene.len());
        let fraction = 1.0 - kept as f64 / scene.len().max(1) as f64;
        let kept = gsvx::prune(&effects, fraction.clamp(0.0, 0.999_999))?;
        Ok(scene.select(&kept))
    }

    /// The loop at its end, with the best state if the last one costs more, unless the run was cut short. The course
    /// has no scene then, until it goes on to the next stream.
    pub(crate) fn finish(&mut self, views: &mut Views, cancelled: bool) -> Result<CodecLoop> {
        let (goal, best) = (self.goal, self.best.take());
        let stage = std::mem::replace(&mut self.stage, stage::before_pruning(Scene::default()));
        let mut state = match stage {
            Stage::Round { mut recovery, .. } => {
                stage::codec_loop(self.plan(), goal, views, &recovery.take_scene()?)?
            }
            Stage::Loop(state) => state,
        };
        state.settle()?;
        // With a target the quality was steered until the end: the last state is closest to it.
        if let (false, Target::Quality(_), Some((best, snapshot))) = (cancelled, goal.target, best)
        {
            let (loss, _) = views.at_aside(&state.scene);
            if best < cost(&state, loss) {
                state.restore(snapshot)?;
            }
        }
        Ok(*state)
    }
}

/// The cost of a state with this loss at the views kept aside.
fn cost(state: &CodecLoop, loss: f64) -> f64 {
    loss + state.lambda() * 8.0 * state.bytes as f64
}

impl Work for Course {
    const FORECAST: bool = true;

    fn steps(&self) -> u64 {
        self.plans.iter().map(TunePlan::steps).sum()
    }

    fn seconds_after(&self, steps: u64) -> f64 {
        self.forecast.seconds_after(&self.plans, steps)
    }

    fn advance(&mut self, views: &mut Views) -> Result<Option<StopReason>> {
        match &mut self.stage {
            Stage::Round { recovery, .. } if recovery.done < recovery.steps => Ok(None),
            Stage::Round { round, recovery } => {
                let (round, scene) = (*round, recovery.take_scene()?);
                if round < self.plan().rounds {
                    let kept = self.pruned(views, &scene, round + 1)?;
                    self.stage = stage::round(self.plan(), views, kept, round + 1);
                } else {
                    let state = stage::codec_loop(self.plan(), self.goal, views, &scene)?;
                    self.stage = Stage::Loop(state);
                }
                Ok(None)
            }
            Stage::Loop(state) => Ok((state.done >= state.steps).then_some(StopReason::Steps)),
        }
    }

    /// A checkpoint does not hold the predictions of the codec, so it is made where they are fitted.
    fn due(&self) -> bool {
        match &self.stage {
            // Fetching all parameters and moments from a device would cost as much as the steps.
            Stage::Round { recovery, .. } => {
                recovery.done.is_multiple_of(FITTED) && !recovery.on_device()
            }
            Stage::Loop(state) => state.at_fit(),
        }
    }

    /// Scores the views kept aside, steers, and keeps the best.
    fn measure(&mut self, views: &Views) -> Result<()> {
        match &mut self.stage {
            // Nothing is coded yet, so there is no scene.
            Stage::Loop(state) if state.done == 0 => return Ok(()),
            Stage::Loop(state) => state.settle()?,
            Stage::Round { .. } => (),
        }
        let (loss, psnr) = views.at_aside(self.stage.scene());
        self.aside_psnr = Some(psnr);
        let Stage::Loop(state) = &mut self.stage else { return Ok(()) };
        if state.done as f64 >= BEST_FROM * state.steps as f64 {
            let cost = cost(state, loss);
            if self.best.as_ref().is_none_or(|best| cost < best.0) {
                self.best = Some((cost, state.snapshot()));
            }
        }
        steering::steer(state, self.goal.target, psnr)
    }

    fn place(&mut self, views: &mut Views) -> Result<()> {
        #[cfg(feature = "gpu")]
        {
            let on = views.summed.adapter()?;
            match &mut self.stage {
                Stage::Round { recovery, .. } => recovery.place(on, &views.gradients)?,
                Stage::Loop(state) => {
                    let most = finetune::kernels::PAGE_GAUSSIANS;
                    state.place((on, most), &mut views.gradients)?;
                }
            }
        }
        let _ = views;
        Ok(())
    }

    fn step(&mut self, views: &mut Views, view: usize) -> Result<f64> {
        match &mut self.stage {
            Stage::Round { recovery, .. } => {
                recovery.step(&mut views.gradients, view)?;
                Ok(recovery.psnr)
            }
            Stage::Loop(state) => Ok(state.step(&mut views.gradients, view)?.psnr()),
        }
    }

    fn fetch(&mut self, _: &Views) -> Result<()> {
        match &mut self.stage {
            Stage::Loop(state) => state.leave_device(),
            Stage::Round { recovery, .. } => recovery.leave_device(),
        }
    }

    fn write(&self, out: &mut StateWriter) {
        out.integers(&[self.stream as u64]);
        out.numbers(self.aside_psnr.as_slice());
        match &self.best {
            Some((cost, Snapshot { values, quality })) => {
                out.numbers(&[*cost, (*quality).into()]);
                out.floats(values);
            }
            None => out.numbers(&[]),
        }
        self.stage.write(out);
    }

    fn read(&mut self, input: &mut StateReader<'_>, views: &mut Views) -> Result<()> {
        match input.integers()?[..] {
            [stream] if (stream as usize) < self.plans.len() => self.stream = stream as usize,
            _ => return Err(input.error("stream")),
        }
        views.of_quality(self.plan().quality);
        self.aside_psnr = input.numbers()?.first().copied();
        self.best = match input.numbers()?[..] {
            [cost, quality] => {
                Some((cost, Snapshot { values: input.floats()?, quality: quality as f32 }))
            }
            _ => None,
        };
        self.effects = None;
        self.stage = Stage::read(input, &self.plans[self.stream], self.goal.layout, views)?;
        views.gradients.move_means(matches!(self.stage, Stage::Round { .. }));
        Ok(())
    }

    fn state(&self) -> RunState<'_> {
        let (stage, bytes) = match &self.stage {
            Stage::Round { round, .. } => {
                (StageName::Round { round: *round, rounds: self.plan().rounds }, None)
            }
            Stage::Loop(state) => (StageName::CodecInTheLoop, Some(state.bytes)),
        };
        let (scene, aside_psnr) = (self.stage.scene(), self.aside_psnr);
        RunState { stage, scene, aside_psnr, pass_psnr: None, bytes }
    }
}
