//! `gsvx encode`.

mod by_cameras;
mod summary;

use crate::batch::{self, Job};
use crate::commands::join::{self, ScenePart};
use crate::commands::sequence::{self, EncodeTask};
use crate::content::{CONTENT, LARGE, SceneArgs};
use crate::exit::{missed, note, usage};
use crate::format::{self, STREAM, is_stream_name};
use crate::frame_source::{EncodeFrames, are_numbered};
use crate::input::{self, LoadedModel};
use crate::output::{Output, counted};
use crate::report::Reporter;
use crate::views::Origin;
use crate::{loss, max_error, scale, size};
use anyhow::Result;
pub(crate) use by_cameras::{explained, meters};
use gs_model::chain;
use gsvx::{
    Aim, Choices, EncodeOptions, EncodeWarning, EncoderOutput, Leaves, MaxError, Measure,
    SequenceOptions,
};
use indicatif::DecimalBytes;
use serde_json::{Value, json};
use std::time::Instant;
use tune::EncodeRecipe;

pub(crate) const MORE: &str = "gsvx encode --help shows all flags, and examples.";

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
  gsvx encode frames/ -o clip.gsvx --fps 30                    a sequence
  gsvx encode frames/ -o clip.gsvx --fps 30 --target-bytes 1MB   at most 1 MB per second
  gsvx encode spacetime.ply -o clip.gsvx --fps 30 --frames 50    Gaussians that move by formulas
  gsvx encode city.plan --part 3/16 -o part-3.gsvx             see gsvx plan
  gsvx encode - -o - < model.ply > scene.gsvx";

/// Heading of what most people never need.
const EXPERTS: &str = "For experts, and for comparison with the paper";

#[derive(clap::Args)]
pub(crate) struct EncodeArgs {
    #[command(flatten)]
    pub(crate) scene: SceneArgs,
    /// Best stream of at most this size: 800000, 500k, 1.5MB. With --fps, of a second of the sequence.
    #[arg(long, value_name = "SIZE", group = "rate", value_parser = size::bytes)]
    target_bytes: Option<u64>,
    /// Smallest stream whose renders reach this PSNR, in dB; needs --cameras.
    ///
    /// The PSNR is that of renders of the stream against renders of the input.
    #[arg(long, value_name = "DB", group = "rate", requires = "cameras", value_parser = finite)]
    target_psnr: Option<f64>,
    /// Smallest stream whose renders reach this SSIMULACRA2; needs --cameras.
    ///
    /// 90: no difference is seen side by side at a normal distance. 70: high quality. 50: medium. It is that of renders of
    /// the stream against renders of the input.
    #[arg(long, value_name = "SCORE", group = "rate", requires = "cameras", value_parser = score,
          hide_short_help = true)]
    target_ssimulacra2: Option<f64>,
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
    /// Keep every float of the Gaussians bit for bit, infinities and NaN too.
    ///
    /// Their order changes. Other columns of a PLY, such as normals, are not kept: a warning names
    /// those that are not zero.
    #[arg(long, conflicts_with_all = ["rate", "target_mbit", "depth", "cameras",
          "max_sh_degree", "prune", "lod", "web", "drop_unseen"])]
    lossless: bool,
    /// Do not tell the loss: less time and memory without --cameras. The stream is the same.
    #[arg(long, hide_short_help = true)]
    no_estimate: bool,
    /// Leave out this fraction of the Gaussians first, the least important: those that --cameras
    /// see least, else those of least opacity times size.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0, value_parser = fraction,
          hide_short_help = true, help_heading = CONTENT)]
    prune: f64,
    /// The target size in megabits (10^6 bits).
    #[arg(long, value_name = "MBIT", group = "rate", value_parser = size::positive,
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
    /// Encode the models as the frames of a sequence, so many per second. A folder stands for the models in it.
    ///
    /// Frames go by the last number in their names. Where they have as many Gaussians as each other, a Gaussian is the
    /// same in all of them.
    #[arg(long, value_name = "FPS", value_parser = fps, hide_short_help = true, help_heading = sequence::HEADING,
          conflicts_with_all = ["target_psnr", "target_ssimulacra2", "target_mbit", "max_error",
          "lossless", "cameras", "lod", "web", "memory", "part"])]
    fps: Option<f32>,
    /// With --fps: most frames that are coded together, 1 to 256. More make a smaller sequence, fewer a faster seek.
    #[arg(long, value_name = "FRAMES", requires = "fps", default_value_t = 60, hide_short_help = true,
          value_parser = clap::value_parser!(u16).range(1..=256), help_heading = sequence::HEADING)]
    group: u16,
    /// With --fps and a PLY of SpaceTime Gaussians (lite) or FreeTimeGS: the number of frames.
    ///
    /// Its Gaussians are evaluated at each frame. [default: what the file says]
    #[arg(long, value_name = "FRAMES", requires = "fps", value_parser = clap::value_parser!(u32).range(2..),
          hide_short_help = true, help_heading = sequence::HEADING)]
    frames: Option<u32>,
    /// Encode the K-th of N parts of a plan; the plan stands in the place of the model, and holds all choices.
    #[arg(long, value_name = "K/N", value_parser = join::part, hide_short_help = true,
          conflicts_with_all = ["rate", "lossless", "prune", "depth", "cameras", "lod", "web", "max_sh_degree",
          "drop_invalid", "from"],
          help_heading = LARGE)]
    part: Option<ScenePart>,
}

