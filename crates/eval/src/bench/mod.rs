//! Benches: every stage's time against its error and its peak memory, in one report; what the
//! pipeline skips; and, in the submodules, benches of single crates.

mod criterion;
pub mod finetune;
pub mod gpcc;
pub mod gsvx;
mod memory;
pub mod quality;
pub mod scale;
mod skips;
mod stages;
pub mod tune;
pub mod voxel;

pub use memory::child as memory_child;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result};
use testing::Rng;

use crate::chart::{Axis, Chart};
use crate::scenes;

/// What [`run`] measures.
#[derive(Clone, Debug)]
pub struct Options {
    /// Scene whose model is measured.
    pub scene: String,
    /// Repetitions; the fastest counts.
    pub repeat: usize,
    /// Write the times of this run as the baseline that later ones are compared with.
    pub bless: bool,
    /// Run `cargo bench` of every crate first, with short measurements (minutes).
    pub criterion: bool,
    /// How to start a process that calls [`memory_child`] with this scene, stage and scratch folder.
    pub child: fn(&str, &str, &Path) -> std::io::Result<Command>,
    /// Folder of the report and its plots, relative to the root of the workspace.
    pub out: PathBuf,
}

/// A part of the pipeline that is measured in several settings; they share a table and a plot.
#[derive(Clone, Copy, PartialEq)]
struct Stage {
    name: &'static str,
    /// What the error is.
    error: &'static str,
}

/// One measured setting of a stage.
struct Row {
    stage: Stage,
    setting: String,
    cost: Cost,
    error: f64,
    bytes: Option<usize>,
}

impl Stage {
    fn row(self, setting: &str, cost: Cost, error: f64, bytes: Option<usize>) -> Row {
        Row { stage: self, setting: setting.to_owned(), cost, error, bytes }
    }
}

/// What a piece of work took.
#[derive(Clone, Copy, Debug)]
struct Cost {
    time: Time,
    /// Peak resident memory of the process meanwhile, MB.
    peak_mb: f64,
}

/// Seconds of the fastest repetition.
#[derive(Clone, Copy, Debug)]
struct Time {
    wall: f64,
    /// Of all threads of the process.
    cpu: f64,
}

/// Runs `f` `repeat` times; returns its result, the least time and the peak memory.
fn timed<T>(repeat: usize, mut f: impl FnMut() -> Result<T>) -> Result<(T, Cost)> {
    crate::usage::reset_peak();
    let (mut best, mut result) = (Time { wall: f64::INFINITY, cpu: f64::INFINITY }, None);
    for _ in 0..repeat.max(1) {
        let (start, cpu) = (Instant::now(), crate::usage::cpu_seconds());
        result = Some(f()?);
        best.cpu = best.cpu.min(crate::usage::cpu_seconds() - cpu);
        best.wall = best.wall.min(start.elapsed().as_secs_f64());
    }
    let cost = Cost { time: best, peak_mb: crate::usage::peak_mb() };
    Ok((result.context("nothing ran")?, cost))
}

/// Seconds to sort four million pseudo-random integers on one core. Times are divided by it before
/// they are compared between runs, so that a slower machine is not taken for slower code.
fn yardstick() -> Time {
    let mut rng = Rng::seeded(1);
    let numbers: Vec<u64> = (0..4 << 20).map(|_| rng.bits()).collect();
    let mut best = Time { wall: f64::INFINITY, cpu: f64::INFINITY };
    for _ in 0..3 {
        let mut copy = numbers.clone();
        let (start, cpu) = (Instant::now(), crate::usage::cpu_seconds());
        copy.sort_unstable();
        std::hint::black_box(&copy);
        best.cpu = best.cpu.min(crate::usage::cpu_seconds() - cpu);
        best.wall = best.wall.min(start.elapsed().as_secs_f64());
    }
    best
}

/// Ratio to the baseline from which a time is called a regression. On a shared machine, smaller
/// ratios are noise.
const REGRESSION: f64 = 1.3;

/// Times over the yardstick, by name.
type Times = BTreeMap<String, f64>;

fn baseline() -> PathBuf {
    scenes::root().join("crates/eval/data/bench-baseline.json")
}

