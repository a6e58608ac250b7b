//! Project tasks: `cargo xtask --help`. A module a task; what they measure is in `eval`.

mod conformance;
mod determinism;
mod fetch;
mod stability;
mod web;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use eval::{bench, rd_curve, stress};

/// Tasks of this project.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", disable_help_subcommand = true)]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Rate-distortion curves of a scene, with a report
    RdCurve(rd_curve::Options),
    /// Fetch a scene of the paper
    Fetch(fetch::Args),
    /// Check this build: golden streams, threads, broken streams
    Conformance(conformance::Args),
    /// Compare streams over threads, builds and processors
    Determinism(determinism::Args),
    /// Pathological scenes against the bounds of docs/accuracy.md
    Stress(stress::Options),
    /// The rasterizer against its f64 oracle
    Stability(stability::Args),
    /// Time and peak memory of every stage
    Bench(bench::Options),
    /// Sizes of streams on the test scenes, beside other codecs
    BenchSize(rd_curve::SizeOptions),
    /// gpcc-lite beside TMC13's recorded figures
    BenchGpcc(bench::gpcc::Options),
    /// Strategies of voxelization at equal quality
    BenchVoxel(bench::voxel::Options),
    /// What the fine-tune restores of a voxelized model
    BenchFinetune(bench::finetune::Options),
    /// The gsvx command: seconds and memory by size of model
    BenchGsvx(bench::gsvx::Options),
    /// What is lost at each quality, and what bounds on errors cost
    BenchQuality(bench::quality::Options),
    /// What gsvx tune saves, beside streams without it
    BenchTune(bench::tune::Options),
    /// The decoder for browsers: npm package, viewer page, tests
    Web(web::Args),
}

fn main() -> ExitCode {
    let done = match Cli::parse().task {
        Task::RdCurve(args) => rd_curve::run(&args),
        Task::Fetch(args) => fetch::run(&args),
        Task::Conformance(args) => conformance::run(&args),
        Task::Determinism(args) => determinism::run(&args),
        Task::Stress(args) => stress::run(&args),
        Task::Stability(args) => stability::run(&args),
        Task::Bench(args) => bench::run(&args),
        Task::BenchSize(args) => rd_curve::size(&args),
        Task::BenchGpcc(args) => bench::gpcc::run(&args),
        Task::BenchVoxel(args) => bench::voxel::run(&args),
        Task::BenchFinetune(args) => bench::finetune::run(&args),
        Task::BenchGsvx(args) => bench::gsvx::run(&args),
        Task::BenchQuality(args) => bench::quality::run(&args),
        Task::BenchTune(args) => bench::tune::run(&args),
        Task::Web(args) => web::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", one_line(&error));
            ExitCode::FAILURE
        }
    }
}

/// The chain of causes, outermost first, on one line. Causes that their parent already quotes
/// are left out.
fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(|c| c.to_string().replace('\n', " ")) {
        if line.is_empty() {
            line = cause;
        } else if !line.contains(&cause) {
            line = format!("{line}: {cause}");
        }
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_help_fits_a_screen() {
        use clap::CommandFactory as _;
        let help = Cli::command().render_help().to_string();
        assert!(help.lines().count() <= 25, "{help}");
        assert!(help.lines().all(|l| l.chars().count() <= 80), "{help}");
    }

    #[test]
    fn a_cause_is_said_once() {
        let inner = anyhow::anyhow!("no such file");
        let error = inner.context("cannot list: no such file").context("scene x");
        assert_eq!(one_line(&error), "scene x: cannot list: no such file");
    }
}
