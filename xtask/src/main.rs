//! Project tasks: `cargo xtask --help`.
#![allow(
    clippy::disallowed_methods,
    reason = "reports and pictures, never the bitstream; fixtures use libm"
)]

mod fixture;
mod measure;
mod progress;

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
    /// Make the default scene, fixtures/room, from its seed
    Fixture(fixture::FixtureArgs),
}

fn main() -> ExitCode {
    let done = match Cli::parse().task {
        Task::Fixture(args) => fixture::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // One line: the chain of causes, outermost first.
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