/// Measures, writes the report, prints regressions.
///
/// # Errors
/// If the scene cannot be read, a stage fails or the report cannot be written.
pub fn run(options: &Options) -> Result<()> {
    let scene = scenes::find(&options.scene)?;
    let targets = criterion::targets(&scenes::root());
    if options.criterion {
        criterion::run(&scenes::root(), &targets)?;
    }
    let before = yardstick();
    let rows = stages::measure(&scene, options.repeat)?;
    let after = yardstick();
    let yard = Time { cpu: before.cpu.min(after.cpu), wall: before.wall.min(after.wall) };
    let peaks = memory::measure(&options.scene, options.child)?;
    let micro = criterion::estimates(&criterion::folder(&scenes::root()));
    let times = times(&scene.name, &rows, &micro, yard);
    let old: Times = match std::fs::read(baseline()) {
        Ok(bytes) => serde_json::from_slice(&bytes).context("bench-baseline.json")?,
        Err(_) => Times::new(),
    };
    print_regressions(&times, &old);

    let out = scenes::root().join(&options.out);
    let plots = out.join("bench");
    std::fs::create_dir_all(&plots)?;
    let mut text = introduction(options, &scene.what, yard);
    for of in rows.chunk_by(|a, b| a.stage == b.stage) {
        let stage = of[0].stage.name;
        text += &stage_section(&scene.name, of, yard, &old);
        if of.len() > 1 {
            let file = format!("{}.svg", stage.replace(|c: char| !c.is_alphanumeric(), "-"));
            std::fs::write(plots.join(&file), chart(stage, of).svg())?;
            let _ = write!(text, "\n![{stage}](bench/{file})\n");
        }
    }
    text += &memory_section(&peaks, scene.raw_mb()?);
    text += &criterion_section(&micro, &targets, &old, yard.wall);
    crate::page::write(&options.out.join("bench.md"), &text, None)?;
    if options.bless {
        std::fs::write(baseline(), serde_json::to_string_pretty(&times)? + "\n")?;
        println!("blessed: {}", baseline().display());
    }
    Ok(())
}

/// All times in yardsticks. Stages are compared by processor time, criterion's benchmarks by the
/// wall-clock time that it measures.
fn times(scene: &str, rows: &[Row], micro: &[criterion::Micro], yard: Time) -> Times {
    let stages = rows.iter().map(|r| (key(scene, r), r.cost.time.cpu / yard.cpu));
    let micro = micro.iter().map(|m| (format!("criterion: {}", m.name), m.seconds / yard.wall));
    stages.chain(micro).collect()
}

/// Name of a row in the baseline.
fn key(scene: &str, row: &Row) -> String {
    format!("{scene}: {}: {}", row.stage.name, row.setting)
}

fn print_regressions(times: &Times, old: &Times) {
    let mut slower = 0;
    for (name, time) in times {
        match old.get(name) {
            Some(was) => {
                let worse = time / was > REGRESSION;
                slower += usize::from(worse);
                println!("{:6.2}x {name}{}", time / was, if worse { "  REGRESSION" } else { "" });
            }
            None => println!("   new  {name}"),
        }
    }
    println!("{slower} of {} take {REGRESSION} times the baseline or more", times.len());
}

fn introduction(options: &Options, what: &str, yard: Time) -> String {
    format!(
        "# Time against error\n\n\
         `cargo xtask bench {}`: {}, {} threads, {}. Repetitions: {}, the least counts. Processor time \
         is also given in yardsticks, what sorting 2^22 integers on one core takes in the same run \
         ({:.0} ms): yardsticks are compared with the committed baseline, `--bless` replaces it. \
         A star marks the Pareto front: nothing else in the table is as fast, as near and as small, \
         and better in one. \
         Peak is the resident memory of the process while the stage ran, its inputs included.\n",
        options.scene,
        what,
        rayon::current_num_threads(),
        crate::manifest::processor(),
        options.repeat,
        1e3 * yard.cpu,
    )
}

