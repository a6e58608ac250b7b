//! `gsvx encode`.

use crate::batch::{self, Job};
use crate::exit::{missed, note, usage};
use crate::format::Extension;
use crate::input::Reading;
use crate::loss::{Loss, Pictures};
use crate::lost_columns::Lost;
use crate::output::{Output, megabytes};
use crate::preset::{self, Preset};
use crate::report::Reporter;
use crate::trim::Trim;
use crate::{input, max_error, progress, size, views};
use anyhow::{Context, Result};
use gs_model::{Camera, Scene};
use gsvx::{CovarianceMode, EncodeOptions, Encoded, MaxError, Prepared, Seen, rate};
use serde_json::{Value, json};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Instant;
use voxel::Strategy;

/// Shown after the short help.
pub(crate) const MORE: &str = "gsvx encode --help shows all flags, and examples.";

/// Shown after the long help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx encode model.ply -o scene.gsvx                          default quality
  gsvx encode model.ply -o scene.gsvx --preset web
  gsvx encode model.ply -o scene.gsvx --quality 80 --cameras data/fox
  gsvx encode model.ply -o scene.gsvx --target-bytes 1.5MB
  gsvx encode model.ply -o scene.gsvx --cameras data/fox --target-psnr 40
  gsvx encode model.ply -o scene.gsvx --max-error 0.01         near-lossless
  gsvx encode model.ply -o scene.gsvx --lossless
  gsvx encode model.ply -o scene.gsvx --web                    for a web page
  gsvx encode *.ply -o streams/                                one stream per model
  gsvx encode model.ply -o scene.gsvx --prune 0.2 --cameras data/fox
  gsvx encode - -o - < model.ply > scene.gsvx";

/// Leaves of a chunk for the web: a page shows it, and a worker holds it, at once.
const WEB_CHUNK: NonZeroUsize = NonZeroUsize::MIN.saturating_add((1 << 14) - 1);

/// Heading of what most people never need.
const EXPERTS: &str = "For experts, and for comparison with the paper";
/// Heading of what changes the scene.
const CONTENT: &str = "What is kept";