impl EncodeArgs {
    /// The greatest number of bytes, if there is one.
    fn most_bytes(&self) -> Option<u64> {
        self.target_mbit.map(|mbit| (mbit * 1e6 / 8.0) as u64).or(self.target_bytes)
    }

    /// What the stream aims for.
    fn aim(&self) -> Aim {
        let alike =
            |measure, target: Option<f64>| target.map(|target| Aim::Alike { measure, target });
        let psnr = alike(Measure::Psnr, self.target_psnr);
        let alike = psnr.or(alike(Measure::Ssimulacra2, self.target_ssimulacra2));
        let other =
            self.most_bytes().map(Aim::Bytes).or(alike).or(self.max_error.map(Aim::MaxError));
        match self.lossless {
            true => Aim::Lossless,
            false => other.unwrap_or(Aim::Quality(self.scene.content.quality())),
        }
    }

    /// What is kept, and the layout of the stream.
    fn options(&self) -> EncodeOptions {
        let mut options = self.scene.content.options();
        options.prepare.prune = self.prune;
        options.prepare.leaves = Leaves::of_depths(self.depth, self.j_low);
        options
    }

    /// The choices of a scene larger than memory, where the flags go with that.
    fn choices(&self) -> gsvx::Result<Choices> {
        let by_cameras = self.scene.content.cameras.is_some();
        Choices::of(self.aim(), &self.options(), by_cameras)
    }
}

fn fraction(text: &str) -> Result<f64, String> {
    let value = text.parse().map_err(|_| "use a fraction such as 0.2".to_owned())?;
    gsvx::prune(&[], value).map_err(|e| e.to_string())?;
    Ok(value)
}

/// Frames per second on the command line.
fn fps(text: &str) -> Result<f32, String> {
    let fits = |v: &f64| (0.001..=1000.0).contains(v);
    size::number(text, fits, "use a number from 0.001 to 1000").map(|v| v as f32)
}

/// A number of dB on the command line.
pub(crate) fn finite(text: &str) -> Result<f64, String> {
    size::number(text, |v| v.is_finite(), "use a number of dB")
}

/// An SSIMULACRA2 on the command line.
fn score(text: &str) -> Result<f64, String> {
    size::number(text, |v| *v <= 100.0, "use a number up to 100")
}

/// Encodes the models.
pub(crate) fn run(args: &EncodeArgs, report: Reporter) -> Result<()> {
    let SceneArgs { inputs, output, room, force, .. } = &args.scene;
    format::check_stream_name(output)?;
    let mut models = inputs.clone();
    if let Some(fps) = args.fps {
        let frames = EncodeFrames::open(inputs, &args.scene.reading, args.frames)?;
        if frames.len() > 1 {
            let quality = args.scene.content.quality();
            let (group, encode) = (args.group.into(), args.options());
            let options = SequenceOptions { fps, quality, group, encode };
            let (bytes_per_second, estimate) = (args.target_bytes, !args.no_estimate);
            let encoding = EncodeTask { options, bytes_per_second, estimate };
            return sequence::encode_frames(&args.scene, &frames, &encoding, report);
        }
        models = frames.paths().to_vec();
        note(format_args!("note: one frame is no sequence; it becomes a static stream"));
    }
    if let Some(part) = args.part {
        return scale::part(&args.scene, part, report);
    }
    let as_one = inputs.len() > 1 && is_stream_name(output) && !output.is_dir();
    if args.fps.is_none() && as_one && are_numbered(inputs) {
        note(format_args!(
            "note: {} numbered models become one scene; pass --fps 30 to make them frames of a sequence",
            inputs.len()
        ));
    }
    let large = scale::is_large(inputs) && inputs.len() == 1;
    if args.fps.is_none() && (as_one || large || room.memory.is_some()) {
        match args.choices() {
            Ok(choices) => return scale::encode(&args.scene, choices, report),
            Err(why) if as_one => {
                return Err(usage(format!("several models as one scene: {}", chain(&why))));
            }
            Err(why) if room.memory.is_some() => {
                return Err(usage(format!("--memory: {}", chain(&why))));
            }
            // Without the flag the scene is encoded in memory, which may suffice.
            Err(_) => {}
        }
    }
    let jobs = batch::jobs(&models, output, STREAM, *force)?;
    batch::run(&jobs, |job| encode_file(args, job, report))
}

