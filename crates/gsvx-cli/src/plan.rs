//! `gsvx plan`.

use crate::content::Content;
use crate::input::Reading;
use crate::report::Reporter;
use crate::scale::{self, LargeJob, Room};
use anyhow::Result;
use gsvx::Aim;
use std::path::PathBuf;

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx plan tiles/*.ply -o city.plan
  gsvx encode city.plan --part 3/16 -o part-3.gsvx         on 16 machines, one each
  gsvx join part-*.gsvx -o city.gsvx";

/// Arguments of `gsvx plan`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The models, which become one scene in this order. Their paths stand in the plan.
    #[arg(required = true, value_name = "MODEL")]
    inputs: Vec<PathBuf>,
    /// The plan to write; `-` for standard output.
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    #[command(flatten)]
    content: Content,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    room: Room,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

/// Makes a plan.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let content = &args.content;
    let cameras = content.cameras.as_deref();
    let encoder = content.encoder(Aim::Quality(content.quality()));
    let job = LargeJob {
        inputs: &args.inputs,
        reading: &args.reading,
        choices: encoder.choices(cameras.is_some())?,
        cameras,
        output: &args.output,
        force: args.force,
        room: &args.room,
    };
    scale::plan(&job, report)
}
