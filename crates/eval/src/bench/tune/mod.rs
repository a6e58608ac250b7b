//! The page of docs/results on `gsvx tune`: streams of several scenes, beside those without tuning.
//!
//! A point takes minutes. What was measured stays recorded for one build of the command, so the page can
//! be made in parts: a run measures what it is asked for and writes all that is recorded.

mod page;
mod step;

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};

use crate::command;
use crate::rd_curve::streams::{How, Point, QUALITIES, Streams};
use crate::rd_curve::study::Study;
use crate::rd_curve::{Effort, Options as CurveOptions};

/// What [`run`] measures.
#[derive(Clone, Debug)]
pub struct Options {
    /// Scenes of the page.
    pub scenes: Vec<String>,
    /// Only these runs; all if none.
    pub runs: Vec<String>,
    /// Only these qualities of them; all if none.
    pub qualities: Vec<f32>,
    /// The command.
    pub gsvx: PathBuf,
    /// Another version to compare with, instead of the command's own streams without tuning.
    pub reference: Option<Reference>,
    /// Where the page goes, relative to the root of the workspace.
    pub out: PathBuf,
}

/// Another version of the command.
#[derive(Clone, Debug)]
pub struct Reference {
    /// As the page calls it.
    pub name: String,
    /// The command.
    pub gsvx: PathBuf,
}

/// `NAME=COMMAND`.
///
/// # Errors
/// If there is no such sign, or nothing before it.
pub fn parse_reference(text: &str) -> Result<Reference> {
    let (name, gsvx) = text.split_once('=').context("NAME=COMMAND expected")?;
    ensure!(!name.is_empty(), "a name is missing");
    Ok(Reference { name: name.into(), gsvx: gsvx.into() })
}

/// Qualities of the curve without tuning, and of that of a reference.
const UNTUNED: [f32; 7] = [30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0];
const REFERENCE: [f32; 5] = [34.0, 48.0, 62.0, 76.0, 90.0];

/// Ways of tuning on the page.
const RUNS: [How; 4] = [
    How::Tune { effort: Effort::Normal, distil: false, seed: 0 },
    How::Tune { effort: Effort::Normal, distil: false, seed: 1 },
    How::Tune { effort: Effort::Quick, distil: false, seed: 0 },
    How::Tune { effort: Effort::Normal, distil: true, seed: 0 },
];

/// Names of the ways of tuning, for a command line.
#[must_use]
pub fn runs() -> Vec<String> {
    RUNS.map(How::name).into()
}

/// The points of one way of tuning, by quality.
struct Tuned {
    how: How,
    points: Vec<Point>,
}

/// What the page has of one scene.
struct Scene {
    name: String,
    gaussians: usize,
    /// PSNR and SSIM of the model as it was trained.
    original: [f64; 2],
    /// What the tuned streams are compared with.
    anchor: Vec<Point>,
    tuned: Vec<Tuned>,
    step: step::Cost,
    /// Greatest memory of a plain fine-tune, MB.
    plain_peak_mb: f64,
}

/// Measures and writes the page.
///
/// # Errors
/// If the command is not there or fails, or a scene cannot be read.
pub fn run(options: &Options) -> Result<()> {
    for name in &options.runs {
        let known = runs();
        ensure!(known.contains(name), "{name}: no such run; there are {}", known.join(", "));
    }
    let scenes = options.scenes.iter().map(|name| scene(options, name));
    let scenes = scenes.collect::<Result<Vec<_>>>()?;
    let first = scenes.first().context("no scene")?;
    crate::page::write(
        &options.out,
        &page::text(options, &scenes)?,
        Some(&page::chart(options, first)),
    )
}

fn scene(options: &Options, name: &str) -> Result<Scene> {
    let study = Study::open(&CurveOptions { scene: name.into(), ..CurveOptions::default() })?;
    let original = study.original()?;
    let streams = Streams::open(&study, &options.gsvx)?;
    let anchor = match &options.reference {
        Some(other) => {
            let other = Streams::open(&study, &other.gsvx)?;
            let points = REFERENCE.iter().map(|&q| other.point(How::Reference, q));
            points.collect::<Result<_>>()?
        }
        None => {
            let points = UNTUNED.iter().map(|&q| streams.point(How::Encode, q));
            points.collect::<Result<_>>()?
        }
    };
    let mut tuned = Vec::new();
    for how in RUNS {
        let asked = options.runs.is_empty() || options.runs.contains(&how.name());
        let mut points = Vec::new();
        for quality in QUALITIES {
            let asked =
                asked && (options.qualities.is_empty() || options.qualities.contains(&quality));
            let point = match asked {
                true => Some(streams.point(how, quality)?),
                false => streams.find(how, quality)?,
            };
            points.extend(point);
        }
        tuned.push(Tuned { how, points });
    }
    let score = &original.score;
    Ok(Scene {
        name: study.test.files.name.clone(),
        gaussians: original.gaussians,
        original: [score.psnr_db, score.ssim],
        anchor,
        tuned,
        step: step::cost(&study)?,
        plain_peak_mb: step::plain_peak_mb(&study, &command::find(&options.gsvx)?)?,
    })
}
