//! The page of docs/results on sizes: the default curves of several scenes side by side.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};

use super::plan::{self, GSVX};
use super::record::{Curve, Run};
use super::{Options, Study};
use crate::chart::Chart;
use crate::peers;
use crate::report;
use crate::report::headline::in_words;
use crate::report::sections::other_series;

/// Measures the default curves of `scenes` with all their held-out views and writes the page to `out`,
/// relative to the root of the workspace. The picture is of the first scene.
///
/// # Errors
/// If a scene cannot be read or a file cannot be written.
pub fn run(scenes: &[String], out: &Path) -> Result<()> {
    let mut runs = Vec::new();
    for scene in scenes {
        let options = Options {
            scene: scene.clone(),
            peers: peers::Options { none: true, ..peers::Options::default() },
            ..Options::default()
        };
        let qualities = plan::qualities(options.rates)?;
        runs.push(super::curves(&Study::open(&options)?, &options, &qualities)?);
    }
    let first = runs.first().context("no scene")?;
    crate::page::write(out, &page(&runs, out)?, Some(&chart(first)))
}

fn page(runs: &[Run], out: &Path) -> Result<String> {
    let scenes: Vec<&str> = runs.iter().map(|r| r.scene.as_str()).collect();
    let sizes: Vec<String> =
        runs.iter().map(|r| format!("{} {}", r.scene, r.original.gaussians)).collect();
    let picture = crate::page::picture(out, &format!("PSNR over size on {}", scenes[0]));
    let mut out = format!(
        "# How small?\n\n\
         `cargo xtask bench-size {}`: no fine-tune, sizes of whole streams, PSNR as the mean over the \
         held-out views against the photos. Gaussians: {}. The figures of other codecs are recorded \
         beside the scenes.\n\n\
         {picture}\n\n\
         BD-rate of gsvx with cameras, by pchip on the hulls of the points; negative is smaller:\n\n\
         | against | {} |\n|---|{}\n",
        scenes.join(" "),
        sizes.join(", "),
        scenes.join(" | "),
        "---:|".repeat(runs.len()),
    );
    for anchor in anchors(runs) {
        let cells = runs.iter().map(|run| {
            let bd = run.bd.iter().find(|b| b.test == GSVX && b.anchor == anchor);
            match bd {
                None => "not recorded".into(),
                Some(bd) => bd.rate_pchip.map_or("no overlap".into(), |r| format!("{r:+.2} %")),
            }
        });
        let cells: Vec<String> = cells.collect();
        writeln!(out, "| {} | {} |", in_words(&anchor), cells.join(" | "))?;
    }
    out += &points(runs)?;
    out += "\nWhy the paper's adaptive criteria need more bytes than uniform voxels: [voxel.md](voxel.md). \
            `cargo xtask rd-curve SCENE` writes all curves and pictures of a scene as one page.\n";
    Ok(out)
}

/// What gsvx is compared with, in the order of the first scene that has it.
fn anchors(runs: &[Run]) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for bd in runs.iter().flat_map(|r| &r.bd).filter(|b| b.test == GSVX) {
        if !out.contains(&bd.anchor) {
            out.push(bd.anchor.clone());
        }
    }
    out
}

fn ours(run: &Run) -> Result<&Curve> {
    run.curves.iter().find(|c| c.name == GSVX).context("the run has no curve of gsvx")
}

/// The points of gsvx, a row for each quality.
fn points(runs: &[Run]) -> Result<String> {
    let curves: Vec<&Curve> = runs.iter().map(ours).collect::<Result<_>>()?;
    let head: Vec<String> =
        runs.iter().map(|r| format!("{}: bytes | dB | SSIM", r.scene)).collect();
    let mut out =
        format!("\n| quality | {} |\n|---:|{}\n", head.join(" | "), "---:|".repeat(3 * runs.len()));
    for (i, first) in curves[0].points.iter().enumerate() {
        let cells = curves.iter().map(|c| {
            let p = &c.points[i];
            format!("{} | {:.3} | {:.4}", p.bytes, p.score.psnr_db, p.score.ssim)
        });
        let cells: Vec<String> = cells.collect();
        writeln!(out, "| {} | {} |", first.setting(), cells.join(" | "))?;
    }
    Ok(out)
}

/// Our curves, gsvx first, and those of others as far as the chart of a report has them.
fn chart(run: &Run) -> Chart {
    let mut series = report::run::series(&run.curves);
    series.reverse();
    let widest = series.iter().flat_map(|s| &s.points).map(|p| p.0).fold(0.0, f64::max);
    series.extend(other_series(&run.others, report::run::WIDEST * widest));
    let title = format!("{}: picture quality over size", run.scene);
    report::run::chart(title, series, run.original.score.psnr_db)
}
