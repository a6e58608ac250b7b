//! Pathological scenes through the whole chain in every mode, each in a process of its own. Errors
//! are checked against the bounds of docs/accuracy.md.

mod chain;
mod gaussians;
mod inputs;
mod levels;
mod page;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use crate::page::Page;
use crate::process;
use chain::{ChainOutcome, MODES};
use inputs::{HUGE, INPUTS, Input};

/// Flags of `cargo xtask stress`.
#[derive(Clone, Debug, clap::Args)]
pub struct StressOptions {
    /// Only this input.
    #[arg(long)]
    input: Option<String>,
    /// Only this mode.
    #[arg(long, allow_hyphen_values = true)]
    mode: Option<String>,
    /// Gaussians of inputs that do not fix their number.
    #[arg(long, default_value_t = 3000)]
    size: usize,
    /// Also the input of ten million Gaussians: minutes per mode, several GB.
    #[arg(long)]
    all: bool,
    /// Seconds after which a run counts as hanging.
    #[arg(long, default_value_t = 1800)]
    timeout: u64,
    /// Run one input in one mode in this process, and print the outcome as JSON.
    #[arg(long, hide = true, requires = "input", requires = "mode")]
    child: bool,
    /// Where the page goes.
    #[arg(long, default_value = "docs/results/stress.md")]
    out: PathBuf,
}

/// Gaussians of the huge input.
const TEN_MILLION: usize = 10_000_000;

/// The table of all runs, relative to the root of the workspace.
const DETAILS: &str = "target/stress.md";

/// One input in one mode.
struct Run {
    input: &'static str,
    mode: &'static str,
    /// What came out, or why the run failed.
    outcome: Result<ChainOutcome, String>,
}

impl Run {
    /// The part that refused the input.
    fn refused(&self) -> Option<&str> {
        let message = self.outcome.as_ref().ok()?.refused.as_deref()?;
        Some(message.split(':').next().unwrap_or(message))
    }

    /// The worst error over its bound of each attribute.
    fn worst(&self) -> Vec<(String, f64)> {
        let mut worst: Vec<(String, f64)> = Vec::new();
        for (name, ratio) in self.outcome.iter().flat_map(|o| &o.worst) {
            match worst.iter_mut().find(|w| w.0 == *name) {
                Some(w) => w.1 = w.1.max(*ratio),
                None => worst.push((name.clone(), *ratio)),
            }
        }
        worst
    }

    /// The promise that the run broke.
    fn failure(&self) -> Option<String> {
        let broken = match &self.outcome {
            Err(why) => why.clone(),
            Ok(o) if o.worst.iter().any(|w| w.1 > 1.0 || w.1.is_nan()) => format!("{:?}", o.worst),
            Ok(_) => return None,
        };
        Some(format!("{}, {}: {broken}", self.input, self.mode))
    }
}

fn size_of(input: &Input, args: &StressOptions) -> usize {
    if input.name == HUGE { TEN_MILLION } else { args.size }
}

/// Runs every input in every mode, or what was asked for, and writes the page or prints the table.
///
/// # Errors
/// If a run fails, hangs or breaks a bound.
pub fn run(args: &StressOptions) -> Result<()> {
    if let (true, Some(input), Some(mode)) = (args.child, &args.input, &args.mode) {
        return child(input, mode, args.size);
    }
    let wanted = |given: &Option<String>, name: &str| given.as_ref().is_none_or(|g| g == name);
    let inputs: Vec<&Input> = INPUTS
        .iter()
        .filter(|i| wanted(&args.input, i.name))
        .filter(|i| i.name != HUGE || args.all || args.input.is_some())
        .collect();
    let modes: Vec<&str> = MODES.into_iter().filter(|m| wanted(&args.mode, m)).collect();
    if inputs.is_empty() || modes.is_empty() {
        let names: Vec<_> = INPUTS.iter().map(|i| i.name).collect();
        bail!("no such input or mode; inputs: {}; modes: {}", names.join(", "), MODES.join(", "));
    }
    let started = Instant::now();
    let mut runs = Vec::new();
    for input in &inputs {
        for &mode in &modes {
            let outcome = apart(input, mode, args);
            let outcome = outcome.map_err(|e| format!("{e:#}").replace(['\n', '|'], " "));
            runs.push(Run { input: input.name, mode, outcome });
            eprint!("\r{} runs ", runs.len());
        }
    }
    eprintln!();
    let table = page::table(&runs);
    if args.input.is_none() && args.mode.is_none() {
        let mut details = Page::new(DETAILS.as_ref(), "All runs");
        details.table(&table);
        details.write()?;
        page::page(args, &runs, started.elapsed(), DETAILS).write()?;
    } else {
        print!("{}", table.plain());
    }
    let failures: Vec<String> = runs.iter().filter_map(Run::failure).collect();
    match failures.first() {
        None => Ok(()),
        Some(first) => bail!("{} of the runs broke a promise; the first: {first}", failures.len()),
    }
}

/// Runs one input in one mode in this process and prints the outcome as JSON.
fn child(input: &str, mode: &str, size: usize) -> Result<()> {
    let input = INPUTS.iter().find(|i| i.name == input).context("no such input")?;
    println!("{}", serde_json::to_string(&chain::run(&input.scene(size), mode)?)?);
    Ok(())
}

/// Runs one input in one mode in a process of its own.
fn apart(input: &Input, mode: &str, args: &StressOptions) -> Result<ChainOutcome> {
    let (size, mode) = (size_of(input, args).to_string(), format!("--mode={mode}"));
    let words = ["stress", "--child", "--size", &size, "--input", input.name, &mode];
    let done = process::run(&mut process::own(&words)?, Duration::from_secs(args.timeout))?;
    Ok(ChainOutcome { seconds: done.wall, peak_mb: done.peak_mb, ..done.json()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every input in every mode, small: errors within their bounds, refusals typed, no panic.
    #[test]
    fn every_input_in_every_mode() {
        for input in INPUTS {
            let scene = input.scene(if cfg!(debug_assertions) { 120 } else { 400 });
            for mode in MODES {
                let outcome = chain::run(&scene, mode)
                    .unwrap_or_else(|e| panic!("{}, {mode}: {e:#}", input.name));
                for (attribute, ratio) in &outcome.worst {
                    assert!(*ratio <= 1.0, "{}, {mode}: {attribute} {ratio}", input.name);
                }
            }
        }
    }

    /// Invalid scenes are refused. Valid ones are accepted, except one of SH coefficients beyond the limit.
    #[test]
    fn only_what_is_invalid_or_too_large_is_refused() {
        let refused: Vec<&str> = INPUTS
            .iter()
            .filter(|i| chain::run(&i.scene(100), "default").unwrap().refused.is_some())
            .map(|i| i.name)
            .collect();
        let invalid = [
            "one NaN mean",
            "one infinite mean",
            "one NaN opacity",
            "one infinite scale",
            "scale of zero (-inf)",
            "one NaN SH coefficient",
            "a zero quaternion",
            "a quaternion of -0",
            // Valid, but beyond what lossy coding takes (docs/accuracy.md).
            "SH coefficients +-3e38",
        ];
        assert_eq!(refused, invalid);
    }
}
