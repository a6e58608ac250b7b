//! `gsvx decode`.

use crate::output;
use anyhow::{Context, Result};
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `gsvx decode`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The stream.
    input: PathBuf,
    /// The PLY to write.
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
pub(crate) fn run(args: &Args) -> Result<()> {
    let name = args.input.display();
    output::check(&args.output, args.force)?;
    let start = Instant::now();
    let bytes = std::fs::read(&args.input).with_context(|| format!("{name}: cannot be read"))?;
    let options = gsvx::DecodeOptions {
        max_sh_degree: args.max_sh_degree,
        lod: args.lod,
        allow_truncated: args.allow_truncated,
        max_gaussians: args.max_gaussians,
    };
    let decoded = gsvx::decode(&bytes, &options).with_context(|| name.to_string())?;
    let seconds = start.elapsed().as_secs_f64();
    for skipped in &decoded.skipped {
        eprintln!("note: {skipped}");
    }
    output::write(&args.output, |out| Ok(gs_model::ply::write_to(out, &decoded.scene)?))?;
    println!(
        "{}: {} Gaussians, SH degree {}, decoded in {seconds:.2} s",
        args.output.display(),
        decoded.scene.len(),
        decoded.scene.sh_degree
    );
    Ok(())
}
