//! [`TuneOptions`]: what to aim for, and how long.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use finetune::Backend;
use gsvx::CodeOptions;

use crate::plan::{TuneEffort, TunePlan};

/// Quality used when none is asked for.
pub const DEFAULT_QUALITY: f32 = 58.0;

/// What the stream aims for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// A quality from 0 to 100, on the scale of [`gsvx::Steps::of_quality`].
    Quality(f32),
    /// At most so many bytes.
    Bytes(u64),
    /// So many dB against the photos, at the views kept aside.
    Psnr(f64),
}

/// What a stream has beside its finest level, as [`gsvx::CodeOptions`] describes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layout {
    /// The finest level alone.
    #[default]
    Finest,
    /// A coarse scene first.
    CoarseFirst,
    /// What a web page wants: a coarse scene first, and small chunks.
    Web,
}

impl Layout {
    /// What a web page wants, or a coarse scene first, or neither.
    #[must_use]
    pub fn of(web: bool, lod: bool) -> Self {
        match (web, lod) {
            (true, _) => Self::Web,
            (false, true) => Self::CoarseFirst,
            (false, false) => Self::Finest,
        }
    }

    /// How an encoder makes it.
    #[must_use]
    pub fn code(self) -> CodeOptions {
        let mut options = CodeOptions { lod: self == Self::CoarseFirst, ..CodeOptions::default() };
        if self == Self::Web {
            options.for_web();
        }
        options
    }
}

/// What a run makes in the end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Goal {
    pub(crate) target: Target,
    pub(crate) layout: Layout,
}

/// How to tune.
#[derive(Clone, Debug)]
pub struct TuneOptions {
    /// What the stream aims for.
    pub target: Target,
    /// Qualities of further streams of the same run, each below the one before; the target is a quality then. Each
    /// goes on from the stream before: five streams take about twice the time of one.
    pub further: Vec<f32>,
    /// What the stream has beside its finest level. Its bytes count.
    pub layout: Layout,
    /// How long to tune.
    pub effort: TuneEffort,
    /// A plan of the caller's instead of the one that follows from target and effort.
    pub plan: Option<TunePlan>,
    /// Leave out what the views do not show, and judge the scene at the views alone: fewer bytes, and good only where
    /// the cameras stand.
    pub drop_unseen: bool,
    /// Where the steps with the codec in the loop are made, and the sums that pruning follows. The steps between rounds of pruning
    /// are on the processor.
    pub backend: Backend,
    /// Seed of the order of the views.
    pub seed: u64,
    /// Where to keep a checkpoint. An existing one is continued.
    pub checkpoint: Option<PathBuf>,
    /// Setting it ends the run after the current step; what has been reached is encoded.
    pub cancel: Option<Arc<AtomicBool>>,
}

impl TuneOptions {
    /// Target and layout.
    pub(crate) fn goal(&self) -> Goal {
        Goal { target: self.target, layout: self.layout }
    }

    /// Normal effort, on the processor.
    #[must_use]
    pub fn new(target: Target) -> Self {
        Self {
            target,
            further: Vec::new(),
            layout: Layout::Finest,
            effort: TuneEffort::Normal,
            plan: None,
            drop_unseen: false,
            backend: Backend::Cpu,
            seed: 0,
            checkpoint: None,
            cancel: None,
        }
    }
}
