//! `gsvx encode`.

use crate::batch::{self, Job};
use crate::content::{CONTENT, LARGE, SceneArgs, transparent};
use crate::exit::{missed, note, usage};
use crate::format::{STREAM, is_stream_name};
use crate::info::parts;
use crate::input::{self, LoadedModel};
use crate::join::{self, ScenePart};
use crate::output::{Output, counted};
use crate::progress::Meter;
use crate::report::Reporter;
use crate::views::Origin;
use crate::{doubts, loss, max_error, scale, size, views};
use anyhow::{Result, anyhow};
use gs_model::{Camera, Format, Scene, chain};
use gsvx::{
    Aim, Choices, EncodeOptions, EncodeProgress, EncodeWarning, EncoderOutput, Leaves, MaxError,
    Measure, Missed,
};
use indicatif::DecimalBytes;
use serde_json::{Value, json};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;
use tune::{EncodeEvent, EncodeOutcome, EncodeRecipe, VisibilityCount};

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
  gsvx encode city.plan --part 3/16 -o part-3.gsvx             see gsvx plan
  gsvx encode - -o - < model.ply > scene.gsvx";

/// Heading of what most people never need.
const EXPERTS: &str = "For experts, and for comparison with the paper";

#[derive(clap::Args)]
pub(crate) struct EncodeArgs {
    #[command(flatten)]
    pub(crate) scene: SceneArgs,
    /// Best stream of at most this size: 800000, 500k, 1.5MB.
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
    if let Some(format) = Format::of_name(output).filter(|f| f.is_written()) {
        let (name, extension) = (output.display(), format.extensions[0]);
        return Err(usage(format!(
            "{name}: encode writes gsvx streams; name it .gsvx, or use gsvx convert to write .{extension}"
        )));
    }
    if let Some(part) = args.part {
        return scale::part(&args.scene, part, report);
    }
    let as_one = inputs.len() > 1 && is_stream_name(output) && !output.is_dir();
    let large = scale::is_large(inputs) && inputs.len() == 1;
    if as_one || large || room.memory.is_some() {
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
    let jobs = batch::jobs(inputs, output, STREAM, *force)?;
    batch::run(&jobs, |job| encode_file(args, job, report))
}

/// Encodes one model.
fn encode_file(args: &EncodeArgs, job: &Job, report: Reporter) -> Result<()> {
    let output = Output::open(&job.output, args.scene.force, &[&job.input])?;
    let (start, name) = (Instant::now(), input::name(&job.input));
    let reading = &args.scene.reading;
    let LoadedModel { scene, bytes: input_bytes, report: file } = match args.lossless {
        true => reading.exact_model(&job.input)?,
        false => reading.model(&job.input, true)?,
    };
    let input_gaussians = scene.len();
    let read_seconds = start.elapsed().as_secs_f64();
    let step = Instant::now();
    let (outcome, cameras) = encoded(args, &name, scene)?;
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
        remarks(args, &outcome),
        outcome.estimate_seconds,
    );
    if let Some(cameras) = &cameras {
        human += &format!("\n{}", cameras.human());
    }
    let mut json = json(&outcome);
    json["cameras"] = cameras.as_ref().map_or(Value::Null, Origin::json);
    for warning in warnings {
        note(format_args!("warning: {name}: {warning}"));
    }
    if let Some(loss) = &outcome.loss {
        human += &format!("\n{}", loss::human(loss));
        json["estimated_loss"] = loss::json(loss);
        // Where positions coincide, another warning says what helps.
        let coincident = warnings.iter().any(|w| matches!(w, EncodeWarning::Coincident(_)));
        let content = &args.scene.content;
        let warning = loss::warning(loss, content.drop_unseen, content.cameras.is_some());
        if let Some(warning) = warning.filter(|_| !coincident) {
            note(format_args!("warning: {name}: {warning}"));
        }
    }
    if args.scene.content.web {
        let snippet = embed(&job.output);
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

/// What shows a stream in a page, by the npm package.
fn embed(output: &Path) -> String {
    let file = output.file_name().map_or("scene.gsvx".into(), |n| n.to_string_lossy());
    format!("import {{ GSVXSplats }} from 'gsvx/spark'; scene.add(new GSVXSplats('{file}'));")
}

/// What is said of Gaussians that cameras see too little of, in a stream of so many.
fn unseen(count: &VisibilityCount, gaussians: u64) -> Option<String> {
    let VisibilityCount { unseen, hardly_seen, kept, .. } = *count;
    if unseen + hardly_seen == 0 {
        return None;
    }
    let these = format!("{unseen} Gaussians that no camera sees and {hardly_seen} hardly seen");
    Some(match kept {
        0 => format!("{these} are left out"),
        _ => format!(
            "{these}: {kept} of them kept, coarsely; --drop-unseen leaves them out, which saves at most about \
             {:.1} %",
            100.0 * kept.min(gaussians as usize) as f64 / gaussians.max(1) as f64
        ),
    })
}

/// For a person.
fn remarks(args: &EncodeArgs, outcome: &EncodeOutcome) -> String {
    let encoded = &outcome.output.encoded;
    let outliers = encoded.outliers();
    let mut remarks = vec![aimed(args, &outcome.output)];
    if encoded.transparent > 0 {
        remarks.push(transparent(encoded.transparent));
    }
    if encoded.pruned > 0 {
        remarks.push(format!("{} pruned", encoded.pruned));
    }
    // With bounds on errors the first remark says how many are exact.
    if outliers > 0 && encoded.max_error.is_none() {
        remarks.push(format!(
            "{} coded exactly, far from all others: {:.0} % of the bytes",
            counted(outliers, "outlier"),
            100.0 * encoded.exact_share()
        ));
    }
    let seen = outcome.seen.as_ref().filter(|_| !outcome.cameras_ignored());
    remarks.extend(seen.and_then(|seen| unseen(seen, encoded.index.header.count)));
    remarks.join("; ")
}

fn json(outcome: &EncodeOutcome) -> Value {
    let EncodeOutcome { output: EncoderOutput { encoded, measured, .. }, seen, .. } = outcome;
    let measured = |of: Measure| measured.filter(|m| m.0 == of).map(|m| m.1);
    json!({
        "gaussians": encoded.index.header.count,
        "quality": outcome.output.quality,
        "psnr": measured(Measure::Psnr),
        "ssimulacra2": measured(Measure::Ssimulacra2),
        "encodes": outcome.output.encodes,
        "transparent": encoded.transparent,
        "pruned": encoded.pruned,
        "outliers": encoded.outliers(),
        "cameras_doubted": outcome.cameras_ignored(),
        "seen_opacity_share": seen.map(|s| s.share),
        "unseen": seen.map(|s| s.unseen),
        "hardly_seen": seen.map(|s| s.hardly_seen),
        "hardly_seen_kept": seen.map(|s| s.kept),
        "left_out": encoded.left_out,
        "max_error": max_error::json(encoded),
        "target_reached": outcome.output.missed.is_none(),
        "parts": parts(&encoded.parts()),
        "estimate_seconds": outcome.estimate_seconds,
    })
}

/// The stream that the flags ask for, and where the cameras are from.
fn encoded(args: &EncodeArgs, name: &str, scene: Scene) -> Result<(EncodeOutcome, Option<Origin>)> {
    let path = args.scene.content.cameras.as_deref();
    let (photos, placed) = views::with_photos(path, &scene)?;
    let (cameras, origin) = placed.map(|p| (p.cameras, p.origin)).unzip();
    let recipe = EncodeRecipe {
        aim: args.aim(),
        options: args.options(),
        cameras: cameras.as_deref(),
        photos: &photos,
        estimate: !args.no_estimate,
    };
    let path = path.unwrap_or(Path::new(""));
    let outcome = tune::encode(scene, &recipe, meters(recipe.cameras))
        .map_err(|error| explained(error, path, name))?;
    outcome.doubts.iter().for_each(|doubt| doubts::warn(path, doubt));
    Ok((outcome, origin.flatten()))
}

/// Why a model, which is called `name`, was not encoded. `cameras` names the cameras.
pub(crate) fn explained(error: tune::Error, cameras: &Path, name: &str) -> anyhow::Error {
    match error {
        tune::Error::OtherPhotos { .. } => doubts::refused(cameras, &error),
        tune::Error::NothingSeen => anyhow!("{}: {error}", cameras.display()),
        other => anyhow::Error::new(other).context(name.to_owned()),
    }
}

/// Shows how far an encode is.
pub(crate) fn meters(
    cameras: Option<&[Camera]>,
) -> impl FnMut(EncodeEvent<'_>) -> ControlFlow<()> + use<> {
    let mut bar = cameras.map(|cameras| Meter::new("importance", cameras.len()));
    move |event| {
        let (what, done, all) = match event {
            EncodeEvent::Visibility(done, all) => ("importance", done, all),
            EncodeEvent::References(done, all) => ("renders of the input", done, all),
            EncodeEvent::Encoder(event) => {
                bar = None;
                if let EncodeProgress::Begins(quality) = event {
                    bar = Some(Meter::spinner(format!("encoding at quality {quality:.1}")));
                }
                return ControlFlow::Continue(());
            }
        };
        bar.get_or_insert_with(|| Meter::new(what, all)).set(done as u64, String::new());
        if done == all {
            bar = None;
        }
        ControlFlow::Continue(())
    }
}

/// What the stream aimed for, and how near it came.
fn aimed(args: &EncodeArgs, output: &EncoderOutput) -> String {
    let Some(quality) = output.quality else {
        let bounds = max_error::human(&output.encoded);
        return bounds.unwrap_or_else(|| "every float bit for bit".into());
    };
    let reached = match (output.missed, output.measured) {
        (Some(Missed::Bytes { .. }), _) => "above the target".into(),
        (_, Some((measure, value))) => format!("{} from the input's renders", measure.words(value)),
        (None, None) if output.encodes > 1 || args.most_bytes().is_some() => {
            let most = args.most_bytes().unwrap_or_default().max(1);
            let share = 100.0 * output.encoded.bytes.len() as f64 / most as f64;
            format!("{share:.1} % of the target")
        }
        _ => {
            return match args.scene.content.preset() {
                Some(preset) => format!("preset {}, quality {quality}", preset.name),
                None => format!("quality {quality}"),
            };
        }
    };
    format!("quality {quality:.1}, {reached}, {} encodes", output.encodes)
}
