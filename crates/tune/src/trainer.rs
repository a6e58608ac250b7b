//! [`Trainer`]: what all runs share. It gives the order of the views, writes the checkpoint, makes the reports, and lets
//! the processor go on when a GPU fails.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use finetune::backend;
use finetune::{Backend, BackendReport};
use gs_model::Scene;

use crate::checkpoint::{self, StateReader, StateWriter};
use crate::error::{Error, Result};
use crate::pace::Pace;
use crate::progress::{Progress, StageName, StopReason};
use crate::views::Views;

/// Steps between two reports.
const REPORTED: u64 = 10;

/// When something began. The standard library has no clock on wasm32-unknown-unknown; there everything takes 0 s.
#[derive(Clone, Copy)]
pub(crate) struct Clock(Option<Instant>);

impl Clock {
    pub(crate) fn start() -> Self {
        let there = !cfg!(all(target_family = "wasm", target_os = "unknown"));
        Self(there.then(Instant::now))
    }

    pub(crate) fn seconds(self) -> f64 {
        self.0.map_or(0.0, |started| started.elapsed().as_secs_f64())
    }
}

/// The parameters that a run moves, and its work between the steps.
pub(crate) trait Work {
    /// Steps of the whole run, at most.
    fn steps(&self) -> u64;
    /// Whether [`Work::seconds_after`] is about right before the first step.
    const FORECAST: bool = false;
    /// Seconds of what comes after so many steps, up to a factor.
    fn seconds_after(&self, steps: u64) -> f64 {
        self.steps().saturating_sub(steps) as f64
    }
    /// Prepares the next step; says why the run ends if there is none.
    fn advance(&mut self, views: &mut Views) -> Result<Option<StopReason>>;
    /// Whether it is time to measure and to keep the state.
    fn due(&self) -> bool;
    /// Measures the state, and steers by it.
    fn measure(&mut self, views: &Views) -> Result<()>;
    /// Moves the following steps to a graphics adapter, if they can run there and do not yet.
    fn place(&mut self, views: &mut Views) -> Result<()>;
    /// One step at a view; its PSNR, dB.
    fn step(&mut self, views: &mut Views, view: usize) -> Result<f64>;
    /// Moves the following steps back to the processor.
    fn fetch(&mut self, views: &Views) -> Result<()>;
    /// Adds what a run needs to go on from here.
    fn write(&self, out: &mut StateWriter);
    /// Undoes [`Work::write`]. The following steps run on the processor.
    fn read(&mut self, input: &mut StateReader<'_>, views: &mut Views) -> Result<()>;
    /// For a report.
    fn state(&self) -> RunState<'_>;
}

/// See the fields of [`Progress`].
pub(crate) struct RunState<'a> {
    pub(crate) stage: StageName,
    pub(crate) scene: &'a Scene,
    pub(crate) aside_psnr: Option<f64>,
    pub(crate) pass_psnr: Option<f64>,
    pub(crate) bytes: Option<u64>,
}

/// A run without the parameters that it moves.
pub(crate) struct Trainer {
    pub(crate) views: Views,
    /// Steps done.
    pub(crate) done: u64,
    pub(crate) backend: BackendReport,
    fingerprint: u32,
    checkpoint: Option<PathBuf>,
    cancel: Option<Arc<AtomicBool>>,
    checkpoint_failed: Option<Error>,
    /// The last state that was kept, where the processor may take over from a GPU.
    kept: Option<Vec<u8>>,
    /// Steps that were done when the run began here, or went on from a state that was kept.
    begun: u64,
    /// Since [`Trainer::run`].
    pub(crate) clock: Clock,
    pace: Pace,
}

impl Trainer {
    /// `fingerprint` is that of the run's checkpoints.
    pub(crate) fn new(
        views: Views,
        fingerprint: u32,
        wanted: Backend,
        checkpoint: Option<PathBuf>,
        cancel: Option<Arc<AtomicBool>>,
    ) -> Result<Self> {
        let backend = backend::choose(wanted)?;
        // The state to fall back to is kept in `run`, before the first step.
        let may_fall_back = wanted == Backend::Auto && backend.used == Backend::Gpu;
        Ok(Self {
            views,
            done: 0,
            backend,
            fingerprint,
            checkpoint,
            cancel,
            checkpoint_failed: None,
            kept: may_fall_back.then(Vec::new),
            begun: 0,
            clock: Clock::start(),
            pace: Pace::new(0.0, false),
        })
    }

    /// Lets the processor go on if a GPU fails.
    #[cfg(all(test, feature = "gpu"))]
    pub(crate) fn may_fall_back(&mut self) {
        self.kept = Some(Vec::new());
    }

    /// Goes on from the checkpoint. False if there is none.
    pub(crate) fn resume(&mut self, work: &mut impl Work) -> Result<bool> {
        let Some(path) = self.checkpoint.clone().filter(|p| p.exists()) else { return Ok(false) };
        self.read(work, StateReader::open(&path, self.fingerprint)?)?;
        Ok(true)
    }