/// Arguments of `gsvx encode`.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("rate"))]
pub(crate) struct Args {
    /// The trained models, of any format that gsvx convert reads; `-` for standard input.
    #[arg(required = true, value_name = "MODEL")]
    inputs: Vec<PathBuf>,
    /// The stream to write, or a folder for several; `-` for standard output.
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Quality from 0 (smallest) to 100 (best).
    #[arg(short, long, group = "rate", value_parser = quality,
          default_value_t = gsvx::DEFAULT_QUALITY)]
    quality: f32,
    /// A quality by name: 30, 50, 80 or 90.
    #[arg(long, value_name = "NAME", group = "rate", value_parser = preset::parser())]
    preset: Option<Preset>,
    /// Best stream of at most this size: 800000, 500k, 1.5MB.
    #[arg(long, value_name = "SIZE", group = "rate", value_parser = size::bytes)]
    target_bytes: Option<u64>,
    /// Smallest stream whose renders reach this PSNR, in dB; needs --cameras.
    ///
    /// The PSNR is that of renders of the stream against renders of the input.
    #[arg(long, value_name = "DB", group = "rate", requires = "cameras", value_parser = finite)]
    target_psnr: Option<f64>,
    /// Near-lossless: no Gaussian is merged, and no attribute is off by more than this. 0.01, say, or
    /// 0.01,mean=0.05 for other bounds by name.
    ///
    /// mean: of positions, in standard deviations along the Gaussian's longest axis. opacity: from 0 to 1.
    /// shape: of the logarithms of the scales, with the rotation (the norm that gsvx compare prints). sh: of
    /// each SH coefficient. The errors are measured and printed.
    #[arg(long, value_name = "BOUND", group = "rate", value_parser = max_error::parse,
          hide_short_help = true, help_heading = CONTENT,
          conflicts_with_all = ["cameras", "covariance", "depth", "web"])]
    max_error: Option<MaxError>,
    /// Cameras of the training photos: what they see gets more bits.
    ///
    /// A scene folder (COLMAP project, Inria output or transforms.json), a cameras.json or a
    /// transforms.json.
    #[arg(long, value_name = "PATH")]
    cameras: Option<PathBuf>,
    /// With --cameras: leave out the Gaussians that they see too little of to pay for their bits, and
    /// so all that they do not see.
    ///
    /// Streams are 5 to 15 % smaller and show the same from places like those of the cameras. From elsewhere
    /// parts may be missing. Without this, what the cameras do not see is kept coarsely.
    #[arg(long, requires = "cameras", hide_short_help = true, help_heading = CONTENT)]
    drop_unseen: bool,
    /// Keep every float of the Gaussians bit for bit.
    ///
    /// Their order changes. Other columns of a PLY, such as normals, are not kept: a warning names
    /// those that are not zero.
    #[arg(long, conflicts_with_all = ["rate", "target_mbit", "depth", "cameras", "covariance",
          "max_sh_degree", "prune", "trim", "lod", "web", "drop_unseen"])]
    lossless: bool,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
    /// Do not estimate the loss: less time and memory. The stream is the same.
    #[arg(long, hide_short_help = true)]
    no_estimate: bool,

    /// What a web page wants: the preset web if no quality is given, a coarse scene first, small chunks.
    #[arg(long, hide_short_help = true, help_heading = CONTENT)]
    web: bool,
    /// Store a coarse scene first, for viewers that show a scene while it loads.
    #[arg(long, hide_short_help = true, help_heading = CONTENT)]
    lod: bool,
    /// Highest SH degree to keep.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3),
          value_name = "DEGREE", hide_short_help = true, help_heading = CONTENT)]
    max_sh_degree: u8,
    /// Leave out this fraction of the Gaussians first, the least important: those that --cameras
    /// see least, else those of least opacity times size.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0, value_parser = fraction,
          hide_short_help = true, help_heading = CONTENT)]
    prune: f64,
    /// Gaussians so far away that the others lose octree levels: auto codes them exactly where that
    /// is cheaper, off keeps them in the octree.
    #[arg(long, default_value = "auto", value_name = "WHEN", hide_short_help = true,
          help_heading = CONTENT)]
    trim: Trim,

    #[command(flatten)]
    reading: Reading,

    /// The target size in megabits (10^6 bits).
    #[arg(long, value_name = "MBIT", group = "rate", value_parser = crate::size::positive,
          hide_short_help = true, help_heading = EXPERTS)]
    target_mbit: Option<f64>,
    /// Voxelize uniformly at this octree depth instead of by rate and distortion.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=21), hide_short_help = true,
          help_heading = EXPERTS)]
    depth: Option<u8>,
    /// With --depth: adaptively by the paper's criteria, from this depth to DEPTH.
    #[arg(long, value_name = "DEPTH", requires = "depth",
          value_parser = clap::value_parser!(u8).range(1..=21), hide_short_help = true,
          help_heading = EXPERTS)]
    j_low: Option<u8>,
    /// Covariance mode: transform, vq:BITS (a codebook of 2^BITS) or lossless:BITS (integers)
    /// [default: transform].
    #[arg(long, value_parser = covariance, value_name = "MODE", hide_short_help = true,
          help_heading = EXPERTS)]
    covariance: Option<CovarianceMode>,
}

impl Args {
    /// Where the models are.
    pub(crate) fn inputs(&self) -> &[PathBuf] {
        &self.inputs
    }

    fn quality(&self) -> f32 {
        self.preset().map_or(self.quality, |p| p.quality)
    }

    /// The preset that was asked for: --web names one, unless there is a quality.
    fn preset(&self) -> Option<Preset> {
        let web = self.web && self.quality == gsvx::DEFAULT_QUALITY;
        self.preset.or_else(|| web.then_some(preset::WEB))
    }

    /// The greatest number of bytes, if there is one.
    fn most_bytes(&self) -> Option<u64> {
        self.target_mbit.map(|mbit| (mbit * 1e6 / 8.0) as u64).or(self.target_bytes)
    }
}

/// A quality on the command line.
pub(crate) fn quality(text: &str) -> std::result::Result<f32, String> {
    let value = text.parse().map_err(|_| "use a number from 0 to 100".to_owned())?;
    EncodeOptions::from_quality(value).map_err(|e| e.to_string())?;
    Ok(value)
}

fn fraction(text: &str) -> std::result::Result<f64, String> {
    let value = text.parse().map_err(|_| "use a fraction such as 0.2".to_owned())?;
    gsvx::prune(&[], value).map_err(|e| e.to_string())?;
    Ok(value)
}

