//! The page of docs/results on `gsvx tune`: streams of several scenes, beside those without tuning.
//!
//! A point takes minutes. What was measured stays recorded for one build of the command, so the page can
//! be made in parts: a run measures what it is asked for and writes all that is recorded.

mod page;

use std::path::PathBuf;

use anyhow::{Result, ensure};

use crate::measure::Score;
use crate::process::GsvxCommand;
use crate::rd_curve::CurveOptions;
use crate::rd_curve::streams::{QUALITIES, StreamKind, StreamPoint, Streams};
use crate::rd_curve::study::Study;
use tune::TuneEffort;

/// Flags of `cargo xtask bench-tune`.
#[derive(Clone, Debug, clap::Args)]
pub struct TuneBenchOptions {
    /// Scenes of the page; the picture is of the first.
    #[arg(default_values_t = ["room", "fox", "bonsai"].map(String::from))]
    scenes: Vec<String>,
    /// Measure only these runs, for example normal,quick (all if none); others are shown as far as they
    /// are recorded.
    #[arg(long = "run", value_delimiter = ',')]
    runs: Vec<String>,
    /// Measure only these qualities (all if none).
    #[arg(long = "quality", value_delimiter = ',')]
    qualities: Vec<f32>,
    /// Where the page goes.
    #[arg(long, default_value = "docs/results/tune.md")]
    out: PathBuf,
}

/// Qualities of the curve without tuning.
const UNTUNED: [f32; 7] = [30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0];

/// Ways of tuning on the page.
const RUNS: [StreamKind; 3] = [
    StreamKind::Tune { effort: TuneEffort::Normal, distil: false },
    StreamKind::Tune { effort: TuneEffort::Quick, distil: false },
    StreamKind::Tune { effort: TuneEffort::Normal, distil: true },
];

/// The points of one way of tuning, by quality.
struct Tuned {
    how: StreamKind,
    points: Vec<StreamPoint>,
}

/// What the page has of one scene.
struct Scene {
    name: String,
    gaussians: usize,
    /// The model as it was trained, against the photos.
    original: Score,
    untuned: Vec<StreamPoint>,
    /// Streams that keep what the cameras do not see.
    untuned_all: Vec<StreamPoint>,
    tuned: Vec<Tuned>,
}

/// Measures and writes the page.
///
/// # Errors
/// If the command is not there or fails, or a scene cannot be read.
pub fn run(options: &TuneBenchOptions) -> Result<()> {
    let known = RUNS.map(StreamKind::name);
    for name in &options.runs {
        ensure!(known.contains(name), "{name}: no such run; there are {}", known.join(", "));
    }
    let gsvx = GsvxCommand::find()?;
    let scenes = options.scenes.iter().map(|name| scene(options, &gsvx, name));
    let scenes = scenes.collect::<Result<Vec<_>>>()?;
    page::page(options, &scenes).write()
}

fn scene(options: &TuneBenchOptions, gsvx: &GsvxCommand, name: &str) -> Result<Scene> {
    let study = Study::open(&CurveOptions::of(name)?)?;
    let original = study.original()?;
    let streams = Streams::open(&study, gsvx)?;
    let mut tuned = Vec::new();
    for how in RUNS {
        let asked = options.runs.is_empty() || options.runs.contains(&how.name());
        let point = |quality: f32| match &options.qualities {
            only if asked && (only.is_empty() || only.contains(&quality)) => {
                streams.point(how, quality).map(Some)
            }
            _ => streams.find(how, quality),
        };
        let points: Vec<_> = QUALITIES.into_iter().map(point).collect::<Result<_>>()?;
        tuned.push(Tuned { how, points: points.into_iter().flatten().collect() });
    }
    let untuned = |drop_unseen| {
        let points = UNTUNED.iter().map(|&q| streams.point(StreamKind::Encode { drop_unseen }, q));
        points.collect::<Result<Vec<_>>>()
    };
    Ok(Scene {
        name: study.test.files.name.clone(),
        gaussians: original.gaussians,
        original: original.score,
        untuned: untuned(true)?,
        untuned_all: untuned(false)?,
        tuned,
    })
}
