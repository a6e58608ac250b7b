//! The paper's experiments as named runs: Fig. 6 (`baseline`), Fig. 7 (`init`), Fig. 8 and
//! Table 1 (`adaptive`), Fig. 9 (`sota`).
//!
//! All share the stages of the scene's folder, so a model that one experiment tuned is not tuned again
//! by the next.

mod adaptive;
mod baseline;
mod init;
mod page;
mod sota;

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use serde::Serialize;
use voxel::Strategy;

use crate::published::Other;
use crate::rd_curve::options::{CurveOptions, Experiment};
use crate::rd_curve::plan::{Coding, PAPER_QPS, Voxels};
use crate::rd_curve::record::{Bd, Curve, Original};
use crate::rd_curve::stages::Branch;
use crate::rd_curve::study::Study;
use crate::rd_curve::tune::Tuning;
use crate::report::{Section, sections};

/// Steps of every fine-tune unless given: about a minute on two cores. The paper takes 8000 to 30000.
const STEPS: u64 = 400;
/// The second depth is this much deeper than the first.
const DEEPER: u8 = 2;
/// The paper's adaptive trees reach from so many levels above the uniform depth to so many below.
const ABOVE: u8 = 3;
const BELOW: u8 = 1;

/// Qualities at which the codec's own voxelizations are tuned.
const TUNED_AT: [f32; 3] = [34.0, 62.0, 90.0];

fn nearest(quality: f32) -> f32 {
    let distance = |at: &f32| (at - quality).abs();
    TUNED_AT.into_iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(TUNED_AT[0])
}

/// What an experiment works on.
struct Inputs<'a> {
    study: &'a Study,
    options: &'a CurveOptions,
    qualities: &'a [f32],
    original: Original,
    /// Uniform depth that the scene asks for.
    depth: u8,
    steps: u64,
}

/// `NAME.json`.
#[derive(Serialize)]
struct Record<'a> {
    experiment: &'a str,
    scene: &'a str,
    measured: usize,
    original: &'a Original,
    curves: &'a [Curve],
    bd: &'a [Bd],
    others: &'a [Other],
    manifest: Vec<(&'static str, String)>,
}

/// Results of an experiment.
#[derive(Default)]
struct Results {
    title: &'static str,
    lead: String,
    highlights: Vec<(String, String)>,
    /// Of its own, before those that all experiments have.
    sections: Vec<Section>,
    curves: Vec<Curve>,
    bd: Vec<Bd>,
    others: Vec<Other>,
}

impl Experiment {
    /// Runs it, prints its tables and writes its folder, which is returned.
    pub(crate) fn run(
        self,
        study: &Study,
        options: &CurveOptions,
        qualities: &[f32],
    ) -> Result<PathBuf> {
        let original = study.original()?;
        let depth = study.depth(options.depth)?;
        let steps = options.finetune.unwrap_or(STEPS);
        let inputs = Inputs { study, options, qualities, original, depth, steps };
        let (name, results) = match self {
            Self::Baseline => ("baseline", baseline::run(&inputs)?),
            Self::Init => ("init", init::run(&inputs)?),
            Self::Adaptive => ("adaptive", adaptive::run(&inputs)?),
            Self::Sota => ("sota", sota::run(&inputs)?),
        };
        let out = study.out.join(name);
        fs::create_dir_all(&out).with_context(|| format!("create {}", out.display()))?;
        let record = Record {
            experiment: name,
            scene: &study.test.files.name,
            measured: study.test.held_out.len(),
            original: &inputs.original,
            curves: &results.curves,
            bd: &results.bd,
            others: &results.others,
            manifest: study.manifest(),
        };
        let json = out.join(format!("{name}.json"));
        let text = serde_json::to_string_pretty(&record).context("record of an experiment")?;
        fs::write(&json, text + "\n").with_context(|| format!("write {}", json.display()))?;
        let document = page::document(&inputs, results);
        document.write(&out)?;
        document.print();
        Ok(out)
    }
}

