//! `cargo xtask bench`: every stage's time against its error, peak memory and what is skipped, in
//! one report.

mod chart;
mod criterion;
mod skips;
mod stages;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result};

use crate::scenes;

/// Arguments of `bench`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// Scene whose model is measured.
    #[arg(default_value = "fox")]
    scene: String,
    /// Repetitions; the fastest counts.
    #[arg(long, default_value_t = 3)]
    repeat: usize,
    /// Write the times of this run as the baseline that later ones are compared with.
    #[arg(long)]
    bless: bool,
    /// Folder of the report and its plots.
    #[arg(long, default_value = "docs/results")]
    out: PathBuf,
}

/// Arguments of `skips`.
#[derive(clap::Args, Debug)]
pub(crate) struct SkipsArgs {
    /// Scenes to count on.
    #[arg(default_values_t = ["room", "fox", "bonsai"].map(String::from))]
    scenes: Vec<String>,
    /// Where the table goes.
    #[arg(long, default_value = "docs/results/skips.md")]
    out: PathBuf,
}

/// One measured setting of a stage.
pub(crate) struct Row {
    /// Stages of one name share a plot.
    pub(crate) stage: &'static str,
    pub(crate) setting: String,
    pub(crate) seconds: f64,
    /// The error, and what it is.
    pub(crate) error: f64,
    pub(crate) of: &'static str,
    pub(crate) bytes: Option<usize>,
    /// Peak resident memory of the process while the stage ran, MB.
    pub(crate) peak_mb: f64,
}

/// Runs `f` `repeat` times; returns its result, the fastest time and the peak memory.
pub(crate) fn timed<T>(repeat: usize, mut f: impl FnMut() -> Result<T>) -> Result<(T, f64, f64)> {
    crate::peak::reset();
    let (mut best, mut result) = (f64::INFINITY, None);
    for _ in 0..repeat.max(1) {
        let start = Instant::now();
        result = Some(f()?);
        best = best.min(start.elapsed().as_secs_f64());
    }
    Ok((result.context("nothing ran")?, best, crate::peak::own_mb()))
}

/// Seconds to sort four million pseudo-random integers on one core: what times are divided by
/// before they are compared between runs.
fn yardstick() -> f64 {
    let mut seed = 1u64;
    let numbers: Vec<u64> = (0..4 << 20)
        .map(|_| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            seed
        })
        .collect();
    let best = (0..3).map(|_| {
        let mut copy = numbers.clone();
        let start = Instant::now();
        copy.sort_unstable();
        std::hint::black_box(&copy);
        start.elapsed().as_secs_f64()
    });
    best.fold(f64::INFINITY, f64::min)
}

/// Times over the yardstick, by name.
type Times = BTreeMap<String, f64>;

fn baseline() -> PathBuf {
    scenes::root().join("xtask/data/bench-baseline.json")
}

