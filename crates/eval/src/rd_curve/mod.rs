//! Rate-distortion curves of a scene, from real streams: gsvx, its coding with a uniform octree and with
//! the paper's adaptive one, and the paper's coding, beside recorded and published points of other codecs.
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
use plan::{Coding, GSVX, TUNED};
use record::{Bd, Curve, Run};
use stages::Branch;
use study::Study;
use tune::Tuning;

pub use options::CurveOptions;
pub use size::{SizeOptions, run as size};

/// Measures the curves of a scene, or an experiment of the paper, and writes the report: `report.html`,
/// a JSON and the charts.
///
/// # Errors
/// If the scene cannot be read, an option is out of range or a file cannot be written.
pub fn run(options: &CurveOptions) -> Result<()> {
    let started = Instant::now();
    // Before anything long, so that a bad option is reported at once.
    let qualities = options.qualities()?;
    let options = &options.clone().with_tuned_room();
    let study = Study::open(options)?;
    let folder = match options.experiment {
        Some(experiment) => experiment.run(&study, options, &qualities)?,
        None => {
            curves(&study, options, &qualities)?;
            study.out.clone()
        }
    };
    let (skipped, stages) = study.tally();
    if skipped > 0 {
        println!(
            "{skipped} of {stages} stages were already done for the same inputs and were skipped"
        );
    }
    println!("report: {}", folder.join("report.html").display());
    println!("{:.1} s in all", started.elapsed().as_secs_f64());
    Ok(())
}

/// The default run: measures all curves of a scene and writes the report.
fn curves(study: &Study, options: &CurveOptions, qualities: &[f32]) -> Result<Run> {
    let original = study.original()?;
    let base = study.depth(options.depth)?;
    let tuning = options.finetune.map(|steps| Tuning { steps, initialised: true });
    let mut curves = Vec::new();
    for plan in plan::curves(base, options, qualities) {
        let (mut voxelized, mut points) = (Vec::new(), Vec::new());
        for (voxels, qualities) in &plan.steps {
            let branch = Branch::new(study, voxels, tuning);
            voxelized.push(branch.voxelized()?);
            for &quality in qualities {
                points.push(branch.coded(plan.name, Coding::of(plan.name, quality))?);
            }
        }
        curves.push(Curve { name: plan.name.into(), what: plan.what, voxelized, points });
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

/// Hull against hull: the tuned curve against ours, gsvx against our other curves, those against the
/// uniform one, all against the others.
fn compare(curves: &[Curve], others: &[published::Other]) -> Vec<Bd> {
    let mut out = Vec::new();
    let mut pair = |test: &Curve, anchor: &Curve| {
        out.push(sections::compare(test, &anchor.name, |metric| anchor.rates(metric)));
    };
    let (tuned, untuned): (Vec<&Curve>, Vec<&Curve>) = curves.iter().partition(|c| c.name == TUNED);
    for tuned in tuned {
        untuned.iter().rev().for_each(|curve| pair(tuned, curve));
    }
    if let [uniform, rest @ ..] = &untuned[..] {
        let (gsvx, rest): (Vec<&Curve>, Vec<&Curve>) =
            rest.iter().copied().partition(|c| c.name == GSVX);
        for gsvx in gsvx {
            rest.iter().for_each(|curve| pair(gsvx, curve));
            pair(gsvx, uniform);
        }
        rest.iter().for_each(|curve| pair(curve, uniform));
    }
    for other in others.iter().filter(|o| o.is_comparable()) {
        out.extend(
            curves.iter().map(|c| sections::compare(c, &other.name, |metric| other.rates(metric))),
        );
    }
    out
}
