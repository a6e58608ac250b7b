//! The `gsvx` command.

mod attribute_errors;
mod batch;
mod commands;
mod content;
mod describe;
mod doubts;
mod exit;
mod follow;
mod format;
mod frame_source;
mod glb;
mod input;
mod interrupt;
mod ledger;
mod loss;
mod max_error;
mod memory;
mod orbit;
mod output;
mod photos;
mod pictures;
mod positional;
mod progress;
mod region;
mod report;
mod scale;
mod size;
mod stream_file;
mod views;

use anyhow::Context;
use clap::{Parser, Subcommand};
use commands::{compare, convert, decode, encode, info, join, lod, plan, render, tune, view};
use report::Reporter;

/// Compress trained 3D Gaussian splatting scenes.
///
/// Files may be `-` for standard input or output. Outputs appear whole or not at all, and an
/// existing one is only replaced with --force.
#[derive(Parser)]
#[command(name = "gsvx", version, about, after_help = exit::CODES)]
struct Cli {
    /// Print the report as one JSON object.
    #[arg(long, global = true, hide_short_help = true, help_heading = "Every command")]
    json: bool,
    /// Threads to use [default: all cores]. The output does not depend on it.
    #[arg(long, global = true, value_name = "N", hide_short_help = true,
          help_heading = "Every command", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Compress a model (PLY, SOG, SPZ, glTF ...) into a gsvx stream.
    #[command(after_help = encode::MORE, after_long_help = encode::EXAMPLES)]
    Encode(encode::EncodeArgs),
    /// Write the model in a stream as a PLY that any 3DGS viewer opens, or as glTF, SPZ, .splat.
    #[command(after_help = decode::EXAMPLES)]
    Decode(decode::DecodeArgs),
    /// Tune a model to its photos, or to itself, for a smaller stream of equal quality.
    #[command(after_help = tune::EXAMPLES)]
    Tune(tune::TuneArgs),
    /// Show what a stream or a model holds: Gaussians, chunks, sizes.
    #[command(after_help = info::EXAMPLES)]
    Info(info::InfoArgs),
    /// Draw a model or stream from given or generated cameras as PNGs.
    #[command(after_help = render::EXAMPLES)]
    Render(render::RenderArgs),
    /// Compare two models: PSNR, SSIM and SSIMULACRA2 of their renders, errors of their attributes.
    #[command(after_help = compare::EXAMPLES)]
    Compare(compare::CompareArgs),
    /// Convert between PLY, glTF, SPZ, SOG and the formats of other tools; streams are read too, and put into glTF.
    #[command(after_help = convert::more())]
    Convert(convert::ConvertArgs),
    /// Divide a scene that is too large for one machine, for gsvx encode --part.
    #[command(after_help = plan::EXAMPLES)]
    Plan(plan::PlanArgs),
    /// Make one stream of the parts of a plan.
    #[command(after_help = join::EXAMPLES)]
    Join(join::JoinArgs),
    /// Divide a stream into files that PlayCanvas or CesiumJS streams by distance.
    #[command(after_help = lod::EXAMPLES)]
    Lod(lod::LodArgs),
    /// Look at a stream or a model in the browser.
    #[command(after_help = view::EXAMPLES)]
    View(view::ViewArgs),
}

fn run(cli: &Cli) -> anyhow::Result<()> {
    if let Command::Encode(args) = &cli.command {
        memory::return_soon(&args.scene.inputs);
    }
    interrupt::install()?;
    // `view` serves until it is ended, so it has no progress to show.
    if !matches!(cli.command, Command::View(_)) {
        progress::watch();
    }
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
        // On a thread of the pool, which then starts its many short tasks without a change of thread.
        Command::Tune(args) => rayon::scope(|_| tune::run(args, report)),
        Command::Info(args) => info::run(args, report),
        Command::Render(args) => render::run(args, report),
        Command::Compare(args) => compare::run(args, report),
        Command::Convert(args) => convert::run(args, report),
        Command::Plan(args) => plan::run(args, report),
        Command::Join(args) => join::run(args, report),
        Command::Lod(args) => lod::run(args, report),
        Command::View(args) => view::run(args, report),
    }
}

fn main() -> std::process::ExitCode {
    // Shells on Windows leave patterns such as `*.ply` to the command.
    match run(&Cli::parse_from(wild::args_os())) {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => exit::code(&error).into(),
    }
}
