//! The strategies at equal bytes after a fine-tune of the merged scene.

use std::fmt::Write;

use anyhow::Result;
use finetune::{FineTune, FineTuneOptions, TrainView};
use voxel::{Importance, Merge, Merging, RateDistortion, Strategy, voxelize};

use super::curves::{AT_50, bits, coded, lambda};
use super::models::Study;
use crate::bd::{self, Method, Point};

/// Qualities of the operating points; each with the uniform depth that is on the hull there.
const QUALITIES: [(f32, u8); 3] = [(40.0, 0), (54.0, 1), (68.0, 2)];

/// The strategies on one scene, before and after the fine-tune.
pub(super) struct Tuned {
    pub(super) scene: String,
    /// Name of each strategy but `Uniform`, and its BD-rates against `Uniform`, per cent.
    pub(super) strategies: Vec<(&'static str, [Option<f64>; 2])>,
    /// All points, as a table.
    pub(super) details: String,
}

const NAMES: [&str; 3] = ["Uniform", "Paper", "RateDistortion"];

pub(super) fn measure(study: &Study, steps: u64) -> Result<Tuned> {
    let mut out = format!(
        "## Equal bytes on {} after {steps} steps of fine-tune\n\n\
         | strategy | quality | Gaussians | bytes before | dB before | bytes after | dB after |\n\
         |---|---|---|---|---|---|---|\n",
        study.name
    );
    let strategy = |kind: usize, q: f32, deeper: u8| {
        let d = study.depth + deeper;
        match kind {
            0 => Strategy::Uniform { depth: d },
            1 => Strategy::paper(d - 2, d + 2),
            _ => {
                let mut o = RateDistortion::seen(lambda(AT_50[1], q), study.seen.clone());
                o.cost.gaussian = bits(q);
                Strategy::RateDistortion(o)
            }
        }
    };
    let views = study.training()?;
    let mut curves: Vec<[Vec<Point>; 2]> = Vec::new();
    for (kind, name) in NAMES.into_iter().enumerate() {
        let mut curve = [Vec::new(), Vec::new()];
        for (q, deeper) in QUALITIES {
            let v = voxelize(&study.scene, &study.cube, &strategy(kind, q, deeper))?;
            let seen = Importance::Given(study.seen.clone());
            let merged = Merging::new(&study.scene, &v, Merge::Moments, &seen)?.scene();
            let before = coded(study, &merged, &v, q)?;
            let tuned = tune(merged, &views, steps)?;
            let after = coded(study, &tuned, &v, q)?;
            let (b, a) = (before.psnr_db, after.psnr_db);
            eprintln!("{name} at {q}: {b:.2} dB, after {a:.2} dB");
            writeln!(
                out,
                "| {name} | {q:.0} | {} | {:.0} | {b:.2} | {:.0} | {a:.2} |",
                v.len(),
                before.rate,
                after.rate
            )?;
            curve[0].push(before);
            curve[1].push(after);
        }
        curves.push(curve);
    }
    let rate = |kind: usize, when: usize| {
        bd::bd_rate(&curves[0][when], &curves[kind][when], Method::Pchip)
    };
    let strategies = [1, 2].map(|kind| (NAMES[kind], [rate(kind, 0), rate(kind, 1)])).into();
    Ok(Tuned { scene: study.name.clone(), strategies, details: out })
}

fn tune(scene: gs_model::Scene, views: &[TrainView], steps: u64) -> Result<gs_model::Scene> {
    let options = FineTuneOptions { steps, report_every: 100, ..FineTuneOptions::default() };
    Ok(FineTune::new(scene, views.to_vec(), options)?.run(|_| {})?.scene)
}
