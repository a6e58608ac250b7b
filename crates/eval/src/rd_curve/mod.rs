//! Rate-distortion curves of a scene, from real streams: gsvx, its coding with a uniform octree and with
//! the paper's adaptive one, and the paper, beside recorded and published points of other codecs.
//!
//! A stage whose record carries the hash of its inputs, its settings and the program is not run
//! again, so a run that was cut goes on where it stopped.

mod fine_tune;
pub(crate) mod options;
pub(crate) mod plan;
pub(crate) mod stages;
mod tuned;
mod views;

use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result};
use gs_model::ply;

use crate::peers;
use crate::record::{Bd, Curve, Run};
use crate::report::{self, sections};
use plan::{GSVX, PAPER, PAPER_TUNED, TUNED};

pub use options::CurveOptions;
pub(crate) use tuned::one_tune;

/// Flags of `cargo xtask paper-decode`.
#[derive(Clone, Debug, clap::Args)]
pub struct DecodeOptions {
    /// A stream of the paper's codec, as `rd-curve` writes them
    stream: PathBuf,
    /// The PLY to write
    out: PathBuf,
}

/// Writes the model in a stream of the paper's codec.
///
/// # Errors
/// If a file cannot be read or written, or the stream is broken.
pub fn decode(options: &DecodeOptions) -> Result<()> {
    let DecodeOptions { stream, out } = options;
    let name = || stream.display().to_string();
    let scene = paper::decode(&fs::read(stream).with_context(name)?).with_context(name)?;
    ply::write(out, &scene)?;
    println!("{}: {} Gaussians", out.display(), scene.len());
    Ok(())
}

/// Measures the curves of a scene and writes the report: `report.html`, a JSON and the charts.
///
/// # Errors
/// If the scene cannot be read, an option is out of range or a file cannot be written.
pub fn run(options: &CurveOptions) -> Result<()> {
    let started = Instant::now();
    let [skipped, stages] = curves(&options.clone().with_tuned_room())?.stages;
    if skipped > 0 {
        println!(
            "{skipped} of {stages} stages were already done for the same inputs and were skipped"
        );
    }
    println!("{:.1} s in all", started.elapsed().as_secs_f64());
    Ok(())
}

/// The default run: measures all curves of a scene and writes the report.
pub(crate) fn curves(options: &CurveOptions) -> Result<Run> {
    // Before anything long, so that a bad option is reported at once.
    let qualities = options.qualities()?;
    let study = &options.study()?;
    let original = study.original()?;
    let base = plan::depth(study, options.depth)?;
    let plans = plan::curves(base, options, &qualities).into_iter();
    let mut curves = plans.map(|plan| stages::curve(study, plan)).collect::<Result<Vec<_>>>()?;
    if let Some(effort) = options.tune {
        curves.push(tuned::curve(study, effort, &options.tuned_qualities())?);
    }

    let found = &study.test.files;
    let others = peers::curves(study)?;
    let run = Run {
        scene: found.name.clone(),
        what: found.what.clone(),
        views: found.dataset.views.len(),
        held_out: found.dataset.held_out().len(),
        measured: study.test.held_out.len(),
        original,
        sh_degree: study.test.model.sh_degree,
        invalid: study.test.invalid,
        bd: compare(&curves, &others),
        curves,
        others,
        stages: study.cache.tally(),
        manifest: study.manifest(),
    };
    let views = views::draw(&run, study)?;
    let json = study.out.join("rd.json");
    let text = serde_json::to_string_pretty(&run).context("rd.json")? + "\n";
    fs::write(&json, text).with_context(|| format!("write {}", json.display()))?;
    let document = report::run::document(&run, views);
    document.write(&study.out)?;
    document.print();
    println!("report: {}", study.out.join("report.html").display());
    Ok(run)
}

/// Hull against hull, like with like: gsvx against what is not tuned, gsvx tuned against the paper fine-tuned and against
/// gsvx, and all but the tuned ones against other codecs, which are not tuned either.
fn compare(curves: &[Curve], others: &[Curve]) -> Vec<Bd> {
    let named = |name| curves.iter().find(move |c| c.name == name);
    let is_tuned = |c: &&Curve| [TUNED, PAPER_TUNED].contains(&c.name.as_str());
    let untuned = || curves.iter().filter(|c| !is_tuned(c));
    let mut pairs: Vec<(&Curve, &Curve)> = Vec::new();
    if let Some(tuned) = named(TUNED) {
        pairs.extend([PAPER_TUNED, GSVX].iter().filter_map(|n| Some((tuned, named(n)?))));
    }
    if let Some(gsvx) = named(GSVX) {
        pairs.extend(untuned().filter(|c| c.name != GSVX).map(|anchor| (gsvx, anchor)));
    }
    if let (Some(paper), Some(tuned)) = (named(PAPER), named(PAPER_TUNED)) {
        pairs.push((tuned, paper));
    }
    for other in others.iter().filter(|o| o.is_comparable()) {
        pairs.extend(untuned().map(|curve| (curve, other)));
    }
    pairs.into_iter().map(|(test, anchor)| sections::compare(test, anchor)).collect()
}
