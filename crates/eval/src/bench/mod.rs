//! Benches: time and memory of every stage, and the measurements behind pages of docs/results.

pub mod gpcc;
pub mod gpu;
pub mod gsvx;
mod gsvx_flags;
mod importance;
pub mod quality;
pub mod real_size;
mod scale;
mod speed;
mod stages;
mod sweep;
pub mod tune;
pub mod voxel;

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context, Result};

use crate::cells;
use crate::page::{Page, Table};
use crate::{manifest, process, scenes};
use stages::{Cost, STAGES, STREAMS};

pub use sweep::{ALLOWED_DB, Drop, Sweep, all_qualities};

/// Flags of `cargo xtask bench`.
#[derive(Clone, Debug, clap::Args)]
pub struct BenchOptions {
    /// Scene whose model is measured.
    #[arg(default_value = "fox")]
    scene: String,
    /// Repetitions; the fastest counts.
    #[arg(long, default_value_t = 3)]
    repeat: usize,
    /// Run one stage in this process and print its cost as JSON.
    #[arg(long, hide = true, requires = "scratch")]
    stage: Option<String>,
    /// Folder for what stages pass on.
    #[arg(long, hide = true)]
    scratch: Option<PathBuf>,
    /// Where the page goes; the figures lie beside it, and the next run compares with them.
    #[arg(long, default_value = "target/bench/bench.md")]
    out: PathBuf,
}

/// Measures every stage in a process of its own, so that memory which an earlier one left behind does not count,
/// and writes the page.
///
/// # Errors
/// If the scene cannot be read, a stage fails or the page cannot be written.
pub fn run(options: &BenchOptions) -> Result<()> {
    let found = scenes::find(&options.scene)?;
    if let (Some(stage), Some(scratch)) = (&options.stage, &options.scratch) {
        return stages::child(&found, stage, scratch, options.repeat);
    }
    let dir = tempfile::tempdir().context("make a temporary folder")?;
    let repeat = options.repeat.to_string();
    let measure = |stage: &str| {
        let words = ["bench", &options.scene, "--repeat", &repeat, "--stage", stage, "--scratch"];
        let done = process::run(process::own(&words)?.arg(dir.path()), process::NO_LIMIT);
        done.with_context(|| format!("stage {stage}"))
    };
    // By another process, so that nothing of making the streams is in memory when they are decoded.
    measure(STREAMS)?;
    let record = scenes::root().join(&options.out).with_extension("json");
    let before: BTreeMap<String, Cost> = std::fs::read(&record)
        .ok()
        .and_then(|b| serde_json::from_slice(&b).ok())
        .unwrap_or_default();
    let raw = found.raw_mb()?;
    let mut table = Table::new(
        "stage | ms | CPU ms | CPU, to the run before | inputs MB | peak MB | over the inputs / raw floats",
    );
    let mut costs = before.clone();
    for stage in STAGES {
        let cost: Cost = measure(stage)?.json()?;
        let key = format!("{}: {stage}", found.name);
        let ratio = before.get(&key).map(|b| cost.cpu / b.cpu.max(1e-6));
        table.told(cells![
            stage,
            format!("{:.2}", 1e3 * cost.wall),
            format!("{:.2}", 1e3 * cost.cpu),
            ratio.map_or("-".into(), |r| format!("{r:.2}")),
            format!("{:.0}", cost.before),
            format!("{:.0}", cost.peak),
            format!("{:.2}", (cost.peak - cost.before).max(0.0) / raw),
        ]);
        costs.insert(key, cost);
    }
    let mut page = Page::new(&options.out, "What does each stage cost?");
    page.text(format!(
        "`cargo xtask bench {}`: {}, {}. Repetitions: {}, the least time counts. Each stage in a process of its own; \
         the raw floats of the model are {raw:.0} MB. Inputs: what is resident when the stage starts, the program \
         included.",
        options.scene,
        found.what,
        manifest::machine(),
        options.repeat
    ));
    page.table(&table);
    page.write()?;
    std::fs::write(&record, serde_json::to_vec_pretty(&costs)?).context("write the figures")
}
