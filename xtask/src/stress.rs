//! `cargo xtask stress`: pathological scenes through the whole chain.

use std::path::PathBuf;
use std::process::Command;

use anyhow::Result;
use eval::stress;

/// Flags of `cargo xtask stress`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
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

pub(crate) fn run(args: Args) -> Result<()> {
    if let (true, Some(input), Some(mode)) = (args.child, &args.input, &args.mode) {
        return stress::child(input, mode, args.size);
    }
    let Args { input, mode, size, all, timeout, out, .. } = args;
    stress::run(&stress::Options { input, mode, size, all, timeout, child, out })
}

/// A process that runs one input in one mode.
fn child(input: &str, mode: &str, size: usize) -> std::io::Result<Command> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["stress", "--child", "--size", &size.to_string(), "--input", input]);
    command.arg(format!("--mode={mode}"));
    Ok(command)
}
