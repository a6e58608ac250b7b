//! The page of docs/results on sizes: the default curves of several scenes side by side.

use std::path::PathBuf;

use anyhow::{Context, Result};

use crate::measure::Metric;
use crate::page::{Page, Table, signed};
use crate::rd_curve::plan::GSVX;
use crate::rd_curve::{self, CurveOptions};
use crate::record::{Record, Run};
use crate::report::headline::in_words;
use crate::report::run::curves_and_others;

/// Flags of `cargo xtask bench-size`.
#[derive(Clone, Debug, clap::Args)]
pub struct SizeOptions {
    /// Scenes to measure; the picture is of the first.
    #[arg(default_values_t = ["fox", "bonsai", "room"].map(String::from))]
    scenes: Vec<String>,
    /// Where the page goes.
    #[arg(long, default_value = "docs/results/rd.md")]
    out: PathBuf,
}

/// Measures the default curves of the scenes with all their held-out views and writes the page.
///
/// # Errors
/// If a scene cannot be read or a file cannot be written.
pub fn run(options: &SizeOptions) -> Result<()> {
    let mut runs = Vec::new();
    for scene in &options.scenes {
        let mut of_scene = CurveOptions::of(scene)?;
        (of_scene.sights, of_scene.finetune) = (true, Some(0));
        runs.push(rd_curve::curves(&of_scene)?);
    }
    let scenes: Vec<&str> = runs.iter().map(|r| r.scene.as_str()).collect();
    let sizes = runs.iter().map(|r| format!("{} {}", r.scene, r.original.gaussians));
    let mut page = Page::new(&options.out, "How small?");
    page.text(format!(
        "`cargo xtask bench-size {}`: no fine-tune. Gaussians: {}. Other codecs are recorded, or written here.",
        scenes.join(" "),
        sizes.collect::<Vec<_>>().join(", "),
    ));
    let first = runs.first().context("no scene")?;
    let title = format!("{}: PSNR over size", first.scene);
    page.chart("", curves_and_others(title, first, Metric::Psnr));
    page.text(
        "BD-rate of gsvx with cameras, %, by PSNR / SSIM / SSIMULACRA2. A dash: not recorded, or no common range.",
    );
    page.table(&against(&runs, &scenes));
    page.data("The points of gsvx:", points(&runs)?);
    page.text("Strategies of voxelization: [voxel](../../crates/voxel/README.md).");
    page.write()
}

/// What gsvx is compared with, in the order of the first scene that has it.
fn against(runs: &[Run], scenes: &[&str]) -> Table {
    let mut table = Table::new(format!("against | {}", scenes.join(" | ")));
    let mut anchors: Vec<&str> = Vec::new();
    for bd in runs.iter().flat_map(|r| &r.bd).filter(|b| b.test == GSVX) {
        if anchors.contains(&bd.anchor.as_str()) {
            continue;
        }
        anchors.push(&bd.anchor);
        let here = runs.iter().map(|run| {
            let found = run.bd.iter().find(|b| b.test == GSVX && b.anchor == bd.anchor);
            found.map_or([None; 3], |b| b.rates).map(|rate| signed(rate, 1, "")).join(" / ")
        });
        let here: Vec<String> = here.collect();
        table.row(format!("{} | {}", in_words(&bd.anchor), here.join(" | ")));
    }
    table
}

/// The points of gsvx.
fn points(runs: &[Run]) -> Result<Table> {
    let mut table = Table::new("scene | quality | bytes | dB | SSIM | SSIMULACRA2");
    for run in runs {
        let curve = run.curves.iter().find(|c| c.name == GSVX);
        for Record { setting, bytes, score, .. } in
            &curve.context("the run has no curve of gsvx")?.points
        {
            let scores = Metric::ALL.map(|metric| format!("{:.4}", metric.of(score)));
            table.row(format!("{} | {setting} | {bytes} | {}", run.scene, scores.join(" | ")));
        }
    }
    Ok(table)
}
