//! `gsvx encode`.

use crate::output::{Output, megabytes};
use crate::report::Reporter;
use crate::{input, progress, views};
use anyhow::{Context, Result, bail};
use gs_model::Scene;
use gsvx::{CovarianceMode, EncodeOptions, Encoded, Entropy, Prepared, rate};
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;
use voxel::Strategy;

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx encode model.ply -o scene.gsvx                          default quality
  gsvx encode model.ply -o scene.gsvx --quality 75 --cameras data/fox
  gsvx encode model.ply -o scene.gsvx --target-bytes 1000000
  gsvx encode model.ply -o scene.gsvx --cameras data/fox --target-psnr 40
  gsvx encode model.ply -o scene.gsvx --lossless
  gsvx encode - -o - < model.ply > scene.gsvx";

/// Arguments of `gsvx encode`.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("rate"))]
pub(crate) struct Args {
    /// The trained model: a PLY in the Inria layout, .splat or .spz; `-` for standard input.
    input: PathBuf,
    /// The stream to write; `-` for standard output.
    #[arg(short, long)]
    output: PathBuf,
    /// Quality from 0 (smallest) to 100 (best).
    #[arg(short, long, group = "rate", default_value_t = gsvx::DEFAULT_QUALITY)]
    quality: f32,
    /// Largest stream of at most this many bytes.
    #[arg(long, value_name = "BYTES", group = "rate")]
    target_bytes: Option<u64>,
    /// The same in megabits (10^6 bits).
    #[arg(long, value_name = "MBIT", group = "rate")]
    target_mbit: Option<f64>,
    /// Smallest stream whose renders reach this PSNR, in dB, against renders of the input;
    /// needs --cameras.
    #[arg(long, value_name = "DB", group = "rate", requires = "cameras")]
    target_psnr: Option<f64>,
    /// Cameras of the training photos: a scene folder (COLMAP project, Inria output or
    /// transforms.json), a cameras.json or a transforms.json. Bits then go where they look.
    #[arg(long, value_name = "PATH")]
    cameras: Option<PathBuf>,
    /// Voxelize uniformly at this octree depth instead of by rate and distortion.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=21))]
    depth: Option<u8>,
    /// With --depth: adaptively by the paper's criteria, from this depth to DEPTH.
    #[arg(long, value_name = "DEPTH", requires = "depth",
          value_parser = clap::value_parser!(u8).range(1..=21))]
    j_low: Option<u8>,
    /// Covariance mode: transform, vq:BITS (a codebook of 2^BITS) or lossless:BITS (integers).
    #[arg(long, default_value = "transform", value_parser = covariance)]
    covariance: CovarianceMode,
    /// Code with RLGR and without prediction: several times faster, about 8 % larger.
    #[arg(long)]
    fast: bool,
    /// Highest SH degree to keep.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3))]
    max_sh_degree: u8,
    /// Every float of the model comes back bit for bit (in another order).
    #[arg(long, conflicts_with_all = ["rate", "depth", "cameras", "covariance", "max_sh_degree"])]
    lossless: bool,
    /// Leave out Gaussians with NaN, infinity or a zero quaternion instead of failing.
    #[arg(long)]
    drop_invalid: bool,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

fn covariance(text: &str) -> std::result::Result<CovarianceMode, String> {
    let bits = |b: &str, low: u8, high: u8| match b.parse() {
        Ok(bits) if (low..=high).contains(&bits) => Ok(bits),
        _ => Err(format!("BITS must be {low} to {high}")),
    };
    match text.split_once(':') {
        None if text == "transform" => Ok(CovarianceMode::Transform),
        None if text == "vq" => Ok(CovarianceMode::Vq { bits: 12 }),
        None if text == "lossless" => Ok(CovarianceMode::Lossless { bits: 16 }),
        Some(("vq", b)) => Ok(CovarianceMode::Vq { bits: bits(b, 8, 16)? }),
        Some(("lossless", b)) => Ok(CovarianceMode::Lossless { bits: bits(b, 8, 24)? }),
        _ => Err("use transform, vq:BITS or lossless:BITS".into()),
    }
}