/// A number of dB on the command line.
pub(crate) fn finite(text: &str) -> std::result::Result<f64, String> {
    text.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| "use a number of dB".into())
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

/// Encodes the models.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    if let Extension::Model(format) = Extension::of(&args.output) {
        let (name, extension) = (args.output.display(), format.extension());
        return Err(usage(format!(
            "{name}: encode writes gsvx streams; name it .gsvx, or use gsvx convert to write .{extension}"
        )));
    }
    let jobs = batch::jobs(&args.inputs, &args.output, "gsvx", args.force)?;
    batch::run(&jobs, |job| encode_file(args, job, report))
}

/// Encodes one model.
fn encode_file(args: &Args, job: &Job, report: Reporter) -> Result<()> {
    let output = Output::open(&job.output, args.force, &[&job.input])?;
    let start = Instant::now();
    let mut lost = Lost::new();
    let look = args.lossless.then_some(&mut lost);
    let loaded = args.reading.model(&job.input, look)?;
    let (scene, input_bytes) = (loaded.scene, loaded.bytes);
    let in_input = scene.len();
    if !lost.is_empty() {
        note(format_args!(
            "warning: {}: the stream keeps the floats of the Gaussians only; it loses: {}",
            input::name(&job.input),
            lost.join(", ")
        ));
    }
    let read_seconds = start.elapsed().as_secs_f64();
    let step = Instant::now();
    let made = if args.lossless { lossless(job, &scene)? } else { lossy(args, job, scene)? };
    let encode_seconds = step.elapsed().as_secs_f64() - made.estimate_seconds;
    let (name, stdout) = (output.name(), output.is_stdout());
    output.write(|out| Ok(out.write_all(&made.encoded.bytes)?))?;

    let bytes = made.encoded.bytes.len() as u64;
    let mut human = format!(
        "{name}: {in_input} Gaussians coded as {}, {} -> {} ({:.1}x, {:.1} bits per Gaussian); {}\n\
         read {read_seconds:.2} s, encode {encode_seconds:.2} s, estimate {:.2} s",
        made.gaussians,
        megabytes(input_bytes),
        megabytes(bytes),
        input_bytes as f64 / bytes as f64,
        8.0 * bytes as f64 / made.gaussians.max(1) as f64,
        made.remarks(),
        made.estimate_seconds,
    );
    let mut json = made.json();
    if let Some(loss) = &made.loss {
        human += &format!("\n{}", loss.human());
        json["estimated_loss"] = loss.json();
        if let Some(warning) = loss.warning() {
            note(format_args!("{warning}"));
        }
    } else if made.unseen_estimate {
        human += "\nno estimate of the loss: nothing of the model shows in the pictures";
    }
    if args.web {
        let snippet = embed(&job.output);
        human += &format!("\nembed it: {snippet}");
        json["embed"] = json!(snippet);
    }
    json["output"] = json!(name);
    json["bytes"] = json!(bytes);
    json["input_bytes"] = json!(input_bytes);
    json["input_gaussians"] = json!(in_input);
    json["lost_columns"] = json!(lost);
    json["read_seconds"] = json!(read_seconds);
    json["encode_seconds"] = json!(encode_seconds);
    json["estimate_seconds"] = json!(made.estimate_seconds);
    report.say(stdout, &human, &json)?;
    match made.missed {
        Some(why) => Err(missed(format!("{name}: written, but {why}"))),
        None => Ok(()),
    }
}

/// What shows a stream in a page, by the npm package.
fn embed(output: &std::path::Path) -> String {
    let file = output.file_name().map_or("scene.gsvx".into(), |n| n.to_string_lossy());
    format!("import {{ GSVXSplats }} from 'gsvx/spark'; scene.add(new GSVXSplats('{file}'));")
}

#[derive(Default)]
struct Encoding {
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
    /// With cameras: the share of the opacity that they see, and the number of Gaussians that they do not.
    share_and_unseen: Option<(f64, usize)>,
    /// Whether --drop-unseen was asked for.
    drop_unseen: bool,
    /// How much less the stream shows than the input, and how long the estimate took.
    loss: Option<Loss>,
    estimate_seconds: f64,
    /// The loss was to be estimated, and the pictures show nothing.
    unseen_estimate: bool,
    /// Why the stream misses its target, if it does.
    missed: Option<String>,
}

