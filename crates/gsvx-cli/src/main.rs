//! The `gsvx` command.

mod attribute_errors;
mod compare;
mod convert;
mod decode;
mod encode;
mod info;
mod input;
mod interrupt;
mod memory;
mod nearest;
mod orbit;
mod output;
mod progress;
mod render;
mod report;
mod trim;
mod tune;
mod views;

use anyhow::Context;
use clap::{Parser, Subcommand};
use report::Reporter;

/// Compress trained 3D Gaussian splatting scenes.
///
/// Files may be `-` for standard input or output. Outputs appear whole or not at all, and an
/// existing one is only replaced with --force.
#[derive(Parser)]
#[command(name = "gsvx", version, about, after_help = EXIT_CODES)]
struct Cli {
    /// Print the report as one JSON object.
    #[arg(long, global = true)]
    json: bool,
    /// Threads to use [default: all cores]. The output does not depend on it.
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "\
Exit codes: 0 the output is complete; 1 it failed, one line on standard error says why, and no \
output was touched; 2 wrong usage; 130 interrupted, no output was touched.";

#[derive(Subcommand)]
enum Command {
    /// Compress a model (PLY, .splat, SPZ) into a gsvx stream.
    #[command(after_help = encode::EXAMPLES)]
    Encode(encode::Args),
    /// Write the model in a stream as a PLY that any 3DGS viewer opens.
    #[command(after_help = decode::EXAMPLES)]
    Decode(decode::Args),
    /// Voxelize and fine-tune a model against its photos, means frozen.
    #[command(after_help = tune::EXAMPLES)]
    Finetune(tune::Args),
    /// Show what a stream holds: sections, sizes, bits per Gaussian.
    #[command(after_help = info::EXAMPLES)]
    Info(info::Args),
    /// Draw a model or stream from given or generated cameras as PNGs.
    #[command(after_help = render::EXAMPLES)]
    Render(render::Args),
    /// Compare two models: PSNR and SSIM of their renders, errors of their attributes.
    #[command(after_help = compare::EXAMPLES)]
    Compare(compare::Args),
    /// Convert between PLY, .splat and SPZ; streams are read too.
    #[command(after_help = convert::EXAMPLES)]
    Convert(convert::Args),
}

fn run(cli: &Cli) -> anyhow::Result<()> {
    if let Command::Encode(args) = &cli.command {
        memory::return_soon(args.input());
    }
    interrupt::install()?;
    if let Some(threads) = cli.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads.into())
            .build_global()
            .context("--threads: the threads cannot be started")?;
    }
    let report = Reporter { json: cli.json };
    match &cli.command {
        Command::Encode(args) => encode::run(args, report),
        Command::Decode(args) => decode::run(args, report),
        Command::Finetune(args) => tune::run(args, report),
        Command::Info(args) => info::run(args, report),
        Command::Render(args) => render::run(args, report),
        Command::Compare(args) => compare::run(args, report),
        Command::Convert(args) => convert::run(args, report),
    }
}

fn main() -> std::process::ExitCode {
    match run(&Cli::parse()) {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            // One line: the chain of causes, outermost first.
            eprintln!("error: {error:#}");
            std::process::ExitCode::FAILURE
        }
    }
}
