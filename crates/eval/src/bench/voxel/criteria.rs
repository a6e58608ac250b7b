//! Run time against error: the exact barycenter criterion beside the cheap ones.

use std::fmt::Write;
use std::time::Instant;

use anyhow::Result;
use gs_model::Scene;
use voxel::{
    CostModel, Cube, Importance, RateDistortion, Strategy, Voxelization, rate_distortion, voxelize,
    w2,
};

use super::Options;
use super::models;

/// Levels below and above the comparison depth.
const BELOW: u8 = 2;
const ABOVE: u8 = 2;
/// Bisection steps that match the number of leaves.
const STEPS: usize = 16;
/// Each criterion is repeated for this many seconds and at least [`RUNS`] times; the fastest run
/// counts, since other programs share the machine. Runs of more than [`LONG`] seconds are not
/// repeated.
const BUDGET: f64 = 0.5;
const RUNS: usize = 9;
const LONG: f64 = 5.0;
/// Gaussians of the replicated model, in thousands.
const LARGE: usize = 2000;

/// One model: the cheap criteria beside the exact one.
pub(super) struct Comparison {
    pub(super) model: String,
    pub(super) gaussians: usize,
    /// Seconds of the exact criterion.
    pub(super) seconds: f64,
    /// `Paper` and `RateDistortion`: how many times faster, and the total of eq. 5 over that of the
    /// exact criterion.
    pub(super) cheap: [[f64; 2]; 2],
}

/// Measures all models; returns the comparisons, and all figures as a table.
pub(super) fn measure(args: &Options) -> Result<(Vec<Comparison>, String)> {
    let mut all = Vec::new();
    let mut out = "## Run time against eq. 5\n\n\
         All octrees span the same depths; the limit of the exact criterion and lambda are set \
         so that the number of leaves is that of `Paper`. `d` is the total of eq. 5 over all \
         leaves, exact barycenters, in squared world units. Runs below 5 s are the fastest of \
         9 and more, for half a second each. `skipped`: cells whose subtrees the pruning did not look into, of those decided.\n\n\
         | model | Gaussians | depths | criterion | leaves | ms | times faster | d | d / exact | skipped |\n\
         |---|---|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    let shared = &args.shared;
    let models = [
        ("leica-sofort", "models/leica-sofort-top8192.ply"),
        ("kacy", "models/kacy_7000.ply"),
        ("fruit_drops", "models/fruit_drops_minimal.ply"),
        ("fox", "scenes/fox/point_cloud.ply"),
        ("bonsai", "scenes/bonsai/point_cloud.ply"),
    ];
    for (name, path) in models {
        let scene = models::read(&shared.join(path))?;
        let (found, comparison) = rows(name, &scene, None, &mut out)?;
        all.push(comparison);
        if name == "fox" {
            let cube = voxel::cube_of(&scene.means)?;
            let large = models::replicated(&scene, &cube, LARGE * 1000);
            all.push(rows("fox, replicated", &large, Some(found), &mut out)?.1);
        }
    }
    Ok((all, out))
}

/// Parameters found on the small model, for its replica.
#[derive(Clone, Copy)]
struct Found {
    limit: f64,
    lambda: f64,
}

fn rows(
    name: &str,
    scene: &Scene,
    known: Option<Found>,
    out: &mut String,
) -> Result<(Found, Comparison)> {
    let cube = voxel::cube_of(&scene.means)?;
    let depth = models::depth_of(scene, &cube)?;
    let (low, high) = (depth - BELOW, depth + ABOVE);
    let (paper, paper_s) = fastest(&|| Ok(voxelize(scene, &cube, &Strategy::paper(low, high))?))?;
    let want = paper.len();
    let exact = |limit: f64| Ok(w2::voxelize_exact(scene, &cube, low, high, limit)?);
    let limit = match known {
        Some(found) => found.limit,
        // A greater limit gives fewer leaves. The distortion of a voxel is at most about its side
        // squared times the number of Gaussians.
        None => bisect(1e-12 * cube.side * cube.side, cube.side * cube.side, |limit| {
            Ok(exact(limit)?.len() > want)
        })?,
    };
    let (exact, exact_s) = fastest(&|| exact(limit))?;
    // The objective of eq. 5: all Gaussians have the same weight, and only leaves cost bits.
    let options = |lambda: f64| RateDistortion {
        j_low: low,
        j_high: high,
        cost: CostModel { gaussian: 1.0, occupancy: [0.0; 8], stop: 0.0, go_on: 0.0 },
        importance: Importance::Given(vec![1.0; scene.len()]),
        size_exponent: 0.0,
        shape: 1.0,
        colour: 0.0,
        ..RateDistortion::new(lambda)
    };
    let lambda = match known {
        Some(found) => found.lambda,
        None => bisect(1e-12, 1e6, |lambda| {
            Ok(rate_distortion(scene, &cube, &options(lambda))?.0.len() > want)
        })?,
    };
    let prepared = options(lambda);
    let (ours, ours_s) = fastest(&|| Ok(rate_distortion(scene, &cube, &prepared)?.0))?;
    let (_, report) = rate_distortion(scene, &cube, &prepared)?;
    let skipped = format!("{} of {}", report.skipped, report.decided);

    let exact_d = w2::total_distortion(scene, &exact);
    let mut cheap = Vec::new();
    for (criterion, v, seconds, skipped) in [
        ("exact barycenter", &exact, exact_s, "-"),
        ("Paper", &paper, paper_s, "-"),
        ("RateDistortion", &ours, ours_s, &skipped),
    ] {
        let d = w2::total_distortion(scene, v);
        writeln!(
            out,
            "| {name} | {} | {low} to {high} | {criterion} | {} | {:.3} | {:.1} | {d:.4e} | {:.3} | {skipped} |",
            scene.len(),
            v.len(),
            1e3 * seconds,
            exact_s / seconds,
            d / exact_d
        )?;
        cheap.push([exact_s / seconds, d / exact_d]);
    }
    let comparison = Comparison {
        model: name.to_owned(),
        gaussians: scene.len(),
        seconds: exact_s,
        cheap: [cheap[1], cheap[2]],
    };
    Ok((Found { limit, lambda }, comparison))
}

/// The result of a criterion, and the seconds of its fastest run.
fn fastest(run: &dyn Fn() -> Result<Voxelization>) -> Result<(Voxelization, f64)> {
    let mut best = f64::INFINITY;
    let (began, mut done) = (Instant::now(), 0);
    loop {
        let start = Instant::now();
        let v = run()?;
        best = best.min(start.elapsed().as_secs_f64());
        done += 1;
        let enough = done >= RUNS && began.elapsed().as_secs_f64() > BUDGET;
        if enough || best > LONG {
            return Ok((v, best));
        }
    }
}

/// The least argument between `low` and `high` for which `more` is false, by bisection of the
/// logarithm. `more` must be true below it and false above.
fn bisect(low: f64, high: f64, more: impl Fn(f64) -> Result<bool>) -> Result<f64> {
    let (mut low, mut high) = (low.ln(), high.ln());
    for _ in 0..STEPS {
        let middle = 0.5 * (low + high);
        if more(middle.exp())? {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(high.exp())
}