    fn read(&mut self, work: &mut impl Work, mut file: StateReader<'_>) -> Result<()> {
        let [done] = file.integers()?[..] else { return Err(file.error("steps")) };
        work.read(&mut file, &mut self.views)?;
        (self.done, self.begun) = (done, done);
        Ok(())
    }

    /// Runs to the end, calling `progress` now and then. Says why it ended. A run that is cancelled before its first
    /// step has nothing to show: [`Error::Interrupted`].
    pub(crate) fn run<W: Work>(
        &mut self,
        work: &mut W,
        mut progress: impl FnMut(&Progress<'_>),
    ) -> Result<StopReason> {
        if self.kept.is_some() {
            self.kept = Some(self.state(work));
        }
        self.clock = Clock::start();
        self.pace = Pace::new(work.seconds_after(self.done), W::FORECAST);
        loop {
            let end = self.steps(work, &mut progress);
            let Err(Error::Finetune(finetune::Error::Gpu { reason })) = &end else { return end };
            let Some(kept) = self.kept.take() else { return end };
            let kept = StateReader::new(Path::new("kept state"), kept, self.fingerprint)?;
            self.read(work, kept)?;
            self.backend = took_over(reason, self.done);
        }
    }

    /// Steps until the run ends.
    fn steps(
        &mut self,
        work: &mut impl Work,
        progress: &mut impl FnMut(&Progress<'_>),
    ) -> Result<StopReason> {
        let reason = loop {
            if self.cancel.as_ref().is_some_and(|c| c.load(Ordering::Relaxed)) {
                if self.done == 0 {
                    return Err(Error::Interrupted);
                }
                break StopReason::Cancelled;
            }
            if let Some(reason) = work.advance(&mut self.views)? {
                break reason;
            }
            if self.done > self.begun && work.due() {
                work.measure(&self.views)?;
                self.keep(work);
            }
            if self.backend.used == Backend::Gpu {
                work.place(&mut self.views)?;
            }
            let view = self.views.at(self.done);
            let psnr = work.step(&mut self.views, view)?;
            self.done += 1;
            if self.done.is_multiple_of(REPORTED) || self.done == work.steps() {
                progress(&self.progress(work, psnr));
                self.checkpoint_failed = None;
            }
        };
        work.fetch(&self.views)?;
        Ok(reason)
    }

    fn state(&self, work: &impl Work) -> Vec<u8> {
        let mut out = StateWriter::new(self.fingerprint);
        out.integers(&[self.done]);
        work.write(&mut out);
        out.finish()
    }

    /// Keeps the state: in the checkpoint, and for the case that the GPU fails. A checkpoint that cannot be written
    /// does not end the run, which goes on without checkpoints.
    pub(crate) fn keep(&mut self, work: &impl Work) {
        if self.checkpoint.is_none() && self.kept.is_none() {
            return;
        }
        let state = self.state(work);
        if let Some(Err(error)) =
            self.checkpoint.as_ref().map(|path| checkpoint::save(path, &state))
        {
            (self.checkpoint, self.checkpoint_failed) = (None, Some(error));
        }
        if let Some(kept) = &mut self.kept {
            *kept = state;
        }
    }

    pub(crate) fn progress<'a>(&'a mut self, work: &'a impl Work, psnr: f64) -> Progress<'a> {
        let seconds = self.clock.seconds();
        let RunState { stage, scene, aside_psnr, pass_psnr, bytes } = work.state();
        let (place, left) = ((stage, self.backend.used), work.seconds_after(self.done));
        let eta_seconds = self.pace.seconds_left(place, seconds, left);
        Progress {
            stage,
            step: self.done,
            steps: work.steps(),
            gaussians: scene.len(),
            psnr,
            aside_psnr,
            pass_psnr,
            bytes,
            seconds,
            eta_seconds,
            scene,
            backend: self.backend.used,
            checkpoint_failed: self.checkpoint_failed.as_ref(),
        }
    }
}

/// The report of a run that the processor took over.
fn took_over(reason: &str, step: u64) -> BackendReport {
    let threads = rayon::current_num_threads();
    let reason = format!("cpu: the GPU failed ({reason}); from step {step} on; {threads} threads");
    BackendReport { used: Backend::Cpu, reason }
}

#[cfg(test)]
mod tests {
    use super::*;
    use finetune::{Loss, Photo, TrainView};
    use gs_model::Camera;

    /// Adds the numbers of its steps and views. Its GPU fails after so many steps on it.
    #[derive(Default)]
    struct Sum {
        sum: u64,
        done: u64,
        fails_after: u64,
        on_gpu: Option<u64>,
        scene: Scene,
    }

    impl Work for Sum {
        fn steps(&self) -> u64 {
            50
        }

        fn advance(&mut self, _: &mut Views) -> Result<Option<StopReason>> {
            Ok((self.done == 50).then_some(StopReason::Steps))
        }

        fn due(&self) -> bool {
            self.done.is_multiple_of(12)
        }

        fn measure(&mut self, _: &Views) -> Result<()> {
            self.sum *= 3;
            Ok(())
        }

        fn place(&mut self, _: &mut Views) -> Result<()> {
            self.on_gpu.get_or_insert(0);
            Ok(())
        }

        fn step(&mut self, _: &mut Views, view: usize) -> Result<f64> {
            if let Some(steps) = &mut self.on_gpu {
                *steps += 1;
                if *steps > self.fails_after {
                    return Err(finetune::Error::Gpu { reason: "lost".into() }.into());
                }
            }
            self.sum = self.sum % 1_000_003 * 7 + self.done + view as u64;
            self.done += 1;
            Ok(0.0)
        }

        fn fetch(&mut self, _: &Views) -> Result<()> {
            Ok(())
        }

        fn write(&self, out: &mut StateWriter) {
            out.integers(&[self.sum, self.done]);
        }

        fn read(&mut self, input: &mut StateReader<'_>, _: &mut Views) -> Result<()> {
            let [sum, done] = input.integers()?[..] else { return Err(input.error("sum")) };
            (self.sum, self.done, self.on_gpu) = (sum, done, None);
            Ok(())
        }

        fn state(&self) -> RunState<'_> {
            let (stage, scene) = (StageName::Attributes, &self.scene);
            RunState { stage, scene, aside_psnr: None, pass_psnr: None, bytes: None }
        }
    }

    /// A run that is on a GPU, and may leave it.
    fn trainer(used: Backend, may_fall_back: bool, checkpoint: Option<&Path>) -> Trainer {
        let up = [0.0, -1.0, 0.0];
        let eye = [0.0, 0.0, -2.0];
        let camera = Camera::looking_at("front".into(), eye, [0.0; 3], up, [4, 3], 30.0);
        let view = TrainView { camera, photo: Photo::black(4, 3) };
        let views = Views::all(vec![view; 5], Loss::MSE, 1).unwrap();
        let checkpoint = checkpoint.map(Into::into);
        let mut trainer = Trainer::new(views, 7, Backend::Cpu, checkpoint, None).unwrap();
        trainer.backend = BackendReport { used, reason: "given".into() };
        trainer.kept = may_fall_back.then(Vec::new);
        trainer
    }

    #[test]
    fn a_run_whose_gpu_fails_goes_on_from_the_last_kept_step() {
        let whole = |fails_after| {
            let mut work = Sum { fails_after, ..Sum::default() };
            let mut trainer = trainer(Backend::Gpu, true, None);
            let mut told = Vec::new();
            let end = trainer.run(&mut work, |p| told.push((p.step, p.backend))).unwrap();
            assert_eq!((end, trainer.done), (StopReason::Steps, 50));
            (work.sum, trainer.backend, told)
        };
        let (sum, backend, _) = whole(1000);
        assert_eq!(backend.used, Backend::Gpu);
        // In the first step, before the first kept state, and after the second.
        for (fails_after, from) in [(0, 0), (11, 0), (33, 24)] {
            let (other, backend, told) = whole(fails_after);
            assert_eq!((other, backend.used), (sum, Backend::Cpu));
            let said = backend.reason;
            assert!(
                said.contains("lost") && said.contains(&format!("from step {from} on")),
                "{said}"
            );
            assert_eq!(told.last(), Some(&(50, Backend::Cpu)));
        }
        // The same holds after a run that ended well on the GPU.
        let mut trainer = trainer(Backend::Gpu, true, None);
        trainer.run(&mut Sum { fails_after: 1000, ..Sum::default() }, |_| ()).unwrap();
        trainer.run(&mut Sum { fails_after: 11, ..Sum::default() }, |_| ()).unwrap();
        assert_eq!((trainer.backend.used, trainer.done), (Backend::Cpu, 100));
    }

    #[test]
    fn a_run_that_is_cancelled_before_its_first_step_has_no_result() {
        let mut trainer = trainer(Backend::Cpu, false, None);
        trainer.cancel = Some(Arc::new(AtomicBool::new(true)));
        let end = trainer.run(&mut Sum::default(), |_| ());
        assert!(matches!(end, Err(Error::Interrupted)), "{end:?}");
    }

    #[test]
    fn a_gpu_that_was_asked_for_fails_with_an_error_and_the_checkpoint_stays() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.ckpt");
        let mut work = Sum { fails_after: 30, ..Sum::default() };
        let error = trainer(Backend::Gpu, false, Some(&path)).run(&mut work, |_| ()).unwrap_err();
        assert!(matches!(&error, Error::Finetune(finetune::Error::Gpu { .. })), "{error}");
        let mut rest = trainer(Backend::Cpu, false, Some(&path));
        let mut work = Sum::default();
        assert!(rest.resume(&mut work).unwrap());
        assert_eq!(rest.done, 24);
        rest.run(&mut work, |_| ()).unwrap();
        let mut whole = Sum::default();
        trainer(Backend::Cpu, false, None).run(&mut whole, |_| ()).unwrap();
        assert_eq!(work.sum, whole.sum);
    }
}