/// The table of one stage.
fn stage_section(scene: &str, of: &[Row], yard: Time, old: &Times) -> String {
    let mut text = format!(
        "\n## {}\n\nError: {}.\n\n\
         | setting | ms | CPU ms | yardsticks | to baseline | error | bytes | peak MB | front |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|---|\n",
        of[0].stage.name, of[0].stage.error
    );
    for r in of {
        let beaten = of.iter().any(|o| {
            let (no_worse, better) = (
                o.cost.time.wall <= r.cost.time.wall && o.error <= r.error && o.bytes <= r.bytes,
                o.cost.time.wall < r.cost.time.wall || o.error < r.error || o.bytes < r.bytes,
            );
            no_worse && better
        });
        let yards = r.cost.time.cpu / yard.cpu;
        let was = old.get(&key(scene, r));
        let ratio = was.map_or("new".into(), |w| format!("{:.2}", yards / w));
        let bytes = r.bytes.map_or("-".into(), |b| b.to_string());
        let _ = writeln!(
            text,
            "| {} | {:.2} | {:.2} | {yards:.3} | {ratio} | {:.4e} | {bytes} | {:.0} | {} |",
            r.setting,
            1e3 * r.cost.time.wall,
            1e3 * r.cost.time.cpu,
            r.error,
            r.cost.peak_mb,
            if beaten { "" } else { "*" }
        );
    }
    text
}

/// Time against error of the settings of a stage. An error of zero lies on the lower edge, at a
/// quarter of the least other error.
fn chart(title: &str, rows: &[Row]) -> Chart {
    let positive = rows.iter().map(|r| r.error).filter(|&e| e > 0.0).fold(f64::INFINITY, f64::min);
    let floor = if positive.is_finite() { positive / 4.0 } else { 1e-3 };
    let point =
        |r: &Row| (r.setting.clone(), (1e3 * r.cost.time.wall.max(1e-9), r.error.max(floor)));
    let (x, y) = ("time, ms", "error (on the lower edge: none)");
    Chart::of_points(title, Axis::logarithmic(x), Axis::logarithmic(y), rows.iter().map(point))
}

fn memory_section(peaks: &[memory::Peak], raw: f64) -> String {
    let mut text = format!(
        "\n## Peak memory\n\nEach stage in a process of its own; the raw floats of the model are \
         {raw:.0} MB. Inputs: what is resident when the stage starts, the program included.\n\n\
         | stage | inputs MB | peak MB | over the inputs MB | over the inputs / raw floats |\n\
         |---|---:|---:|---:|---:|\n"
    );
    for p in peaks {
        let over = (p.peak - p.before).max(0.0);
        let _ = writeln!(
            text,
            "| {} | {:.0} | {:.0} | {over:.0} | {:.2} |",
            p.stage,
            p.before,
            p.peak,
            over / raw
        );
    }
    text
}

fn criterion_section(
    micro: &[criterion::Micro],
    targets: &[criterion::Target],
    old: &Times,
    yard: f64,
) -> String {
    let mut text = String::from(
        "\n## Criterion\n\nMedians of `cargo bench`, as found in target/criterion; `--criterion` \
         runs them first.\n\n",
    );
    for target in targets {
        let missing = criterion::missing(target, micro);
        if !missing.is_empty() {
            let _ =
                writeln!(text, "Missing: {}: run `{}`.\n", missing.join("; "), target.command());
        }
    }
    text += "| crate | benchmark | ms | yardsticks | to baseline |\n|---|---|---:|---:|---:|\n";
    for m in micro {
        let of = targets.iter().find(|t| t.groups.contains(&m.group));
        let package = of.map_or("-", |t| t.package.as_str());
        let was = old.get(&format!("criterion: {}", m.name));
        let ratio = was.map_or("new".into(), |w| format!("{:.2}", m.seconds / yard / w));
        let _ = writeln!(
            text,
            "| {package} | {} | {:.3} | {:.4} | {ratio} |",
            m.name,
            1e3 * m.seconds,
            m.seconds / yard
        );
    }
    text
}

/// Counts on each scene what the pipeline skips, and writes the table to `out`, relative to the
/// root of the workspace.
///
/// # Errors
/// If a scene cannot be read, or a test that proves a skip harmless is gone.
pub fn skips(scenes: &[String], out: &Path) -> Result<()> {
    let text = skips::report(scenes)?;
    crate::page::write(out, &text, None)
}
