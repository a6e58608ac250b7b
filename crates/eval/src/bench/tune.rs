//! The page of docs/results on `gsvx tune`: streams of several scenes, beside those without tuning.
//!
//! A point takes minutes. What was measured stays recorded for one build of the command, so the page can
//! be made in parts: a run measures what it is asked for and writes all that is recorded.

mod page;
mod streams;

use std::path::PathBuf;

use anyhow::{Result, ensure};

use crate::process::GsvxCommand;
use crate::rd_curve::options::TUNED_QUALITIES;
use crate::record::Record;
use crate::study::Study;
use streams::{StreamKind, Streams};

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
const RUNS: [StreamKind; 3] = [StreamKind::NORMAL, StreamKind::QUICK, StreamKind::DISTIL];

/// What the page has of one scene.
struct Scene {
    name: String,
    /// The model as it was trained, against the photos.
    original: Record,
    untuned: Vec<Record>,
    /// Streams that keep what the cameras do not see.
    untuned_all: Vec<Record>,
    /// The points of each way of tuning, by quality.
    tuned: Vec<(StreamKind, Vec<Record>)>,
}

/// Measures and writes the page.
///
/// # Errors
/// If the command is not there or fails, or a scene cannot be read.
pub fn run(options: &TuneBenchOptions) -> Result<()> {
    let known = RUNS.map(|how| how.name);
    for name in &options.runs {
        let is_known = known.contains(&name.as_str());
        ensure!(is_known, "{name}: no such run; there are {}", known.join(", "));
    }
    let gsvx = GsvxCommand::find()?;
    let scenes = options.scenes.iter().map(|name| scene(options, &gsvx, name));
    page::page(options, &scenes.collect::<Result<Vec<_>>>()?).write()
}

fn scene(options: &TuneBenchOptions, gsvx: &GsvxCommand, name: &str) -> Result<Scene> {
    let study = Study::of(name)?;
    let original = study.original()?;
    let streams = Streams::open(&study, gsvx)?;
    let tuned = RUNS.map(|how| {
        let asked = options.runs.is_empty() || options.runs.iter().any(|run| run == how.name);
        let point = |&quality: &f32| match &options.qualities {
            only if asked && (only.is_empty() || only.contains(&quality)) => {
                streams.point(how, quality).map(Some)
            }
            _ => streams.find(how, quality),
        };
        let points = TUNED_QUALITIES.iter().filter_map(|q| point(q).transpose());
        Ok((how, points.collect::<Result<_>>()?))
    });
    let tuned = tuned.into_iter().collect::<Result<_>>()?;
    let untuned =
        |how| UNTUNED.iter().map(|&q| streams.point(how, q)).collect::<Result<Vec<Record>>>();
    let (untuned, untuned_all) = (untuned(StreamKind::UNTUNED)?, untuned(StreamKind::ALL_KEPT)?);
    Ok(Scene { name: study.test.files.name.clone(), original, untuned, untuned_all, tuned })
}
