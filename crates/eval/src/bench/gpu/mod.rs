//! `cargo xtask bench-gpu`: the WGSL executor beside the one in Rust, by size of scene. All of it takes at most nine
//! minutes; what does not fit is left out, and the page says so.

mod steps;

use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use finetune::Adapter;

use crate::page::{Page, Table};
use crate::process::{self, GsvxCommand, Usage};
use crate::{manifest, scenes};
use steps::{Figures, Shot};

/// Flags of `cargo xtask bench-gpu`.
#[derive(Clone, Debug, clap::Args)]
pub struct GpuOptions {
    /// Millions of Gaussians
    #[arg(long, value_delimiter = ',', default_values_t = [0.1, 1.0, 3.0])]
    millions: Vec<f64>,
    /// Pixels of a side of the view
    #[arg(long, default_value_t = 1024)]
    side: u32,
    /// Scene of a whole tune
    #[arg(long, default_value = "fox")]
    scene: String,
    /// Seconds for everything
    #[arg(long, default_value_t = 540)]
    seconds: u64,
    /// Measure one size in this process and print it as JSON
    #[arg(long, hide = true)]
    gaussians: Option<usize>,
    /// Where the page goes
    #[arg(long, default_value = "docs/results/gpu.md")]
    out: PathBuf,
}

/// What is left of the time.
struct Clock {
    end: Instant,
}

impl Clock {
    fn left(&self) -> Duration {
        self.end.saturating_duration_since(Instant::now())
    }
}

/// The adapter that is measured, its name, and whether it is software.
fn adapter() -> Result<(Adapter, String, bool)> {
    if let Ok(name) = Adapter::Hardware.name() {
        return Ok((Adapter::Hardware, name, false));
    }
    let name = Adapter::Software.name().context("nothing to measure")?;
    Ok((Adapter::Software, name, true))
}

/// Measures and writes the page.
///
/// # Errors
/// If there is no adapter or the page cannot be written.
pub fn run(options: &GpuOptions) -> Result<()> {
    let (adapter, name, software) = adapter()?;
    let shot = |gaussians| Shot { gaussians, side: options.side };
    if let Some(gaussians) = options.gaussians {
        println!("{}", serde_json::to_string(&steps::measure(adapter, shot(gaussians))?)?);
        return Ok(());
    }
    let clock = Clock { end: Instant::now() + Duration::from_secs(options.seconds) };
    // The build of the command counts towards the time.
    let gsvx = if software { None } else { Some(GsvxCommand::find()?) };
    let mut page = Page::new(&options.out, "How fast is a step on a GPU?");
    page.text(format!(
        "`cargo xtask bench-gpu`: {name}, beside the processor ({}). Random scenes of SH degree 3, a view of \
         {side}x{side} pixels, mean squared error. \"Apart\": how far the loss of the first step, and Adam's first moments over the largest, differ; behind the slash, by how much on the processor if the depths, many of which are equal, move by a unit in the last place.",
        manifest::machine(),
        side = options.side,
    ));
    if software {
        let warning = "This adapter is software: the figures say nothing about GPUs.";
        eprintln!("WARNING: {name}: {warning}");
        page.text(format!("**{warning}**"));
    }
    page.table(&by_size(options, &clock, &shot));
    page.text(whole_tune(options, &clock, gsvx.as_ref()));
    page.write()
}

/// A row for each size, measured in a process of its own: memory, time and failures stay apart.
fn by_size(options: &GpuOptions, clock: &Clock, shot: &dyn Fn(usize) -> Shot) -> Table {
    let mut table = Table::new(
        "Gaussians | steps/s | steps/s, processor | loss apart | moments apart | device MB | gsplat, steps/s",
    );
    let side = options.side.to_string();
    for millions in &options.millions {
        let gaussians = (1e6 * millions) as usize;
        let n = gaussians.to_string();
        let words = ["bench-gpu", "--side", &side, "--gaussians", &n];
        let done = process::own_path()
            .and_then(|own| process::run(Command::new(own).args(words), clock.left()));
        let row = match done.and_then(|done| done.json::<Figures>()) {
            Ok(f) => format!(
                "{gaussians} | {:.2} | {:.2} | {:.0e} / {:.0e} | {:.0e} / {:.0e} | {:.0} | {}",
                f.steps_per_second,
                f.cpu_steps_per_second,
                f.loss_apart,
                f.by_order[0],
                f.moments_apart,
                f.by_order[1],
                f.device_mb,
                gsplat(shot(gaussians), clock),
            ),
            Err(e) => format!("{gaussians} | left out: {e:#} | - | - | - | - | -"),
        };
        table.told(row);
    }
    table
}

/// Steps per second of gsplat on the same scene, or a dash where it is not installed.
fn gsplat(shot: Shot, clock: &Clock) -> String {
    let installed = Command::new("python3").args(["-c", "import gsplat"]).output();
    if !installed.is_ok_and(|out| out.status.success()) {
        return "-".into();
    }
    let measured = || -> Result<f64> {
        let dir = tempfile::tempdir()?;
        steps::write_arrays(shot, dir.path())?;
        let script = include_str!("gsplat.py");
        let mut python = Command::new("python3");
        python.args(["-c", script]).arg(dir.path()).arg(shot.side.to_string());
        process::run(&mut python, clock.left())?.json()
    };
    measured().map_or_else(|e| format!("failed: {e:#}"), |rate| format!("{rate:.2}"))
}

/// The words on a whole tune of the scene, with and without the GPU.
fn whole_tune(options: &GpuOptions, clock: &Clock, gsvx: Option<&GsvxCommand>) -> String {
    let scene = &options.scene;
    let tuned = |backend: &str| -> Result<String> {
        let gsvx = gsvx.context("the command refuses a software adapter")?;
        let found = scenes::find(scene)?;
        let dir = tempfile::tempdir()?;
        let mut command = gsvx.words(["tune"]);
        command.arg(&found.dataset.model_path).arg("--cameras").arg(&found.dataset.dir);
        command.args(["--backend", backend, "-o"]).arg(dir.path().join("s.gsvx"));
        let Usage { wall, peak_mb, .. } = process::run(&mut command, clock.left())?.usage;
        Ok(format!("{wall:.0} s, {peak_mb:.0} MB of the host's memory"))
    };
    match tuned("gpu").and_then(|gpu| Ok((gpu, tuned("cpu")?))) {
        Ok((gpu, cpu)) => format!(
            "`gsvx tune` of {scene}, whole: with `--backend gpu` {gpu}; on the processor {cpu}."
        ),
        Err(e) => {
            eprintln!("SKIPPED: a whole tune of {scene}: {e:#}");
            format!("A whole tune of {scene} was left out: {e:#}.")
        }
    }
}
