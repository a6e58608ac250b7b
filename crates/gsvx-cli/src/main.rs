//! The `gsvx` command.

mod decode;
mod encode;
mod info;
mod output;
mod progress;
mod tune;
mod views;

use clap::{Parser, Subcommand};

/// Compress trained 3D Gaussian splatting scenes.
#[derive(Parser)]
#[command(name = "gsvx", version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Compress a PLY model into a gsvx stream.
    Encode(encode::Args),
    /// Write the model in a stream as a PLY that any 3DGS viewer opens.
    Decode(decode::Args),
    /// Voxelize and fine-tune a model against its photos, means frozen.
    Finetune(tune::Args),
    /// Show what a stream holds: sections, sizes, bits per Gaussian.
    Info(info::Args),
}

fn main() -> std::process::ExitCode {
    let result = match Cli::parse().command {
        Command::Encode(args) => encode::run(&args),
        Command::Decode(args) => decode::run(&args),
        Command::Finetune(args) => tune::run(&args),
        Command::Info(args) => info::run(&args),
    };
    match result {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            // One line: the chain of causes, outermost first.
            eprintln!("error: {error:#}");
            std::process::ExitCode::FAILURE
        }
    }
}
