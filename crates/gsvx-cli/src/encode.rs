//! `gsvx encode`.

use crate::batch::{self, Job};
use crate::exit::{missed, note, usage};
use crate::format::Extension;
use crate::input::Reading;
use crate::join::{self, Part};
use crate::loss::{Loss, Pictures};
use crate::lost_columns::Lost;
use crate::output::{Output, counted, megabytes, short};
use crate::preset::{self, Preset};
use crate::progress::{self, Steps};
use crate::report::Reporter;
use crate::scale::{self, Room};
use crate::{coincident, input, max_error, plan, size, views};
use anyhow::{Context, Result};
use finetune::References;
use gs_model::{Camera, Scene};
use gsvx::{EncodeOptions, Encoded, Kind, Leaves, MaxError, rate};
use serde_json::{Value, json};
use std::convert::Infallible;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::Instant;

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
  gsvx encode tiles/*.ply -o city.gsvx --memory 1G             several models as one scene
  gsvx encode city.plan --part 3/16 -o part-3.gsvx             see gsvx plan
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
    /// The trained models, of any format that gsvx convert reads; `-` for standard input. With --part: the plan.
    #[arg(required = true, value_name = "MODEL")]
    inputs: Vec<PathBuf>,
    /// The stream to write; `-` for standard output. A folder for one stream per model; with a name in .gsvx
    /// several models become one scene.
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
          conflicts_with_all = ["cameras", "depth", "web"])]
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
    #[arg(long, conflicts_with_all = ["rate", "target_mbit", "depth", "cameras",
          "max_sh_degree", "prune", "lod", "web", "drop_unseen"])]
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

    #[command(flatten)]
    room: Room,
    /// Encode the K-th of N parts of a plan; the plan stands in the place of the model, and says the quality.
    #[arg(long, value_name = "K/N", value_parser = join::part, hide_short_help = true,
          help_heading = "Scenes larger than memory")]
    part: Option<Part>,
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

    /// The coding choices, without what cameras see.
    fn options(&self) -> gsvx::Result<EncodeOptions> {
        let mut options = EncodeOptions::from_quality(self.quality())?;
        options.max_error = self.max_error;
        options.max_sh_degree = self.max_sh_degree;
        options.prune = self.prune;
        options.drop_unseen = self.drop_unseen;
        options.lod = self.lod || self.web;
        if self.web {
            options.chunk_leaves = WEB_CHUNK;
        }
        options.leaves = match (self.depth, self.j_low) {
            (Some(depth), Some(j_low)) => Leaves::Paper { j_low: j_low.min(depth), j_high: depth },
            (Some(depth), None) => Leaves::Uniform { depth },
            _ => Leaves::RateDistortion,
        };
        Ok(options)
    }

    /// A flag that needs the whole scene in memory.
    fn not_at_scale(&self) -> Option<&'static str> {
        let flags = [
            ("--lossless", self.lossless),
            ("--max-error", self.max_error.is_some()),
            ("--target-psnr", self.target_psnr.is_some()),
            ("--target-bytes", self.target_bytes.is_some()),
            ("--target-mbit", self.target_mbit.is_some()),
            ("--prune", self.prune > 0.0),
            ("--web", self.web),
            ("--depth", self.depth.is_some()),
        ];
        flags.iter().find(|(_, given)| *given).map(|(flag, _)| *flag)
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

/// Encodes the models.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    if let Extension::Model(format) = Extension::of(&args.output) {
        let (name, extension) = (args.output.display(), format.extension());
        return Err(usage(format!(
            "{name}: encode writes gsvx streams; name it .gsvx, or use gsvx convert to write .{extension}"
        )));
    }
    if let Some(part) = args.part {
        return encode_part(args, part, report);
    }
    let as_one = args.inputs.len() > 1 && is_stream_name(&args.output);
    let large = scale::is_large(&args.inputs) && args.inputs.len() == 1;
    match args.not_at_scale() {
        Some(flag) if as_one || args.room.memory.is_some() => {
            let why = if as_one { "several models as one scene" } else { "--memory" };
            return Err(usage(format!("{flag} does not go with {why}")));
        }
        None if as_one || large || args.room.memory.is_some() => return encode_large(args, report),
        _ => {}
    }
    let jobs = batch::jobs(&args.inputs, &args.output, "gsvx", args.force)?;
    batch::run(&jobs, |job| encode_file(args, job, report))
}

/// Whether a path is the name of a stream, and no folder.
fn is_stream_name(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gsvx")) && !path.is_dir()
}

/// Encodes a part of a plan.
fn encode_part(args: &Args, part: Part, report: Reporter) -> Result<()> {
    let planned = [("--cameras", args.cameras.is_some()), ("--lod", args.lod)];
    let planned = planned.iter().find(|(_, given)| *given).map(|(flag, _)| *flag);
    if let Some(flag) = args.not_at_scale().or(planned) {
        return Err(usage(format!("{flag} does not go with --part: the plan says how to encode")));
    }
    let [plan] = &args.inputs[..] else {
        return Err(usage("--part: name one plan, which gsvx plan has made"));
    };
    scale::part(plan, part, (&args.output, args.force), &args.room, report)
}

/// Encodes models as one scene, within a bound on memory.
fn encode_large(args: &Args, report: Reporter) -> Result<()> {
    let cameras = args.cameras.as_deref();
    let job = scale::Job {
        inputs: &args.inputs,
        reading: &args.reading,
        choices: plan::choices(
            args.quality(),
            args.max_sh_degree,
            plan::seen(cameras, args.drop_unseen),
            args.lod,
        ),
        cameras,
        output: &args.output,
        force: args.force,
        room: &args.room,
    };
    scale::encode(&job, report)
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
        "{name}: {} coded as {}, {} -> {} ({:.1}x, {:.1} bits per Gaussian); {}\n\
         read {read_seconds:.2} s, encode {encode_seconds:.2} s, estimate {:.2} s",
        counted(in_input as u64, "Gaussian"),
        made.gaussians(),
        megabytes(input_bytes),
        megabytes(bytes),
        input_bytes as f64 / bytes as f64,
        8.0 * bytes as f64 / made.gaussians().max(1) as f64,
        made.remarks(),
        made.estimate_seconds,
    );
    let mut json = made.json();
    if let Some(loss) = &made.loss {
        human += &format!("\n{}", loss.human());
        json["estimated_loss"] = loss.json();
        // Where positions coincide, another warning says what helps.
        if let Some(warning) = loss.warning().filter(|_| made.coincident == 0) {
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
fn embed(output: &Path) -> String {
    let file = output.file_name().map_or("scene.gsvx".into(), |n| n.to_string_lossy());
    format!("import {{ GSVXSplats }} from 'gsvx/spark'; scene.add(new GSVXSplats('{file}'));")
}

/// A stream, and what is to be said of it.
#[derive(Default)]
struct Made {
    encoded: Encoded,
    note: String,
    quality: Option<f32>,
    /// Against renders of the input, where it was measured.
    psnr: Option<f64>,
    encodes: usize,
    /// With cameras: what they see.
    seen: Option<SeenShare>,
    /// How much less the stream shows than the input, and how long the estimate took.
    loss: Option<Loss>,
    estimate_seconds: f64,
    /// The loss was to be estimated, and the pictures show nothing.
    unseen_estimate: bool,
    /// Gaussians that share their positions, where merging them shows.
    coincident: u64,
    /// Why the stream misses its target, if it does.
    missed: Option<String>,
}

/// How much of a model cameras see.
#[derive(Clone, Copy)]
struct SeenShare {
    of_opacity: f64,
    unseen: usize,
    /// Whether --drop-unseen was asked for.
    drop_unseen: bool,
}

impl Made {
    fn gaussians(&self) -> u64 {
        self.encoded.index.header.count
    }

    /// Gaussians that are coded exactly, where others are not.
    fn outliers(&self) -> usize {
        let exact = self.encoded.exact();
        if exact as u64 == self.gaussians() { 0 } else { exact }
    }

    /// Share of the bytes that Gaussians take that are coded exactly, in percent.
    fn exact_share(&self) -> f64 {
        let chunks = self.encoded.index.chunks.iter().filter(|c| c.kind == Kind::Exact);
        let bytes: u64 = chunks.flat_map(|c| &c.layers).map(|l| l.len).sum();
        100.0 * bytes as f64 / self.encoded.bytes.len().max(1) as f64
    }

    /// For a person.
    fn remarks(&self) -> String {
        let pruned = match self.encoded.pruned {
            0 => String::new(),
            n => format!("; {n} pruned"),
        };
        // With bounds on errors the note says how many are exact.
        let outliers = match self.outliers() {
            0 => String::new(),
            _ if self.encoded.max_error.is_some() => String::new(),
            n => format!(
                "; {} coded exactly, far from all others: {:.0} % of the bytes",
                counted(n as u64, "outlier"),
                self.exact_share()
            ),
        };
        format!("{}{pruned}{outliers}{}", self.note, self.unseen())
    }

    /// What became of the Gaussians that no camera sees.
    fn unseen(&self) -> String {
        match self.seen {
            Some(SeenShare { drop_unseen: true, .. }) => {
                format!(
                    "; {} Gaussians left out that the cameras see too little of",
                    self.encoded.left_out
                )
            }
            Some(SeenShare { unseen, .. }) if unseen > 0 => {
                format!("; {unseen} Gaussians that no camera sees are kept, coarsely")
            }
            _ => String::new(),
        }
    }

    fn json(&self) -> Value {
        let parts = self.encoded.parts().into_iter().map(|(part, n)| (part.to_owned(), json!(n)));
        json!({
            "gaussians": self.gaussians(),
            "quality": self.quality,
            "psnr": self.psnr,
            "encodes": self.encodes,
            "pruned": self.encoded.pruned,
            "outliers": self.outliers(),
            "seen_opacity_share": self.seen.map(|s| s.of_opacity),
            "unseen": self.seen.map(|s| s.unseen),
            "left_out": self.encoded.left_out,
            "max_error": max_error::json(&self.encoded),
            "target_reached": self.missed.is_none(),
            "parts": parts.collect::<serde_json::Map<String, Value>>(),
        })
    }
}

fn lossless(job: &Job, scene: &Scene) -> Result<Made> {
    let encoded = gsvx::encode_lossless(scene, false).with_context(|| input::name(&job.input))?;
    Ok(Made { encoded, note: "every float bit for bit".into(), ..Made::default() })
}

fn lossy(args: &Args, job: &Job, scene: Scene) -> Result<Made> {
    let name = || input::name(&job.input);
    let mut options = args.options()?;
    let mut seen_share = None;
    let mut cameras = None;
    if let Some(path) = &args.cameras {
        let training = views::cameras(path)?;
        let seen = views::seen(&scene, &training, path)?;
        let (of_opacity, unseen) = (seen.share, seen.unseen());
        seen_share = Some(SeenShare { of_opacity, unseen, drop_unseen: args.drop_unseen });
        options.importance = Some(seen.weights);
        cameras = Some(training);
    }
    // The loss is measured against the input before pruning.
    let target = args.target_psnr.zip(cameras.as_ref());
    let target = target.map(|(db, cameras)| (db, references(&scene, cameras)));
    let draw = || Pictures::of(&scene, cameras.as_deref());
    let (pictures, seconds_before) = timed(|| (!args.no_estimate).then(draw));
    let made = coded(args, &scene, &options, target.as_ref()).with_context(name)?;
    let merged = (scene.len() as u64).saturating_sub(made.gaussians());
    let merged_many = made.encoded.max_error.is_none() && merged > scene.len() as u64 / 20;
    let coincident = if merged_many { coincident::count(&scene) } else { 0 };
    drop(scene);
    let compare = |pictures: Pictures| pictures.loss(&made.encoded.bytes).transpose();
    let (loss, seconds_after) = timed(|| pictures.and_then(compare).transpose());
    let loss = loss.with_context(name)?;
    if let Some(coarse) = made.encoded.coarse_cells {
        note(format_args!(
            "warning: {}: its parts lie so far apart, or differ so much in size, that positions come in steps of \
             {} times the size of its {} Gaussians, which shows at any quality; encode each part apart, or use \
             --max-error or --lossless",
            name(),
            short(coarse.cells),
            coarse.which()
        ));
    }
    let coincident = if coincident > merged / 2 { coincident } else { 0 };
    if coincident > 0 {
        note(format_args!(
            "warning: {}: {} share their position with another; a leaf of the octree holds one Gaussian, so they \
             are merged at any quality; --max-error or --lossless keeps each",
            name(),
            counted(coincident, "Gaussian"),
        ));
    }
    if made.encoded.max_error.is_none() && made.outliers() as u64 > made.gaussians() / 10 {
        note(format_args!(
            "warning: {}: {} of the stream's {} lie so far from the others that the octree does not reach them; they are coded \
             exactly, which takes {:.0} % of the bytes; encode each part apart for a smaller size",
            name(),
            made.outliers(),
            counted(made.gaussians(), "Gaussian"),
            made.exact_share()
        ));
    }
    Ok(Made {
        seen: seen_share,
        unseen_estimate: !args.no_estimate && loss.is_none(),
        loss,
        estimate_seconds: seconds_before + seconds_after,
        coincident,
        ..made
    })
}

/// Renders of the input.
fn references(scene: &Scene, cameras: &[Camera]) -> References {
    let mut bar: Option<Steps> = None;
    let Ok(references) = References::new(scene, cameras, |_, all| {
        bar.get_or_insert_with(|| Steps::new("renders of the input", all as u64)).inc();
        Ok::<_, Infallible>(())
    });
    references
}

/// What `work` returns, and how long it takes.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let made = work();
    (made, start.elapsed().as_secs_f64())
}

/// The stream that the flags ask for.
fn coded(
    args: &Args,
    scene: &Scene,
    options: &EncodeOptions,
    target: Option<&(f64, References)>,
) -> gsvx::Result<Made> {
    let at = |quality: f32| {
        let _bar = progress::spinner(format!("encoding at quality {quality:.1}"));
        gsvx::encode(scene, &options.at_quality(quality)?)
    };
    if let Some(most) = args.most_bytes() {
        let found = rate::to_bytes(most, at)?;
        let share = 100.0 * found.encoded.bytes.len() as f64 / most as f64;
        let (note, missed) = match found.reached {
            true => (format!("{share:.1} % of the target"), None),
            false => ("above the target".into(), Some(too_small(most, &found.encoded))),
        };
        return Ok(search_result(found, &note, missed));
    }
    if let Some((db, references)) = target {
        let found = rate::to_measure(*db, at, |encoded| psnr(references, encoded))?;
        let got = found.measured.unwrap_or(f64::NAN);
        let missed = (!found.reached).then(|| {
            format!(
                "its renders reach {got:.2} dB, not {db:.2}: quality {} is the best there is; \
                 --lossless keeps every float",
                found.quality
            )
        });
        return Ok(search_result(found, &format!("{got:.2} dB from the input's renders"), missed));
    }
    if options.max_error.is_some() {
        let _bar = progress::spinner("encoding within the bounds".into());
        let encoded = gsvx::encode(scene, options)?;
        let note = max_error::human(&encoded).unwrap_or_default();
        return Ok(Made { encoded, note, encodes: 1, ..Made::default() });
    }
    let encoded = at(options.quality)?;
    let quality = options.quality;
    let note = match args.preset() {
        Some(preset) => format!("preset {}, quality {quality}", preset.name),
        None => format!("quality {quality}"),
    };
    Ok(Made { encoded, note, quality: Some(quality), encodes: 1, ..Made::default() })
}

/// Why a stream is above its target.
fn too_small(most: u64, smallest: &Encoded) -> String {
    format!(
        "the target of {most} bytes is below the smallest stream of this scene, {} bytes; --prune or \
         --max-sh-degree 0 makes smaller ones",
        smallest.bytes.len()
    )
}

/// Mean PSNR of a stream's renders, dB.
fn psnr(references: &References, encoded: &Encoded) -> gsvx::Result<f64> {
    let mut options = gsvx::DecodeOptions::default();
    options.max_gaussians = Some(u64::MAX);
    Ok(references.psnr(&gsvx::decode_with(&encoded.bytes, &options)?.scene))
}

fn search_result(found: rate::Found<Encoded>, note: &str, missed: Option<String>) -> Made {
    Made {
        note: format!("quality {:.1}, {note}, {} encodes", found.quality, found.encodes),
        quality: Some(found.quality),
        psnr: found.measured,
        encodes: found.encodes,
        encoded: found.encoded,
        missed,
        ..Made::default()
    }
}
