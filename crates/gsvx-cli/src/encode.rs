//! `gsvx encode`.

use crate::output::{Output, megabytes};
use crate::report::Reporter;
use crate::trim::Trim;
use crate::{input, progress, views};
use anyhow::{Context, Result, bail};
use gs_model::{Camera, Scene};
use gsvx::{CovarianceMode, EncodeOptions, Encoded, Entropy, PaperQp, Prepared, rate};
use serde_json::json;
use std::borrow::Cow;
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
  gsvx encode model.ply -o scene.gsvx --prune 0.2 --cameras data/fox
  gsvx encode model.ply -o paper.gsvx --profile paper --qp 28,4,4 --depth 15
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
    /// Coding choices: default, or paper for those of the paper (uniform voxels, unweighted RAHT,
    /// RLGR, QPs, covariance codebook), for comparison.
    #[arg(long, default_value = "default", conflicts_with_all = ["fast", "small", "target_psnr"])]
    profile: Profile,
    /// With --profile paper: quantisation parameters of AC, DC and opacity [default: by quality].
    #[arg(long, value_name = "AC,DC,OPACITY", value_parser = qp)]
    qp: Option<PaperQp>,
    /// Leave out this fraction of the Gaussians first, those of least importance: seen least by
    /// --cameras, else least opacity times size.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0)]
    prune: f64,
    /// Voxelize uniformly at this octree depth instead of by rate and distortion.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=21))]
    depth: Option<u8>,
    /// With --depth: adaptively by the paper's criteria, from this depth to DEPTH.
    #[arg(long, value_name = "DEPTH", requires = "depth",
          value_parser = clap::value_parser!(u8).range(1..=21))]
    j_low: Option<u8>,
    /// Floaters so far away that the others lose octree levels: auto codes them exactly where that
    /// is cheaper, off keeps them in the octree.
    #[arg(long, default_value = "auto")]
    trim: Trim,
    /// Covariance mode: transform, vq:BITS (a codebook of 2^BITS) or lossless:BITS (integers)
    /// [default: transform; of --profile paper: vq:12].
    #[arg(long, value_parser = covariance)]
    covariance: Option<CovarianceMode>,
    /// Code with RLGR, without prediction: decodes in two thirds to four fifths of the time, 8 to 10 % larger.
    #[arg(long)]
    fast: bool,
    /// Code large models as small ones: 2 % smaller, and decoded in almost twice the time.
    #[arg(long, conflicts_with = "fast")]
    small: bool,
    /// Highest SH degree to keep.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3))]
    max_sh_degree: u8,
    /// Every float of the model comes back bit for bit (in another order).
    #[arg(long, conflicts_with_all = ["rate", "depth", "cameras", "covariance", "max_sh_degree", "profile", "prune", "trim"])]
    lossless: bool,
    /// Leave out Gaussians with NaN, infinity or a zero quaternion instead of failing.
    #[arg(long)]
    drop_invalid: bool,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

impl Args {
    /// Where the model is.
    pub(crate) fn input(&self) -> &std::path::Path {
        &self.input
    }
}

/// Coding choices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Profile {
    Default,
    Paper,
}

fn qp(text: &str) -> std::result::Result<PaperQp, String> {
    let parts: Vec<u8> = text.split(',').filter_map(|p| p.parse().ok()).collect();
    match parts[..] {
        [ac, dc, opacity] if parts.iter().all(|q| (4..=51).contains(q)) => {
            Ok(PaperQp { ac, dc, opacity })
        }
        _ => Err("use AC,DC,OPACITY with 4 to 51 each".into()),
    }
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
    gsvx::prune(&[], args.prune)?;
    if args.qp.is_some() && args.profile != Profile::Paper {
        bail!("--qp: belongs to --profile paper");
    }
    let output = Output::open(&args.output, args.force)?;
    let start = Instant::now();
    let (scene, input_bytes) = input::model(&args.input, args.drop_invalid)?;
    let in_input = scene.len();
    let read_seconds = start.elapsed().as_secs_f64();
    let step = Instant::now();
    let mut made = if args.lossless {
        let encoded = gsvx::encode_lossless(&scene).with_context(|| input::name(&args.input))?;
        Made {
            encoded,
            gaussians: scene.len(),
            note: "every float bit for bit".into(),
            ..Made::default()
        }
    } else {
        lossy(args, scene)?
    };
    if made.pruned > 0 {
        made.note += &format!("; {} pruned", made.pruned);
    }
    match made.outliers {
        0 => {}
        1 => made.note += "; 1 outlier coded exactly",
        n => made.note += &format!("; {n} outliers coded exactly"),
    }
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
            "pruned": made.pruned,
            "outliers": made.outliers,
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
    /// Gaussians left out by --prune.
    pruned: usize,
    /// Gaussians coded exactly by --trim.
    outliers: usize,
}

/// Octree depth of the paper's profile where none is given: finer with the rate.
fn paper_depth(quality: f32) -> u8 {
    match quality {
        q if q < 27.0 => 13,
        q if q < 55.0 => 14,
        q if q < 83.0 => 15,
        _ => 16,
    }
}

/// What one encode of a search makes: the stream and its number of Gaussians.
type One = (Encoded, usize);