impl Inputs<'_> {
    fn uniform(&self, depth: u8) -> Voxels {
        named(Voxels::fixed(Strategy::Uniform { depth }), format!("uniform, J = {depth}"))
    }

    /// The paper's adaptive criteria around a uniform depth.
    fn adaptive(&self, depth: u8) -> Voxels {
        let around = (depth.saturating_sub(ABOVE).max(1), (depth + BELOW).min(20));
        let (low, high) = self.options.adaptive.filter(|_| depth == self.depth).unwrap_or(around);
        let what = format!("paper's criteria, J = {low} to {high}");
        named(Voxels::fixed(Strategy::paper(low, high)), what)
    }

    /// The codec's own voxelization at a quality.
    fn default(&self, quality: f32) -> Voxels {
        named(Voxels::default(quality), format!("gsvx, quality {quality:.0}"))
    }

    /// The codec's own voxelizations that are tuned, each with the qualities near it. As without a
    /// fine-tune, the octree depends on the rate.
    fn tuned_parts(&self) -> Vec<(Voxels, Vec<Coding>)> {
        let codings = |at: f32| -> Vec<Coding> {
            let near = self.qualities.iter().filter(|q| nearest(**q) == at);
            near.map(|&q| Coding::Quality(q)).collect()
        };
        let parts = TUNED_AT.iter().map(|&at| (self.default(at), codings(at)));
        parts.filter(|(_, codings)| !codings.is_empty()).collect()
    }

    /// Both uniform depths.
    fn depths(&self) -> [u8; 2] {
        [self.depth, (self.depth + DEEPER).min(20)]
    }

    fn tuning(&self, initialised: bool) -> Option<Tuning> {
        Some(Tuning { steps: self.steps, initialised })
    }

    /// One curve: a voxelized model, perhaps tuned, at several codings.
    fn curve(
        &self,
        name: &str,
        what: String,
        parts: &[(Voxels, Vec<Coding>)],
        tuning: Option<Tuning>,
    ) -> Result<Curve> {
        let (mut voxelized, mut points) = (Vec::new(), Vec::new());
        for (voxels, codings) in parts {
            let branch = Branch::new(self.study, voxels, tuning);
            voxelized.push(branch.voxelized()?);
            for &coding in codings {
                // The model is in the name, because experiments share the folder of streams.
                points.push(branch.coded(&format!("{name}-{}", branch.name()), coding)?);
            }
        }
        Ok(Curve { name: name.to_owned(), what, voxelized, points })
    }

    /// The paper's coding at all QPs with the codebook, and at the upper half with lossless covariance.
    fn paper(&self) -> Vec<Coding> {
        let n = PAPER_QPS.len();
        let lossy = (0..n).map(|i| Coding::of_triple(i, false, None));
        lossy.chain((n / 2..n).map(|i| Coding::of_triple(i, true, None))).collect()
    }

    /// The codec's own coding at the run's qualities.
    fn own(&self) -> Vec<Coding> {
        self.qualities.iter().map(|&q| Coding::Quality(q)).collect()
    }

    /// Published and recorded points that an experiment shows beside its own.
    fn others(&self, shown: impl Fn(&Other) -> bool) -> Result<Vec<Other>> {
        let mut all = self.study.others()?;
        all.retain(shown);
        Ok(all)
    }

    /// Path of the scene's folder in the commands of a report.
    fn scene(&self) -> &str {
        &self.study.test.files.name
    }
}

/// The voxelization in other words, which a chart of several kinds needs.
fn named(voxels: Voxels, what: String) -> Voxels {
    Voxels { what, ..voxels }
}

/// Bjontegaard differences of curves.
fn compare(test: &Curve, anchor: &Curve) -> Bd {
    sections::compare(test, &anchor.name, |metric| anchor.rates(metric))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_quality_has_a_tuned_voxelization() {
        for q in crate::rd_curve::CurveOptions::of("room").unwrap().qualities().unwrap() {
            assert!((nearest(q) - q).abs() <= 14.0, "{q}");
        }
    }
}
