//! `gsvx decode`.

use crate::input;
use crate::output::Output;
use crate::report::Reporter;
use anyhow::{Context, Result};
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx decode scene.gsvx -o back.ply
  gsvx decode scene.gsvx -o base.ply --max-sh-degree 0     base colour only
  gsvx decode scene.gsvx -o far.ply --lod 9                at most one Gaussian per cell
  curl https://example.org/scene.gsvx | gsvx decode - -o back.ply
  gsvx decode half.gsvx -o part.ply --allow-truncated";

/// Arguments of `gsvx decode`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The stream; `-` for standard input.
    input: PathBuf,
    /// The PLY to write; `-` for standard output.
    #[arg(short, long)]
    output: PathBuf,
    /// Highest SH degree to decode; less is faster and needs less of the stream.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3))]
    max_sh_degree: u8,
    /// Level of detail: at most one Gaussian per octree cell of this depth.
    #[arg(long, value_name = "DEPTH", value_parser = clap::value_parser!(u8).range(0..=21))]
    lod: Option<u8>,
    /// Decode what a truncated stream still holds instead of failing.
    #[arg(long)]
    allow_truncated: bool,
    /// Refuse streams with more Gaussians than this.
    #[arg(long)]
    max_gaussians: Option<u64>,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

/// Decodes a stream to a PLY file.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let output = Output::open(&args.output, args.force)?;
    let start = Instant::now();
    let bytes = input::bytes(&args.input)?;
    let options = gsvx::DecodeOptions {
        max_sh_degree: args.max_sh_degree,
        lod: args.lod,
        allow_truncated: args.allow_truncated,
        max_gaussians: args.max_gaussians,
    };
    let decoded = gsvx::decode(&bytes, &options).with_context(|| input::name(&args.input))?;
    drop(bytes);
    let seconds = start.elapsed().as_secs_f64();
    for skipped in &decoded.skipped {
        eprintln!("note: {skipped}");
    }
    let scene = decoded.scene;
    let (name, stdout) = (output.name(), output.is_stdout());
    output.write(|out| Ok(gs_model::ply::write_to(out, &scene)?))?;
    let human = format!(
        "{name}: {} Gaussians, SH degree {}, decoded in {seconds:.2} s",
        scene.len(),
        scene.sh_degree
    );
    report.say(
        stdout,
        &human,
        &json!({
            "output": name,
            "gaussians": scene.len(),
            "sh_degree": scene.sh_degree,
            "skipped": decoded.skipped,
            "decode_seconds": seconds,
        }),
    );
    Ok(())
}