/// Measures, writes the report, prints regressions.
pub(crate) fn run(args: &Args) -> Result<()> {
    let found = scenes::find(&args.scene)?;
    let before = yardstick();
    let rows = stages::measure(&found, args.repeat)?;
    let yard = before.min(yardstick());
    let micro = criterion::estimates(&scenes::root().join("target/criterion"));
    let mut times: Times = Times::new();
    for r in &rows {
        times.insert(format!("{}: {}: {}", found.name, r.stage, r.setting), r.seconds / yard);
    }
    for (name, seconds) in &micro {
        times.insert(format!("criterion: {name}"), seconds / yard);
    }
    let old: Times = match std::fs::read(baseline()) {
        Ok(bytes) => serde_json::from_slice(&bytes).context("xtask/data/bench-baseline.json")?,
        Err(_) => Times::new(),
    };
    for (name, time) in &times {
        match old.get(name) {
            Some(was) => println!("{:6.2}x {name}", time / was),
            None => println!("   new  {name}"),
        }
    }
    let out = scenes::root().join(&args.out);
    let plots = out.join("bench");
    std::fs::create_dir_all(&plots)?;
    let mut stages: Vec<&'static str> = rows.iter().map(|r| r.stage).collect();
    stages.dedup();
    let mut text = format!(
        "# Time against error\n\n\
         `cargo xtask bench {}`: {}, {} threads, {}. Repetitions: {}, the fastest counts. Times are also \
         given in yardsticks, the time to sort 2^22 integers on one core in the same run \
         ({:.0} ms): yardsticks are compared with the committed baseline, `--bless` replaces it. \
         A star marks the Pareto front: nothing else in the table is as fast, as near and as small, \
         and better in one. \
         Peak is the resident memory of the process while the stage ran, its inputs included.\n",
        args.scene,
        found.what,
        rayon::current_num_threads(),
        crate::manifest::processor(),
        args.repeat,
        1e3 * yard,
    );
    for stage in stages {
        let of: Vec<&Row> = rows.iter().filter(|r| r.stage == stage).collect();
        let _ = write!(
            text,
            "\n## {stage}\n\nError: {}.\n\n\
             | setting | ms | yardsticks | to baseline | error | bytes | peak MB | front |\n\
             |---|---:|---:|---:|---:|---:|---:|---|\n",
            of[0].of
        );
        for r in &of {
            let beaten = of.iter().any(|o| {
                let (no_worse, better) = (
                    o.seconds <= r.seconds && o.error <= r.error && o.bytes <= r.bytes,
                    o.seconds < r.seconds || o.error < r.error || o.bytes < r.bytes,
                );
                no_worse && better
            });
            let was = old.get(&format!("{}: {}: {}", found.name, r.stage, r.setting));
            let ratio = was.map_or("new".into(), |w| format!("{:.2}", r.seconds / yard / w));
            let bytes = r.bytes.map_or("-".into(), |b| b.to_string());
            let _ = writeln!(
                text,
                "| {} | {:.2} | {:.3} | {ratio} | {:.4e} | {bytes} | {:.0} | {} |",
                r.setting,
                1e3 * r.seconds,
                r.seconds / yard,
                r.error,
                r.peak_mb,
                if beaten { "" } else { "*" }
            );
        }
        if of.len() > 1 {
            let file = format!("{}.svg", stage.replace(|c: char| !c.is_alphanumeric(), "-"));
            std::fs::write(plots.join(&file), chart::svg(stage, &of)?)?;
            let _ = write!(text, "\n![{stage}](bench/{file})\n");
        }
    }
    if micro.is_empty() {
        text +=
            "\nNo criterion estimates in target/criterion: run `cargo bench` first to add them.\n";
    } else {
        text += "\n## Criterion\n\n| benchmark | ms | yardsticks | to baseline |\n|---|---:|---:|---:|\n";
        for (name, seconds) in &micro {
            let was = old.get(&format!("criterion: {name}"));
            let ratio = was.map_or("new".into(), |w| format!("{:.2}", seconds / yard / w));
            let _ = writeln!(
                text,
                "| {name} | {:.3} | {:.4} | {ratio} |",
                1e3 * seconds,
                seconds / yard
            );
        }
    }
    let report = out.join("bench.md");
    std::fs::write(&report, text).with_context(|| format!("write {}", report.display()))?;
    println!("written: {}", report.display());
    if args.bless {
        std::fs::write(baseline(), serde_json::to_string_pretty(&times)? + "\n")?;
        println!("blessed: {}", baseline().display());
    }
    Ok(())
}

/// Counts what is skipped, and writes the table.
pub(crate) fn run_skips(args: &SkipsArgs) -> Result<()> {
    let text = skips::report(&args.scenes)?;
    let out = scenes::root().join(&args.out);
    std::fs::write(&out, text).with_context(|| format!("write {}", out.display()))?;
    println!("written: {}", out.display());
    Ok(())
}
