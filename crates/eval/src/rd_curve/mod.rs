//! Rate-distortion curves of a scene, from real streams: gsvx, its coding with a uniform octree and with
//! the paper's adaptive one, and the paper, beside recorded and published points of other codecs.
//!
//! A stage whose record carries the hash of its inputs, its settings and the program is not run
//! again, so a run that was cut goes on where it stopped.

pub(crate) mod options;
pub(crate) mod plan;
pub(crate) mod record;
mod size;
pub(crate) mod stages;
pub(crate) mod streams;
pub(crate) mod study;
pub(crate) mod tune;
mod tuned_curve;
mod views;

use std::fs;
use std::time::Instant;

use anyhow::{Context, Result};

use crate::published;
use crate::report::{self, sections};
use plan::{GSVX, PAPER, PAPER_TUNED, TUNED};
use record::{Bd, Curve, Run};
use stages::Branch;
use study::Study;

pub use options::CurveOptions;
pub use size::{SizeOptions, run as size};
pub(crate) use tuned_curve::one_tune;

/// Measures the curves of a scene and writes the report: `report.html`, a JSON and the charts.
///
/// # Errors
/// If the scene cannot be read, an option is out of range or a file cannot be written.
pub fn run(options: &CurveOptions) -> Result<()> {
    let started = Instant::now();
    // Before anything long, so that a bad option is reported at once.
    let qualities = options.qualities()?;
    let options = &options.clone().with_tuned_room();
    let study = Study::open(options)?;
    curves(&study, options, &qualities)?;
    let (skipped, stages) = study.tally();
    if skipped > 0 {
        println!(
            "{skipped} of {stages} stages were already done for the same inputs and were skipped"
        );
    }
    println!("report: {}", study.out.join("report.html").display());
    println!("{:.1} s in all", started.elapsed().as_secs_f64());
    Ok(())
}

/// The default run: measures all curves of a scene and writes the report.
fn curves(study: &Study, options: &CurveOptions, qualities: &[f32]) -> Result<Run> {
    let original = study.original()?;
    let base = study.depth(options.depth)?;
    let mut curves = Vec::new();
    for plan in plan::curves(base, options, qualities) {
        curves.push(measured(study, plan)?);
    }
    if let Some(effort) = options.tune {
        curves.push(tuned_curve::curve(study, effort, &options.tuned_qualities())?);
    }

    let found = &study.test.files;
    let mut others = study.others()?;
    others.retain(|o| !o.name.starts_with(published::NO_INIT));
    let (skipped, stages) = study.tally();
    let run = Run {
        scene: found.name.clone(),
        what: found.what.clone(),
        views: found.dataset.views.len(),
        held_out: found.dataset.held_out().len(),
        measured: study.test.held_out.len(),
        original,
        bd: compare(&curves, &others),
        curves,
        others,
        skipped,
        stages,
        manifest: study.manifest(),
    };
    let views = views::draw(&run, study)?;
    let json = study.out.join("rd.json");
    let text = serde_json::to_string_pretty(&run).context("rd.json")? + "\n";
    fs::write(&json, text).with_context(|| format!("write {}", json.display()))?;
    let document = report::run::document(&run, views);
    document.write(&study.out)?;
    document.print();
    Ok(run)
}

/// The curve of a plan.
pub(crate) fn measured(study: &Study, plan: plan::CurvePlan) -> Result<Curve> {
    let (mut voxelized, mut points) = (Vec::new(), Vec::new());
    // Several models may be coded at one quality.
    let several = plan.steps.iter().flat_map(|s| &s.1).any(|c| c.paper_setting().is_some());
    for (voxels, codings) in &plan.steps {
        let branch = Branch::new(study, voxels, plan.tuning);
        voxelized.push(branch.voxelized()?);
        let name = if several { branch.name() } else { plan.name.to_owned() };
        for &coding in codings {
            points.push(branch.coded(&name, coding)?);
        }
    }
    Ok(Curve { name: plan.name.into(), what: plan.what, voxelized, points })
}

/// Hull against hull, like with like: gsvx against what is not tuned, gsvx tuned against the paper fine-tuned and against
/// gsvx, and all but the tuned ones against other codecs, which are not tuned either.
fn compare(curves: &[Curve], others: &[published::Other]) -> Vec<Bd> {
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
    let of_pair = |(test, anchor): (&Curve, &Curve)| {
        sections::compare(test, &anchor.name, |metric| anchor.rates(metric))
    };
    let mut out: Vec<Bd> = pairs.into_iter().map(of_pair).collect();
    for other in others.iter().filter(|o| o.is_comparable()) {
        out.extend(untuned().map(|c| sections::compare(c, &other.name, |m| other.rates(m))));
    }
    out
}