impl Encoding {
    /// For a person.
    fn remarks(&self) -> String {
        let pruned = match self.pruned {
            0 => String::new(),
            n => format!("; {n} pruned"),
        };
        let outliers = match self.outliers {
            0 => String::new(),
            1 => "; 1 outlier coded exactly".into(),
            n => format!("; {n} outliers coded exactly"),
        };
        format!("{}{pruned}{outliers}{}", self.note, self.unseen())
    }

    /// What became of the Gaussians that no camera sees.
    fn unseen(&self) -> String {
        match self.share_and_unseen {
            Some(_) if self.drop_unseen => {
                format!(
                    "; {} Gaussians left out that the cameras see too little of",
                    self.encoded.left_out
                )
            }
            Some((_, n)) if n > 0 => {
                format!("; {n} Gaussians that no camera sees are kept, coarsely")
            }
            _ => String::new(),
        }
    }

    fn json(&self) -> Value {
        let parts = self.encoded.parts().into_iter().map(|(part, n)| (part.to_owned(), json!(n)));
        json!({
            "gaussians": self.gaussians,
            "quality": self.quality,
            "psnr": self.psnr,
            "encodes": self.encodes,
            "pruned": self.pruned,
            "outliers": self.outliers,
            "seen_opacity_share": self.share_and_unseen.map(|s| s.0),
            "unseen": self.share_and_unseen.map(|s| s.1),
            "left_out": self.encoded.left_out,
            "max_error": max_error::json(&self.encoded),
            "target_reached": self.missed.is_none(),
            "parts": parts.collect::<serde_json::Map<String, Value>>(),
        })
    }
}

fn lossless(job: &Job, scene: &Scene) -> Result<Encoding> {
    let encoded = gsvx::encode_lossless(scene, false).with_context(|| input::name(&job.input))?;
    let (gaussians, note) = (scene.len(), "every float bit for bit".into());
    Ok(Encoding { encoded, gaussians, note, ..Encoding::default() })
}

/// What one encode of a search makes: the stream and its number of Gaussians.
type EncodedWithCount = (Encoded, usize);

/// The coding choices at a quality.
fn options_at(args: &Args, q: f32) -> gsvx::Result<EncodeOptions> {
    let mut options = EncodeOptions::from_quality(q)?;
    options.covariance = args.covariance.unwrap_or_default();
    options.max_sh_degree = args.max_sh_degree;
    options.lod = args.lod || args.web;
    if args.web {
        options.chunk_leaves = WEB_CHUNK;
    }
    Ok(options)
}

/// Voxelizes and encodes at a quality.
fn encode_at(
    args: &Args,
    scene: &Scene,
    outliers: Option<&Scene>,
    (cameras, seen): (Option<&[Camera]>, Option<&[f32]>),
    q: f32,
) -> gsvx::Result<EncodedWithCount> {
    let _bar = progress::spinner(format!("encoding at quality {q:.1}"));
    let strategy = |importance: &[f32], seen: Seen| match (args.depth, args.j_low) {
        (Some(depth), Some(j_low)) => Ok(Strategy::paper(j_low.min(depth), depth)),
        (Some(depth), None) => Ok(Strategy::Uniform { depth }),
        (None, _) if args.drop_unseen => gsvx::default_strategy(q, importance, Seen::ByCamerasOnly),
        (None, _) => gsvx::default_strategy(q, importance, seen),
    };
    let mut options = options_at(args, q)?;
    let encoded = match (options.covariance, cameras) {
        (CovarianceMode::Vq { .. }, Some(cameras)) => {
            let Prepared { scene, voxels, importance } = gsvx::prepare(scene, strategy, seen)?;
            options.importance = Some(importance);
            options.covariance_sensitivity =
                Some(finetune::covariance_sensitivity(&scene, cameras));
            let left_out = voxels.dropped.len();
            Encoded { left_out, ..gsvx::encode_voxels(&scene, &voxels, outliers, &options)? }
        }
        _ => {
            options.importance = seen.map(<[f32]>::to_vec);
            gsvx::encode_with(scene, strategy, outliers, &options)?
        }
    };
    let gaussians = encoded.index.header.count as usize;
    Ok((encoded, gaussians))
}

