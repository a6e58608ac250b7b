//! Project tasks: `cargo xtask --help`. A module a task; what they measure is in `eval`.

mod commands;
mod conformance;
mod demo;
mod determinism;
mod fetch;
mod forged;
mod needs;
mod npm;
mod release;
mod train;
mod web;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use eval::{bench, rd_curve, stress};
use gs_model::chain;

/// Tasks of this project.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", disable_help_subcommand = true)]
#[command(help_template = "Usage: {usage}\n\n{subcommands}")]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Install what tests skip without: wasm, Vulkan, Chromium
    Setup,
    /// Rate-distortion curves of a scene, with a report
    RdCurve(rd_curve::CurveOptions),
    /// Fetch a scene of the paper
    Fetch(fetch::FetchArgs),
    /// Train a model from photos and COLMAP's points
    Train(train::TrainArgs),
    /// Check this build: golden streams, threads, broken streams
    Conformance(conformance::ConformanceArgs),
    /// Compare streams over threads, builds and processors
    Determinism(determinism::DeterminismArgs),
    /// Forged streams through every border: Rust, C, Python, npm
    Forged(forged::ForgedArgs),
    /// Pathological scenes against the bounds of docs/accuracy.md
    Stress(stress::StressOptions),
    /// Sizes of streams on the test scenes, beside other codecs
    BenchSize(bench::size::SizeOptions),
    /// gpcc-lite beside TMC13's recorded figures
    BenchGpcc(bench::gpcc::GpccOptions),
    /// Steps on a GPU beside the processor, by size of scene
    BenchGpu(bench::gpu::GpuOptions),
    /// The gsvx command: seconds and memory by size of model
    BenchGsvx(bench::gsvx::GsvxOptions),
    /// What is lost at each quality, and what bounds on errors cost
    BenchQuality(bench::quality::QualityOptions),
    /// Run time against error, of each stage and of commands
    BenchError(bench::error::ErrorOptions),
    /// Models of a million Gaussians: coded, tuned, time, memory
    BenchRealSize(bench::real_size::RealSizeOptions),
    /// Frames as a sequence, beside open formats of sequences
    BenchSequences(bench::sequences::SequenceBenchOptions),
    /// The paper's claims, measured
    Paper(bench::paper::PaperOptions),
    /// What gsvx tune saves, beside streams without it
    BenchTune(bench::tune::TuneBenchOptions),
    /// Write the model in a stream of the paper's codec
    PaperDecode(rd_curve::DecodeOptions),
    /// The decoder for browsers: npm package, viewer page, tests
    Web(web::WebArgs),
    /// A page for any web host: a scene, untuned and tuned
    Demo(demo::DemoArgs),
    /// Whether all packages could be published
    Release(release::ReleaseArgs),
}

fn main() -> ExitCode {
    let done = match Cli::parse().task {
        Task::Setup => needs::setup(),
        Task::RdCurve(args) => rd_curve::run(&args),
        Task::Fetch(args) => fetch::run(&args),
        Task::Train(args) => train::run(&args),
        Task::Conformance(args) => conformance::run(&args),
        Task::Determinism(args) => determinism::run(&args),
        Task::Forged(args) => forged::run(&args),
        Task::Stress(args) => stress::run(&args),
        Task::BenchSize(args) => bench::size::run(&args),
        Task::BenchGpcc(args) => bench::gpcc::run(&args),
        Task::BenchGpu(args) => bench::gpu::run(&args),
        Task::BenchGsvx(args) => bench::gsvx::run(&args),
        Task::BenchQuality(args) => bench::quality::run(&args),
        Task::BenchError(args) => bench::error::run(&args),
        Task::BenchRealSize(args) => bench::real_size::run(&args),
        Task::BenchSequences(args) => bench::sequences::run(&args),
        Task::Paper(args) => bench::paper::run(&args),
        Task::PaperDecode(args) => rd_curve::decode(&args),
        Task::BenchTune(args) => bench::tune::run(&args),
        Task::Web(args) => web::run(&args),
        Task::Demo(args) => demo::run(&args),
        Task::Release(args) => release::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", chain(error.as_ref()));
            ExitCode::FAILURE
        }
    }
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
}