/// Encodes a model.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    // Refuse a bad quality and an output that cannot be before reading anything.
    EncodeOptions::from_quality(args.quality)?;
    let output = Output::open(&args.output, args.force)?;
    let start = Instant::now();
    let (scene, input_bytes) = input::model(&args.input, args.drop_invalid)?;
    let in_input = scene.len();
    let read_seconds = start.elapsed().as_secs_f64();
    let step = Instant::now();
    let made = if args.lossless {
        let encoded = gsvx::encode_lossless(&scene).with_context(|| input::name(&args.input))?;
        Made {
            encoded,
            gaussians: scene.len(),
            note: "every float bit for bit".into(),
            ..Made::default()
        }
    } else {
        lossy(args, &scene)?
    };
    drop(scene);
    let encode_seconds = step.elapsed().as_secs_f64();
    let (name, stdout) = (output.name(), output.is_stdout());
    output.write(|out| Ok(out.write_all(&made.encoded.bytes)?))?;

    let bytes = made.encoded.bytes.len() as u64;
    let human = format!(
        "{name}: {in_input} Gaussians coded as {}, {} -> {} ({:.1}x, {:.1} bits per Gaussian); {}\n\
         read {read_seconds:.2} s, encode {encode_seconds:.2} s",
        made.gaussians,
        megabytes(input_bytes),
        megabytes(bytes),
        input_bytes as f64 / bytes as f64,
        8.0 * bytes as f64 / made.gaussians.max(1) as f64,
        made.note,
    );
    let sections: serde_json::Map<String, serde_json::Value> =
        made.encoded.sections.iter().map(|(kind, n)| (kind.to_string(), json!(n))).collect();
    report.say(
        stdout,
        &human,
        &json!({
            "output": name,
            "bytes": bytes,
            "input_bytes": input_bytes,
            "input_gaussians": in_input,
            "gaussians": made.gaussians,
            "quality": made.quality,
            "psnr": made.psnr,
            "encodes": made.encodes,
            "sections": sections,
            "read_seconds": read_seconds,
            "encode_seconds": encode_seconds,
        }),
    );
    Ok(())
}

#[derive(Default)]
struct Made {
    encoded: Encoded,
    gaussians: usize,
    note: String,
    quality: Option<f32>,
    /// Against renders of the input, where it was measured.
    psnr: Option<f64>,
    encodes: usize,
}

fn lossy(args: &Args, scene: &Scene) -> Result<Made> {
    let cameras = args.cameras.as_deref().map(views::cameras).transpose()?;
    let importance = cameras.as_ref().map(|c| views::importance(scene, c));
    let mut gaussians = 0;
    let mut at = |quality: f32| -> gsvx::Result<Encoded> {
        let bar = progress::spinner(format!("encoding at quality {quality:.1}"));
        let strategy = |importance: &[f32], seen| match (args.depth, args.j_low) {
            (Some(depth), Some(j_low)) => Ok(Strategy::paper(j_low.min(depth), depth)),
            (Some(depth), None) => Ok(Strategy::Uniform { depth }),
            (None, _) => gsvx::default_strategy(quality, importance, seen),
        };
        let Prepared { scene, voxels, importance } =
            gsvx::prepare(scene, strategy, importance.as_deref())?;
        let options = EncodeOptions {
            max_sh_degree: args.max_sh_degree,
            covariance: args.covariance,
            entropy: if args.fast { Entropy::Rlgr } else { Entropy::Range },
            importance: Some(importance),
            ..EncodeOptions::from_quality(quality)?
        };
        gaussians = scene.len();
        let encoded = gsvx::encode(&scene, &voxels, &options);
        bar.finish_and_clear();
        encoded
    };
    let bytes = match args.target_mbit {
        Some(mbit) if mbit.is_finite() && mbit > 0.0 => Some((mbit * 1e6 / 8.0) as u64),
        Some(mbit) => bail!("--target-mbit {mbit}: must be a positive number"),
        None => args.target_bytes,
    };
    if let Some(bytes) = bytes {
        let found = rate::to_bytes(bytes, &mut at).with_context(|| input::name(&args.input))?;
        let share = 100.0 * found.encoded.bytes.len() as f64 / bytes as f64;
        let note = format!(
            "quality {:.1}, {share:.1}% of the target, {} encodes",
            found.quality, found.encodes
        );
        let (quality, encodes) = (Some(found.quality), found.encodes);
        return Ok(Made { encoded: found.encoded, gaussians, note, quality, psnr: None, encodes });
    }
    if let (Some(target), Some(cameras)) = (args.target_psnr, &cameras) {
        if !target.is_finite() {
            bail!("--target-psnr {target}: must be a number of dB");
        }
        let reference = views::Reference::new(scene, cameras)?;
        let measure = |encoded: &Encoded| {
            let decoded = gsvx::decode(&encoded.bytes, &gsvx::DecodeOptions::default())?;
            Ok(reference.psnr(&decoded.scene))
        };
        let found =
            rate::to_measure(target, &mut at, measure).with_context(|| input::name(&args.input))?;
        let got = found.measured.unwrap_or(f64::NAN);
        if got < target {
            eprintln!("warning: the best quality reaches {got:.2} dB, not {target:.2} dB");
        }
        let note = format!(
            "quality {:.1}, {got:.2} dB from the input's renders, {} encodes",
            found.quality, found.encodes
        );
        let (quality, encodes) = (Some(found.quality), found.encodes);
        let psnr = Some(got);
        return Ok(Made { encoded: found.encoded, gaussians, note, quality, psnr, encodes });
    }
    let encoded = at(args.quality).with_context(|| input::name(&args.input))?;
    let note = format!("quality {}", args.quality);
    Ok(Made { encoded, gaussians, note, quality: Some(args.quality), psnr: None, encodes: 1 })
}
