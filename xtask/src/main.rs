//! Project tasks: `cargo xtask --help`.
#![allow(
    clippy::disallowed_methods,
    reason = "reports and pictures, never the bitstream; fixtures use libm"
)]

mod bd;
mod bench;
mod bench_finetune;
mod bench_gpcc;
mod bench_gsvx;
mod bench_voxel;
mod cache;
mod chart;
mod conformance;
mod determinism;
mod experiments;
mod fetch;
mod fixture;
mod manifest;
mod measure;
mod peers;
mod pictures;
mod progress;
mod published;
mod rd_curve;
mod report;
mod scenes;
mod stress;
mod usage;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Project tasks: rate-distortion curves, fixtures, benches.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Rate-distortion curves of a scene: voxelize, encode, decode, render, compare, report
    RdCurve(rd_curve::RdArgs),
    /// Time against error of every stage, peak memory, regressions: one report
    Bench(bench::Args),
    /// What the pipeline skips on real scenes, with the proof that nothing is lost
    Skips(bench::SkipsArgs),
    /// Measure gpcc-lite beside the peer's recorded figures
    BenchGpcc(bench_gpcc::BenchArgs),
    /// Measure the voxelization strategies: speed, eq. 5, merging, curves at equal bytes
    BenchVoxel(bench_voxel::BenchArgs),
    /// How much of a voxelized model's quality the fine-tune brings back
    BenchFinetune(bench_finetune::FinetuneArgs),
    /// The `gsvx` command on models of growing size: seconds and peak memory
    BenchGsvx(bench_gsvx::Args),
    /// Check this build: golden streams, threads, twins, broken streams
    Conformance(conformance::Args),
    /// Coded bytes and decoded floats for any threads, build and processor: hashes compared
    Determinism(determinism::Args),
    /// Pathological scenes through the whole chain in every mode: errors against their bounds
    Stress(stress::Args),
    /// Fetch a scene of the paper out of the public archives
    Fetch(fetch::Args),
    /// Make the default scene, fixtures/room, from its seed
    Fixture(fixture::FixtureArgs),
}

fn main() -> ExitCode {
    let done = match Cli::parse().task {
        Task::RdCurve(args) => rd_curve::run(&args),
        Task::Bench(args) => bench::run(&args),
        Task::Skips(args) => bench::run_skips(&args),
        Task::BenchGpcc(args) => bench_gpcc::run(&args),
        Task::BenchVoxel(args) => bench_voxel::run(&args),
        Task::BenchFinetune(args) => bench_finetune::run(&args),
        Task::BenchGsvx(args) => bench_gsvx::run(&args),
        Task::Conformance(args) => conformance::run(&args),
        Task::Determinism(args) => determinism::run(&args),
        Task::Stress(args) => stress::run(&args),
        Task::Fetch(args) => fetch::run(&args),
        Task::Fixture(args) => fixture::run(&args),
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
    fn a_cause_is_said_once() {
        let inner = anyhow::anyhow!("no such file");
        let error = inner.context("cannot list: no such file").context("scene x");
        assert_eq!(one_line(&error), "scene x: cannot list: no such file");
    }
}
