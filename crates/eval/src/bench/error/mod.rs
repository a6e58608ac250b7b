//! `cargo xtask bench-error`: seconds against error, of each stage against f64 and of whole commands in dB.

mod commands;
mod stages;

use std::path::PathBuf;

use anyhow::Result;

use crate::chart::{Axis, Chart, Series};
use crate::manifest;
use crate::page::{Page, Table, number};
use crate::study::Study;

/// Flags of `cargo xtask bench-error`.
#[derive(Clone, Debug, clap::Args)]
pub struct ErrorOptions {
    /// Scene
    #[arg(default_value = "fox")]
    scene: String,
    /// Where the page goes
    #[arg(long, default_value = "docs/results/error.md")]
    out: PathBuf,
}

/// Measures and writes the page.
///
/// # Errors
/// If the command is not there or fails, or the scene cannot be read.
pub fn run(options: &ErrorOptions) -> Result<()> {
    let study = Study::of(&options.scene)?;
    let stages = stages::families(&study)?;
    let commands = commands::families(&study)?;
    let mut page = Page::new(&options.out, "What does accuracy cost?");
    page.text(format!(
        "`cargo xtask bench-error {}`: {} Gaussians, {} held-out views. {}. Stages: within one process, the best of {} runs; \
         commands: whole processes. \"Buys\": beside the row before.",
        options.scene,
        study.test.model.len(),
        study.test.held_out.len(),
        manifest::machine(),
        stages::RUNS,
    ));
    let [seconds, error] = ["seconds", "relative error"].map(Axis::logarithmic);
    let title = format!("{}: stages, error over seconds", options.scene);
    page.chart("-stages", Chart::new(title, [seconds.clone(), error], series(&stages), None));
    let title = format!("{}: commands, dB over seconds", options.scene);
    let db = Axis::linear("PSNR against renders of the input, dB");
    let drawn = commands.iter().filter(|f| f.is_drawn);
    page.chart("-commands", Chart::new(title, [seconds, db], series(drawn), None));
    for family in stages.iter().chain(&commands) {
        page.text(format!("## {}", family.heading));
        page.text(&family.about);
        page.table(&family.table);
    }
    page.write()
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
    /// Seconds and error.
    points: Vec<(f64, f64)>,
    /// Whether the error is the one of the chart.
    is_drawn: bool,
}

impl Family {
    /// `columns` lie between the error and what a row buys.
    fn new(heading: &'static str, about: impl Into<String>, columns: &str) -> Self {
        let table = Table::new(format!("{heading} | seconds | {columns} | buys"));
        Self { heading, about: about.into(), table, points: Vec::new(), is_drawn: true }
    }

    /// A row whose error `cells` state.
    fn row(&mut self, what: &str, seconds: f64, error: f64, cells: &str, buys: &str) {
        let decimals = if seconds < 0.1 { 4 } else { 2 };
        self.table.told(format!("{what} | {} | {cells} | {buys}", number(seconds, decimals)));
        self.points.push((seconds, error));
    }
}

/// An error as a cell.
fn small(error: f64) -> String {
    if error == 0.0 { "0".into() } else { format!("{error:.1e}") }
}