/// Voxelizes and encodes at a quality. `scene` is dropped before the encoder runs if it is owned.
fn encode_at(
    args: &Args,
    scene: Cow<'_, Scene>,
    outliers: Option<&Scene>,
    (cameras, seen): (Option<&[Camera]>, Option<&[f32]>),
    q: f32,
) -> gsvx::Result<One> {
    let bar = progress::spinner(format!("encoding at quality {q:.1}"));
    let paper = args.profile == Profile::Paper;
    let strategy = |importance: &[f32], seen| match (args.depth, args.j_low) {
        (Some(depth), Some(j_low)) => Ok(Strategy::paper(j_low.min(depth), depth)),
        (Some(depth), None) => Ok(Strategy::Uniform { depth }),
        (None, _) if paper => Ok(Strategy::Uniform { depth: paper_depth(q) }),
        (None, _) => gsvx::default_strategy(q, importance, seen),
    };
    let mut options = if paper {
        let covariance = args.covariance.unwrap_or(CovarianceMode::Vq { bits: 12 });
        EncodeOptions::paper(args.qp.unwrap_or(PaperQp::of_quality(q)), covariance)
    } else {
        EncodeOptions {
            covariance: args.covariance.unwrap_or_default(),
            entropy: match (args.fast, args.small) {
                (true, _) => Entropy::Fast,
                (_, true) => Entropy::Small,
                _ => Entropy::Range,
            },
            ..EncodeOptions::from_quality(q)?
        }
    };
    options.max_sh_degree = args.max_sh_degree;
    options.outliers = outliers.cloned();
    let exact = outliers.map_or(0, Scene::len);
    if !paper && options.covariance == CovarianceMode::Transform {
        let (encoded, leaves) = gsvx::encode_model(scene, strategy, seen, &options)?;
        bar.finish_and_clear();
        return Ok((encoded, leaves + exact));
    }
    let Prepared { scene: merged, voxels, importance } = gsvx::prepare(&scene, strategy, seen)?;
    drop(scene);
    options.importance = Some(importance);
    if let (CovarianceMode::Vq { .. }, Some(cameras)) = (options.covariance, cameras) {
        options.covariance_sensitivity = Some(finetune::covariance_sensitivity(&merged, cameras));
    }
    let encoded = gsvx::encode(&merged, &voxels, &options)?;
    bar.finish_and_clear();
    Ok((encoded, merged.len() + exact))
}

fn lossy(args: &Args, mut scene: Scene) -> Result<Made> {
    let name = || input::name(&args.input);
    let cameras = args.cameras.as_deref().map(views::cameras).transpose()?;
    let mut seen = cameras.as_ref().map(|c| views::importance(&scene, c));
    let mut pruned = 0;
    // Quality is measured against what came in, not against what pruning left.
    let reference = match (args.target_psnr, &cameras) {
        (Some(_), Some(cameras)) => Some(views::Reference::new(&scene, cameras)?),
        _ => None,
    };
    if args.prune > 0.0 {
        let guessed;
        let importance = match &seen {
            Some(seen) => seen,
            None => {
                guessed = gsvx::importance::without_cameras(&scene);
                &guessed
            }
        };
        let kept = gsvx::prune(importance, args.prune)?;
        pruned = scene.len() - kept.len();
        if let Some(seen) = &mut seen {
            *seen = kept.iter().map(|&i| seen[i]).collect();
        }
        scene = scene.select(&kept);
    }
    let outliers = args.trim.split(&mut scene, seen.as_mut(), name)?;
    let outliers = outliers.as_ref();
    let exact = outliers.map_or(0, Scene::len);
    let views = (cameras.as_deref(), seen.as_deref());
    let bytes = match args.target_mbit {
        Some(mbit) if mbit.is_finite() && mbit > 0.0 => Some((mbit * 1e6 / 8.0) as u64),
        Some(mbit) => bail!("--target-mbit {mbit}: must be a positive number"),
        None => args.target_bytes,
    };
    if bytes.is_none() && args.target_psnr.is_none() {
        let (encoded, gaussians) =
            encode_at(args, Cow::Owned(scene), outliers, views, args.quality).with_context(name)?;
        let (note, quality) = (format!("quality {}", args.quality), Some(args.quality));
        return Ok(Made {
            encoded,
            gaussians,
            note,
            quality,
            psnr: None,
            encodes: 1,
            pruned,
            outliers: exact,
        });
    }
    let mut counts = Vec::new();
    let mut at = |q: f32| {
        let (encoded, gaussians) = encode_at(args, Cow::Borrowed(&scene), outliers, views, q)?;
        counts.push((q, gaussians));
        Ok(encoded)
    };
    let (found, mut note) = if let Some(bytes) = bytes {
        let found = rate::to_bytes(bytes, &mut at).with_context(name)?;
        let share = 100.0 * found.encoded.bytes.len() as f64 / bytes as f64;
        (found, format!("{share:.1}% of the target"))
    } else if let (Some(target), Some(reference)) = (args.target_psnr, &reference) {
        if !target.is_finite() {
            bail!("--target-psnr {target}: must be a number of dB");
        }
        let measure = |encoded: &Encoded| {
            let decoded = gsvx::decode(&encoded.bytes, &gsvx::DecodeOptions::default())?;
            Ok(reference.psnr(&decoded.scene))
        };
        let found = rate::to_measure(target, &mut at, measure).with_context(name)?;
        let got = found.measured.unwrap_or(f64::NAN);
        if got < target {
            eprintln!("warning: the best quality reaches {got:.2} dB, not {target:.2} dB");
        }
        (found, format!("{got:.2} dB from the input's renders"))
    } else {
        bail!("--target-psnr needs --cameras");
    };
    note = format!("quality {:.1}, {note}, {} encodes", found.quality, found.encodes);
    let gaussians = counts.iter().find(|(q, _)| *q == found.quality).map_or(0, |(_, n)| *n);
    Ok(Made {
        encoded: found.encoded,
        gaussians,
        note,
        quality: Some(found.quality),
        psnr: found.measured,
        encodes: found.encodes,
        pruned,
        outliers: exact,
    })
}
