//! `cargo xtask bench-error`: seconds against error, of each stage against f64 and of whole commands in dB.

mod commands;
mod stages;

use std::path::PathBuf;

use anyhow::{Context, Result};

use crate::chart::{Axis, Chart, Series};
use crate::manifest;
use crate::page::{Page, Table, number};
use crate::study::Study;

/// Flags of `cargo xtask bench-error`.
#[derive(Clone, Debug, clap::Args)]
pub struct ErrorOptions {
    /// Scenes; the page shows the first, its data has all
    #[arg(default_values_t = ["fox", "bonsai"].map(String::from))]
    scenes: Vec<String>,
    /// Where the page goes
    #[arg(long, default_value = "docs/results/error.md")]
    out: PathBuf,
}

/// Measures and writes the page.
///
/// # Errors
/// If the command is not there or fails, or the scene cannot be read.
pub fn run(options: &ErrorOptions) -> Result<()> {
    let scenes = options.scenes.iter().map(|name| OneScene::measured(name));
    let scenes = scenes.collect::<Result<Vec<_>>>()?;
    let first = scenes.first().context("no scene is given")?;
    let mut page = Page::new(&options.out, "What does accuracy cost?");
    page.text(format!(
        "`cargo xtask bench-error {}`. Here: {}. {}. Stages: within one process, the best of {} runs; \
         commands: whole processes. \"Buys\": beside the row before.",
        options.scenes.join(" "),
        first.about,
        manifest::machine(),
        stages::RUNS,
    ));
    let [seconds, error] = ["seconds", "relative error"].map(Axis::logarithmic);
    let title = format!("{}: stages, error over seconds", options.scenes[0]);
    page.chart("-stages", Chart::new(title, [seconds.clone(), error], series(&first.stages), None));
    let title = format!("{}: commands, dB over seconds", options.scenes[0]);
    let db = Axis::linear("PSNR against renders of the input, dB");
    let drawn = first.commands.iter().filter(|f| f.is_drawn);
    page.chart("-commands", Chart::new(title, [seconds, db], series(drawn), None));
    for family in first.families() {
        page.text(format!("## {}", family.heading));
        page.text(&family.about);
        page.table(&family.table);
    }
    let about: Vec<&str> = scenes.iter().map(|scene| scene.about.as_str()).collect();
    let mut all = Table::new("scene | family | what | seconds | error, or PSNR in dB");
    for (name, scene) in options.scenes.iter().zip(&scenes) {
        for family in scene.families() {
            for (what, (seconds, error)) in family.names.iter().zip(&family.points) {
                let heading = family.heading;
                all.row(format!("{name} | {heading} | {what} | {seconds:.4} | {error:.3e}"));
            }
        }
    }
    page.data(&format!("Each row of each scene ({}):", about.join("; ")), all);
    page.write()
}

/// What is measured of one scene.
struct OneScene {
    about: String,
    stages: Vec<Family>,
    commands: Vec<Family>,
}

impl OneScene {
    fn measured(name: &str) -> Result<Self> {
        let study = Study::of(name)?;
        let (gaussians, views) = (study.test.model.len(), study.test.held_out.len());
        Ok(Self {
            about: format!("{name}, {gaussians} Gaussians, {views} held-out views"),
            stages: stages::families(&study)?,
            commands: commands::families(&study)?,
        })
    }

    fn families(&self) -> impl Iterator<Item = &Family> {
        self.stages.iter().chain(&self.commands)
    }
}

fn series<'a>(families: impl IntoIterator<Item = &'a Family>) -> Vec<Series> {
    families.into_iter().map(|f| Series::marks(f.heading, f.points.clone())).collect()
}

/// Ways to do one thing.
struct Family {
    heading: &'static str,
    /// What the error is.
    about: String,
    table: Table,
    /// What each row is.
    names: Vec<String>,
    /// Seconds and error of each row.
    points: Vec<(f64, f64)>,
    /// Whether the error is the one of the chart.
    is_drawn: bool,
}

impl Family {
    /// `columns` lie between the error and what a row buys.
    fn new(heading: &'static str, about: impl Into<String>, columns: &str) -> Self {
        let table = Table::new(format!("{heading} | seconds | {columns} | buys"));
        Self {
            heading,
            about: about.into(),
            table,
            names: Vec::new(),
            points: Vec::new(),
            is_drawn: true,
        }
    }

    /// A row whose error `cells` state.
    fn row(&mut self, what: &str, seconds: f64, error: f64, cells: &str, buys: &str) {
        let decimals = if seconds < 0.1 { 4 } else { 2 };
        self.table.told(format!("{what} | {} | {cells} | {buys}", number(seconds, decimals)));
        self.names.push(what.to_owned());
        self.points.push((seconds, error));
    }
}

/// An error as a cell.
fn small(error: f64) -> String {
    if error == 0.0 { "0".into() } else { format!("{error:.1e}") }
}
