//! `gsvx encode`.

use crate::output::{self, megabytes};
use anyhow::{Context, Result};
use gs_model::ply::{Invalid, ReadOptions};
use std::path::PathBuf;
use std::time::Instant;
use voxel::{Cube, Merge, Strategy};

/// Arguments of `gsvx encode`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The trained model, a PLY in the Inria layout.
    input: PathBuf,
    /// The stream to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Quality from 0 (smallest) to 100 (best).
    #[arg(short, long, default_value_t = gsvx::DEFAULT_QUALITY)]
    quality: f32,
    /// Octree depth: means are moved to the centres of voxels of 1/2^DEPTH of the scene's side.
    #[arg(short, long, default_value_t = 13, value_parser = clap::value_parser!(u8).range(1..=21))]
    depth: u8,
    /// Voxelize adaptively, from this depth for small Gaussians in dense regions to DEPTH.
    #[arg(long, value_name = "J_LOW", value_parser = clap::value_parser!(u8).range(1..=21))]
    adaptive: Option<u8>,
    /// Highest SH degree to keep.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3))]
    max_sh_degree: u8,
    /// Leave out Gaussians with NaN, infinity or a zero quaternion instead of failing.
    #[arg(long)]
    drop_invalid: bool,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

/// Encodes a PLY model.
pub(crate) fn run(args: &Args) -> Result<()> {
    output::check(&args.output, args.force)?;
    let options = gsvx::EncodeOptions {
        max_sh_degree: args.max_sh_degree,
        ..gsvx::EncodeOptions::from_quality(args.quality)?
    };
    let start = Instant::now();
    let invalid = if args.drop_invalid { Invalid::Drop } else { Invalid::Error };
    let read = ReadOptions { invalid, ..Default::default() };
    let (scene, report) = gs_model::ply::read_with(&args.input, &read)?;
    for property in &report.unknown_properties {
        eprintln!("skipped: property {property} is not part of a 3DGS model");
    }
    if report.gaussians < report.gaussians_in_file {
        let dropped = report.gaussians_in_file - report.gaussians;
        eprintln!("skipped: {dropped} invalid Gaussians of {}", report.gaussians_in_file);
    }
    let read_seconds = start.elapsed().as_secs_f64();

    let strategy = match args.adaptive {
        Some(j_low) => Strategy::paper(j_low.min(args.depth), args.depth),
        None => Strategy::Uniform { depth: args.depth },
    };
    let name = || args.input.display().to_string();
    let step = Instant::now();
    let cube = Cube::of(&scene.means).with_context(name)?;
    let voxels = voxel::voxelize(&scene, &cube, &strategy).with_context(name)?;
    let merged = voxel::merge(&scene, &voxels, Merge::Moments).with_context(name)?;
    let voxelize_seconds = step.elapsed().as_secs_f64();
    let step = Instant::now();
    let encoded = gsvx::encode(&merged, &voxels, &options).with_context(name)?;
    let encode_seconds = step.elapsed().as_secs_f64();
    output::write(&args.output, |out| Ok(out.write_all(&encoded.bytes)?))?;

    let bytes = encoded.bytes.len() as u64;
    println!(
        "{}: {} Gaussians in {} voxels, {} -> {} ({:.1}x, {:.1} bits per Gaussian)",
        args.output.display(),
        scene.len(),
        merged.len(),
        megabytes(report.file_bytes as u64),
        megabytes(bytes),
        report.file_bytes as f64 / bytes as f64,
        8.0 * bytes as f64 / merged.len().max(1) as f64,
    );
    println!(
        "read {read_seconds:.2} s, voxelize {voxelize_seconds:.2} s, encode {encode_seconds:.2} s"
    );
    Ok(())
}
