//! `cargo xtask conformance`: checks that this build decodes the golden streams to the recorded
//! floats, encodes the same for any number of threads, agrees with its references, looks no worse at a greater
//! quality and refuses broken streams. One line per check.

mod damage;
#[path = "../../../crates/gsvx/tests/common/forge.rs"]
#[allow(dead_code, reason = "a part is used")]
mod forge;
mod golden;
mod page;
mod paper;
mod quality;
mod references;
mod threads;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use gs_model::chain;

use crate::needs::VULKAN;

/// Flags of `cargo xtask conformance`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct ConformanceArgs {
    /// Leave out the WGSL executor, whose tests are built first
    #[arg(long)]
    no_gpu: bool,
    /// Broken streams of each kind per golden stream
    #[arg(long, default_value_t = 400, value_parser = clap::value_parser!(u32).range(1..))]
    broken: u32,
    /// Write what became of the broken streams as a page [of the results: docs/results/safe.md]
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
}

/// The result of a check that did not fail.
enum Verdict {
    /// The check holds; with figures.
    Holds(String),
    /// The check could not run here; why.
    Skipped(String),
}

/// Outcomes so far.
#[derive(Default)]
struct Tally {
    held: usize,
    failed: Vec<String>,
    skipped: usize,
}

impl Tally {
    /// Makes one check and prints its line.
    fn check(&mut self, name: &str, work: impl FnOnce() -> Result<Verdict>) {
        let started = Instant::now();
        // A panic fails this check; the others go on.
        let outcome = catch_unwind(AssertUnwindSafe(work));
        let seconds = started.elapsed().as_secs_f64();
        match outcome {
            Ok(Ok(Verdict::Holds(says))) => {
                self.held += 1;
                println!("ok    {name}: {says} ({seconds:.1} s)");
            }
            Ok(Ok(Verdict::Skipped(why))) => {
                self.skipped += 1;
                println!("skip  {name}: {why}");
            }
            Ok(Err(why)) => {
                println!("FAIL  {name}: {}", chain(why.as_ref()));
                self.failed.push(name.to_owned());
            }
            Err(_) => {
                println!("FAIL  {name}: it panicked");
                self.failed.push(name.to_owned());
            }
        }
    }
}

/// Makes all checks.
pub(crate) fn run(args: &ConformanceArgs) -> Result<()> {
    if !args.no_gpu
        && let Err(lacking) = VULKAN.get()
    {
        eprintln!("SKIPPED: the WGSL executor: {lacking}");
    }
    let started = Instant::now();
    let mut tally = Tally::default();
    golden::checks(&mut tally);
    threads::checks(&mut tally);
    references::checks(&mut tally, args.no_gpu);
    paper::checks(&mut tally);
    quality::checks(&mut tally);
    let broken = damage::checks(&mut tally, args.broken);
    println!(
        "{} checks hold, {} fail, {} skipped, {:.1} s",
        tally.held,
        tally.failed.len(),
        tally.skipped,
        started.elapsed().as_secs_f64()
    );
    if tally.failed.is_empty() {
        return match &args.page {
            Some(out) => page::write(out, tally.held, &broken),
            None => Ok(()),
        };
    }
    bail!("not conforming: {}", tally.failed.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_and_panics_are_counted_and_do_not_end_the_run() {
        let mut tally = Tally::default();
        tally.check("a", || Ok(Verdict::Holds("yes".into())));
        tally.check("b", || bail!("no"));
        tally.check("c", || {
            // Any panic: an index out of range.
            let empty: Vec<u8> = Vec::new();
            Ok(Verdict::Holds(empty[empty.len()].to_string()))
        });
        tally.check("d", || Ok(Verdict::Skipped("not here".into())));
        assert_eq!((tally.held, tally.skipped), (1, 1));
        assert_eq!(tally.failed, ["b", "c"]);
    }
}
