//! `gsvx plan`.

use crate::encode::quality;
use crate::input::Reading;
use crate::preset::{self, Preset};
use crate::report::Reporter;
use crate::scale::{self, Job, Room};
use anyhow::Result;
use gsvx::{Choices, EncodeOptions, Seen};
use std::path::{Path, PathBuf};

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
    /// Quality from 0 (smallest) to 100 (best).
    #[arg(short, long, value_parser = quality, default_value_t = gsvx::DEFAULT_QUALITY)]
    quality: f32,
    /// A quality by name: 30, 50, 80 or 90.
    #[arg(long, value_name = "NAME", conflicts_with = "quality", value_parser = preset::parser())]
    preset: Option<Preset>,
    /// Highest SH degree to keep.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3),
          value_name = "DEGREE")]
    max_sh_degree: u8,
    /// A scene folder, a cameras.json or a transforms.json: bits go where its training cameras look.
    #[arg(long, value_name = "PATH")]
    cameras: Option<PathBuf>,
    /// With --cameras: leave out what they see too little of to pay for its bits.
    #[arg(long, requires = "cameras")]
    drop_unseen: bool,
    /// Store levels of detail too: coarse scenes that viewers show first or from afar.
    #[arg(long)]
    lod: bool,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    room: Room,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

/// What `gsvx encode` chooses by itself.
pub(crate) fn choices(quality: f32, max_sh_degree: u8, seen: Seen, lod: bool) -> Choices {
    let chunk_leaves = EncodeOptions::default().chunk_leaves;
    Choices { quality, max_sh_degree, chunk_leaves, seen, lod }
}

/// Where importances come from.
pub(crate) fn seen(cameras: Option<&Path>, drop_unseen: bool) -> Seen {
    match (cameras, drop_unseen) {
        (None, _) => Seen::Guessed,
        (Some(_), false) => Seen::ByCameras,
        (Some(_), true) => Seen::ByCamerasOnly,
    }
}

/// Makes a plan.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let quality = args.preset.map_or(args.quality, |p| p.quality);
    let cameras = args.cameras.as_deref();
    let job = Job {
        inputs: &args.inputs,
        reading: &args.reading,
        choices: choices(quality, args.max_sh_degree, seen(cameras, args.drop_unseen), args.lod),
        cameras,
        output: &args.output,
        force: args.force,
        room: &args.room,
    };
    scale::plan(&job, report)
}
