//! Pathological scenes through the whole chain in every mode, with the errors against the bounds of
//! docs/accuracy.md.

mod chain;
mod inputs;
mod levels;
mod outcome;
mod page;
mod paper_codec;
mod precision;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};

use chain::MODES;
use inputs::{INPUTS, Input};
use outcome::ChainOutcome;

/// Flags of `cargo xtask stress`.
#[derive(Clone, Debug, clap::Args)]
pub struct StressOptions {
    /// Gaussians of inputs that do not fix their number.
    #[arg(long, default_value_t = 3000)]
    size: usize,
    /// Terms of the greatest sums: Gaussians of a voxel, leaves of a transform. 1e7 take 3 GB.
    #[arg(long, default_value_t = 10_000_000)]
    many: usize,
    /// Where the page goes.
    #[arg(long, default_value = "docs/results/stress.md")]
    out: PathBuf,
}

/// One input in one mode.
struct Run {
    input: &'static str,
    mode: &'static str,
    outcome: ChainOutcome,
}

impl Run {
    /// The part that refused the input.
    fn refused(&self) -> Option<&str> {
        self.outcome.as_ref().err().and_then(|message| message.split(':').next())
    }

    /// The worst error over its bound of each attribute.
    fn worst(&self) -> &[(&'static str, f64)] {
        self.outcome.as_deref().unwrap_or_default()
    }
}

/// Runs an input in a mode; the promise that is broken is the error.
fn checked(input: &Input, mode: &'static str, size: usize) -> Result<Run, String> {
    let outcome = catch_unwind(AssertUnwindSafe(|| chain::run(&input.scene(size), mode)));
    let broken = |why: String| format!("{}, {mode}: {why}", input.name);
    let outcome = outcome.map_err(|_| broken("a panic".into()))?;
    let outcome = outcome.map_err(|why| broken(format!("{why:#}")))?;
    let run = Run { input: input.name, mode, outcome };
    // A ratio of NaN is a failure too.
    match run.worst().iter().find(|w| w.1.is_nan() || w.1 > 1.0) {
        Some((what, ratio)) => Err(broken(format!("{what} {ratio}"))),
        None => Ok(run),
    }
}

/// Every input in every mode.
fn all(size: usize) -> impl Iterator<Item = Result<Run, String>> {
    INPUTS
        .iter()
        .flat_map(move |input| MODES.into_iter().map(move |mode| checked(input, mode, size)))
}

/// Runs every input in every mode and writes the page.
///
/// # Errors
/// If a run fails or breaks a bound.
pub fn run(args: &StressOptions) -> Result<()> {
    let started = Instant::now();
    let (mut runs, mut failures) = (Vec::new(), 0);
    for result in all(args.size) {
        match result {
            Ok(run) => runs.push(run),
            Err(why) => {
                eprintln!("FAILED: {why}");
                failures += 1;
            }
        }
    }
    let figures = precision::all(args.many);
    for figure in figures.iter().filter(|f| !f.holds()) {
        eprintln!("FAILED: {}", figure.failure());
        failures += 1;
    }
    if failures > 0 {
        bail!("{failures} of the runs broke a promise");
    }
    page::page(args, &runs, &figures, started.elapsed()).write()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every input in every mode, small: errors within their bounds, refusals typed, no panic.
    #[test]
    fn every_input_in_every_mode() {
        let size = if cfg!(debug_assertions) { 120 } else { 400 };
        let failures: Vec<String> = all(size).filter_map(Result::err).collect();
        assert!(failures.is_empty(), "{failures:#?}");
    }

    /// Single precision is within its bounds where it gives way.
    #[test]
    fn every_stage_is_as_near_to_double_precision_as_stated() {
        let figures = precision::all(100_000);
        let failures: Vec<String> =
            figures.iter().filter(|f| !f.holds()).map(precision::Figure::failure).collect();
        assert!(failures.is_empty(), "{failures:#?}");
    }

    /// Invalid scenes are refused. Valid ones are accepted, except one of SH coefficients beyond the limit.
    #[test]
    fn only_what_is_invalid_or_too_large_is_refused() {
        let refused: Vec<&str> = INPUTS
            .iter()
            .filter(|i| checked(i, "default", 100).unwrap().refused().is_some())
            .map(|i| i.name)
            .collect();
        let invalid = [
            "one NaN mean",
            "one infinite mean",
            "one NaN opacity",
            "one infinite scale",
            "one NaN SH coefficient",
            "a zero quaternion",
            "a quaternion of -0",
            // Valid, but beyond what lossy coding takes (docs/accuracy.md).
            "SH coefficients +-3e38",
        ];
        assert_eq!(refused, invalid);
    }
}