/// The cameras of an encode, and what they see of each Gaussian.
struct Views {
    cameras: Option<Vec<Camera>>,
    /// Importances, one per Gaussian.
    seen: Option<Vec<f32>>,
    /// Share of the opacity that is seen, and the number of Gaussians that are not.
    share_and_unseen: Option<(f64, usize)>,
}

impl Views {
    fn of(args: &Args, scene: &Scene) -> Result<Self> {
        let Some(path) = &args.cameras else {
            return Ok(Self { cameras: None, seen: None, share_and_unseen: None });
        };
        let cameras = views::cameras(path)?;
        let seen = views::Seen::of(scene, &cameras, path)?;
        let share_and_unseen = Some((seen.share, seen.unseen()));
        let importance = match args.drop_unseen {
            true => seen.weights,
            false => gsvx::importance::with_unseen(scene, &seen.weights),
        };
        Ok(Self { cameras: Some(cameras), seen: Some(importance), share_and_unseen })
    }

    fn parts(&self) -> (Option<&[Camera]>, Option<&[f32]>) {
        (self.cameras.as_deref(), self.seen.as_deref())
    }
}

/// Leaves out the least important Gaussians. Returns their number.
fn prune(fraction: f64, scene: &mut Scene, seen: &mut Option<Vec<f32>>) -> gsvx::Result<usize> {
    if fraction == 0.0 {
        return Ok(0);
    }
    let kept = match seen {
        Some(seen) => gsvx::prune(seen, fraction)?,
        None => gsvx::prune(&gsvx::importance::without_cameras(scene), fraction)?,
    };
    let pruned = scene.len() - kept.len();
    if let Some(seen) = seen {
        *seen = kept.iter().map(|&i| seen[i]).collect();
    }
    *scene = scene.select(&kept);
    Ok(pruned)
}

fn lossy(args: &Args, job: &Job, mut scene: Scene) -> Result<Encoding> {
    let name = || input::name(&job.input);
    let mut views = Views::of(args, &scene)?;
    // Quality is measured against what came in, not against what pruning left.
    let reference = match (args.target_psnr, &views.cameras) {
        (Some(target), Some(cameras)) => Some((target, views::Reference::new(&scene, cameras)?)),
        _ => None,
    };
    let draw = || Pictures::of(&scene, views.cameras.as_deref());
    let (pictures, seconds_before) = timed(|| (!args.no_estimate).then(draw));
    let pruned = prune(args.prune, &mut scene, &mut views.seen).with_context(name)?;
    let made = match args.max_error {
        Some(bounds) => within(args, &scene, bounds).with_context(name)?,
        None => {
            let outliers = args.trim.split(&mut scene, views.seen.as_mut(), name)?;
            if let Some(cells) = gsvx::coarse_cells(&scene).with_context(name)? {
                note(format_args!(
                    "warning: {}: its parts lie so far apart that positions come in steps of {cells:.1} times the \
                     size of a typical Gaussian, which shows at any quality; encode each part apart, or use \
                     --max-error or --lossless",
                    name()
                ));
            }
            let made = coded(args, &scene, outliers.as_ref(), &views, reference.as_ref());
            Encoding { outliers: outliers.map_or(0, |o| o.len()), ..made.with_context(name)? }
        }
    };
    drop(scene);
    let compare = |pictures: Pictures| pictures.loss(&made.encoded.bytes).transpose();
    let (loss, seconds_after) = timed(|| pictures.and_then(compare).transpose());
    let loss = loss.with_context(name)?;
    Ok(Encoding {
        pruned,
        share_and_unseen: views.share_and_unseen,
        drop_unseen: args.drop_unseen,
        unseen_estimate: !args.no_estimate && loss.is_none(),
        loss,
        estimate_seconds: seconds_before + seconds_after,
        ..made
    })
}

/// What `work` returns, and how long it takes.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let made = work();
    (made, start.elapsed().as_secs_f64())
}