/// Encodes one model.
fn encode_file(args: &EncodeArgs, job: &Job, report: Reporter) -> Result<()> {
    let SceneArgs { content, reading, force, .. } = &args.scene;
    let recipe = EncodeRecipe {
        aim: args.aim(),
        options: args.options(),
        estimate: !args.no_estimate,
        ..EncodeRecipe::default()
    };
    let (most_bytes, preset) = (args.most_bytes(), content.preset());
    let output = Output::open(&job.output, *force, &[&job.input])?;
    let (start, name) = (Instant::now(), input::name(&job.input));
    let LoadedModel { scene, bytes: input_bytes, report: file } = match args.lossless {
        true => reading.exact_model(&job.input)?,
        false => reading.model(&job.input, true)?,
    };
    let input_gaussians = scene.len();
    let read_seconds = start.elapsed().as_secs_f64();
    let step = Instant::now();
    let cameras = content.cameras.as_deref();
    let (outcome, cameras) = by_cameras::encoded(scene, &name, cameras, recipe)?;
    let encode_seconds = step.elapsed().as_secs_f64() - outcome.estimate_seconds;
    let EncoderOutput { encoded, warnings, missed: why, .. } = &outcome.output;
    let written = output.write(|out| Ok(out.write_all(&encoded.bytes)?))?;
    let (bytes, gaussians) = (written.bytes, encoded.index.header.count);
    let mut human = format!(
        "{} coded as {gaussians}, {} -> {} ({:.1}x, {:.1} bits per Gaussian); {}\n\
         read {read_seconds:.2} s, encode {encode_seconds:.2} s, estimate {:.2} s",
        counted(input_gaussians, "Gaussian"),
        DecimalBytes(input_bytes),
        DecimalBytes(bytes),
        input_bytes as f64 / bytes as f64,
        8.0 * bytes as f64 / gaussians.max(1) as f64,
        summary::remarks(&outcome, most_bytes, preset),
        outcome.estimate_seconds,
    );
    if let Some(cameras) = &cameras {
        human += &format!("\n{}", cameras.human());
    }
    let mut json = summary::json(&outcome);
    json["cameras"] = cameras.as_ref().map_or(Value::Null, Origin::json);
    for warning in warnings {
        note(format_args!("warning: {name}: {warning}"));
    }
    if let Some(loss) = &outcome.loss {
        human += &format!("\n{}", loss::human(loss));
        json["estimated_loss"] = loss::json(loss);
        // Where positions coincide, another warning says what helps.
        let coincident = warnings.iter().any(|w| matches!(w, EncodeWarning::Coincident(_)));
        let warning = loss::warning(loss, content.drop_unseen, content.cameras.is_some());
        if let Some(warning) = warning.filter(|_| !coincident) {
            note(format_args!("warning: {name}: {warning}"));
        }
    }
    if content.web {
        let snippet = summary::embed(&job.output);
        human += &format!("\nembed it: {snippet}");
        json["embed"] = json!(snippet);
    }
    json["bytes"] = json!(bytes);
    json["input_bytes"] = json!(input_bytes);
    json["input_gaussians"] = json!(input_gaussians);
    json["notes"] = json!(file.sentences());
    json["read_seconds"] = json!(read_seconds);
    json["encode_seconds"] = json!(encode_seconds);
    report.wrote(&written, &human, json)?;
    match why {
        Some(why) => Err(missed(format!("{}: written, but {why}", written.name))),
        None => Ok(()),
    }
}