/// The stream that keeps the bounds of --max-error.
fn within(args: &Args, scene: &Scene, bounds: MaxError) -> gsvx::Result<Encoding> {
    let _bar = progress::spinner("encoding within the bounds".into());
    let mut options = options_at(args, gsvx::DEFAULT_QUALITY)?;
    options.max_error = Some(bounds);
    let encoded = gsvx::encode(scene, &options)?;
    let gaussians = encoded.index.header.count as usize;
    let note = max_error::human(&encoded).unwrap_or_default();
    Ok(Encoding { encoded, gaussians, note, encodes: 1, ..Encoding::default() })
}

/// The stream that the flags ask for.
fn coded(
    args: &Args,
    scene: &Scene,
    outliers: Option<&Scene>,
    views: &Views,
    reference: Option<&(f64, views::Reference)>,
) -> gsvx::Result<Encoding> {
    if let Some(bytes) = args.most_bytes() {
        return largest_below(args, scene, outliers, views, bytes);
    }
    if let Some((target, reference)) = reference {
        return smallest_above(args, scene, outliers, views, *target, reference);
    }
    let quality = args.quality();
    let (encoded, gaussians) = encode_at(args, scene, outliers, views.parts(), quality)?;
    let note = match args.preset() {
        Some(preset) => format!("preset {}, quality {quality}", preset.name),
        None => format!("quality {quality}"),
    };
    let quality = Some(quality);
    Ok(Encoding { encoded, gaussians, note, quality, encodes: 1, ..Encoding::default() })
}

/// The best stream of at most `most` bytes, or the smallest if there is none.
fn largest_below(
    args: &Args,
    scene: &Scene,
    outliers: Option<&Scene>,
    views: &Views,
    most: u64,
) -> gsvx::Result<Encoding> {
    let mut counts = Vec::new();
    let mut at = |q: f32| {
        let (encoded, gaussians) = encode_at(args, scene, outliers, views.parts(), q)?;
        counts.push((q, gaussians));
        Ok(encoded)
    };
    let (found, why) = match rate::to_bytes(most, &mut at) {
        Err(gsvx::Error::TargetTooSmall { smallest, .. }) => {
            let why = format!(
                "the target of {most} bytes is below the smallest stream of this scene, {smallest} \
                 bytes; --prune or --max-sh-degree 0 makes smaller ones"
            );
            let encoded = at(0.0)?;
            let encodes = counts.len();
            (rate::Found { encoded, quality: 0.0, encodes, measured: None }, Some(why))
        }
        found => (found?, None),
    };
    let share = 100.0 * found.encoded.bytes.len() as f64 / most as f64;
    let note = match &why {
        Some(_) => "above the target".into(),
        None => format!("{share:.1} % of the target"),
    };
    Ok(search_result(found, &counts, note, why))
}

/// The smallest stream of at least `target` dB, or the best if there is none.
fn smallest_above(
    args: &Args,
    scene: &Scene,
    outliers: Option<&Scene>,
    views: &Views,
    target: f64,
    reference: &views::Reference,
) -> gsvx::Result<Encoding> {
    let mut counts = Vec::new();
    let at = |q: f32| {
        let (encoded, gaussians) = encode_at(args, scene, outliers, views.parts(), q)?;
        counts.push((q, gaussians));
        Ok(encoded)
    };
    let measure = |encoded: &Encoded| {
        let mut options = gsvx::DecodeOptions::default();
        options.max_gaussians = Some(u64::MAX);
        Ok(reference.psnr(&gsvx::decode_with(&encoded.bytes, &options)?.scene))
    };
    let found = rate::to_measure(target, at, measure)?;
    let got = found.measured.unwrap_or(f64::NAN);
    let why = (got < target).then(|| {
        format!(
            "its renders reach {got:.2} dB, not {target:.2}: quality {} is the best there is; \
             --lossless keeps every float",
            found.quality
        )
    });
    Ok(search_result(found, &counts, format!("{got:.2} dB from the input's renders"), why))
}

fn search_result(
    found: rate::Found<Encoded>,
    counts: &[(f32, usize)],
    note: String,
    missed: Option<String>,
) -> Encoding {
    Encoding {
        gaussians: counts.iter().find(|(q, _)| *q == found.quality).map_or(0, |(_, n)| *n),
        note: format!("quality {:.1}, {note}, {} encodes", found.quality, found.encodes),
        quality: Some(found.quality),
        psnr: found.measured,
        encodes: found.encodes,
        encoded: found.encoded,
        missed,
        ..Encoding::default()
    }
}
