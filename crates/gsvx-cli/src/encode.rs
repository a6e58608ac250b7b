//! `gsvx encode`.

use crate::batch::{self, Job};
use crate::content::{CONTENT, LARGE, SceneArgs};
use crate::exit::{missed, note, usage};
use crate::format::{STREAM, is_stream_name};
use crate::info::parts;
use crate::input::{self, Loaded};
use crate::join::{self, ScenePart};
use crate::output::{Output, counted};
use crate::progress::Meter;
use crate::report::Reporter;
use crate::views::{Origin, Placed};
use crate::{loss, max_error, photos, scale, size, views};
use anyhow::{Context, Result};
use finetune::{LossEstimate, References};
use gs_model::{Camera, Format, Scene, chain};
use gsvx::importance::with_unseen;
use gsvx::{
    Aim, Choices, EncodeProgress, EncodeWarning, Encoder, LEFT_OUT, Leaves, Made, MaxError,
    Measure, Missed,
};
use indicatif::DecimalBytes;
use serde_json::{Value, json};
use std::convert::Infallible;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;
use tune::Judged;

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

    /// What its renders are measured by, and the value that they shall reach.
    fn likeness(&self) -> Option<(Measure, f64)> {
        let psnr = self.target_psnr.map(|target| (Measure::Psnr, target));
        psnr.or(self.target_ssimulacra2.map(|target| (Measure::Ssimulacra2, target)))
    }

    /// What the stream aims for; `alike` is [`Self::likeness`] as an aim.
    fn aim<'a>(&self, alike: Option<Aim<'a>>) -> Aim<'a> {
        match (self.most_bytes(), alike, self.max_error) {
            _ if self.lossless => Aim::Lossless,
            (Some(bytes), ..) => Aim::Bytes(bytes),
            (_, Some(alike), _) => alike,
            (.., Some(bounds)) => Aim::MaxError(bounds),
            _ => Aim::Quality(self.scene.content.quality()),
        }
    }

    /// An encoder that does what the flags ask for.
    fn encoder<'a>(&self, aim: Aim<'a>) -> Encoder<'a> {
        let mut encoder = self.scene.content.encoder(aim);
        encoder.options.prune = self.prune;
        encoder.options.leaves = match (self.depth, self.j_low) {
            (Some(depth), Some(j_low)) => Leaves::Paper { j_low: j_low.min(depth), j_high: depth },
            (Some(depth), None) => Leaves::Uniform { depth },
            _ => Leaves::RateDistortion,
        };
        encoder
    }

    /// The choices of a scene larger than memory, where the flags go with that.
    fn choices(&self) -> gsvx::Result<Choices> {
        let value = Box::new(|_: &Scene| f64::NAN);
        let alike = |(measure, target)| Aim::Alike { measure, target, value };
        self.encoder(self.aim(self.likeness().map(alike)))
            .choices(self.scene.content.cameras.is_some())
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
            // The machine may have the memory after all.
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
    let Loaded { scene, bytes: input_bytes, report: file } = match args.lossless {
        true => reading.exact_model(&job.input)?,
        false => reading.model(&job.input, true)?,
    };
    let input_gaussians = scene.len();
    let read_seconds = start.elapsed().as_secs_f64();
    let step = Instant::now();
    let done = encoded(args, &name, scene)?;
    let encode_seconds = step.elapsed().as_secs_f64() - done.estimate_seconds;
    let Made { encoded, warnings, .. } = &done.made;
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
        done.remarks(),
        done.estimate_seconds,
    );
    if let Some(cameras) = &done.cameras {
        human += &format!("\n{}", cameras.human());
    }
    let mut json = done.json();
    for warning in warnings {
        note(format_args!("warning: {name}: {warning}"));
    }
    if let Some(loss) = &done.loss {
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
    match done.made.missed {
        Some(why) => Err(missed(format!("{}: written, but {why}", written.name))),
        None => Ok(()),
    }
}

/// What shows a stream in a page, by the npm package.
fn embed(output: &Path) -> String {
    let file = output.file_name().map_or("scene.gsvx".into(), |n| n.to_string_lossy());
    format!("import {{ GSVXSplats }} from 'gsvx/spark'; scene.add(new GSVXSplats('{file}'));")
}

/// A stream, and what is to be said of it.
struct Done {
    made: Made,
    /// What the stream aimed for, and how near it came.
    note: String,
    /// With cameras: where they are from, and what they see.
    cameras: Option<Origin>,
    seen: Option<SeenShare>,
    /// How much less the stream shows than the input, and how long the estimate took.
    loss: Option<LossEstimate>,
    estimate_seconds: f64,
    /// The cameras seem not to be the model's own, so they decided nothing.
    doubted: bool,
}

/// How much of a model cameras see.
#[derive(Clone, Copy)]
struct SeenShare {
    of_opacity: f64,
    unseen: usize,
    /// Gaussians that cameras see, but too little to pay for their bits.
    hardly: usize,
    /// Of both, those in the stream.
    kept: usize,
}

impl SeenShare {
    /// Counts what became of what cameras see too little of. `least` has the importances by which it was kept.
    fn count(&mut self, weights: &[f32], least: &[f32], rows: &[u32]) {
        for ((&seen, &least), &row) in weights.iter().zip(least).zip(rows) {
            let kept = row != LEFT_OUT;
            let hardly = !kept || least > seen;
            self.hardly += usize::from(hardly && seen > 0.0);
            self.kept += usize::from(hardly && kept);
        }
    }

    /// For a person.
    fn remark(&self, gaussians: u64) -> Option<String> {
        let Self { unseen, hardly, kept, .. } = *self;
        if unseen + hardly == 0 {
            return None;
        }
        let these = format!("{unseen} Gaussians that no camera sees and {hardly} hardly seen");
        Some(match kept {
            0 => format!("{these} are left out"),
            _ => format!(
                "{these}: {kept} of them kept, coarsely; --drop-unseen leaves them out, which saves at most about \
                 {:.1} %",
                100.0 * kept.min(gaussians as usize) as f64 / gaussians.max(1) as f64
            ),
        })
    }
}

/// What is said of Gaussians that no rasterizer draws.
pub(crate) fn transparent(n: usize) -> String {
    format!("{n} left out that no rasterizer draws (opacity below 1/255)")
}

impl Done {
    /// For a person.
    fn remarks(&self) -> String {
        let encoded = &self.made.encoded;
        let outliers = encoded.outliers();
        let mut remarks = vec![self.note.clone()];
        if encoded.transparent > 0 {
            remarks.push(transparent(encoded.transparent));
        }
        if encoded.pruned > 0 {
            remarks.push(format!("{} pruned", encoded.pruned));
        }
        // With bounds on errors the note says how many are exact.
        if outliers > 0 && encoded.max_error.is_none() {
            remarks.push(format!(
                "{} coded exactly, far from all others: {:.0} % of the bytes",
                counted(outliers, "outlier"),
                100.0 * encoded.exact_share()
            ));
        }
        let seen = self.seen.filter(|_| !self.doubted);
        remarks.extend(seen.and_then(|seen| seen.remark(encoded.index.header.count)));
        remarks.join("; ")
    }

    fn json(&self) -> Value {
        let Self { made: Made { encoded, .. }, seen, .. } = self;
        json!({
            "gaussians": encoded.index.header.count,
            "quality": self.made.quality,
            "psnr": self.made.measured.filter(|m| m.0 == Measure::Psnr).map(|m| m.1),
            "ssimulacra2": self.made.measured.filter(|m| m.0 == Measure::Ssimulacra2).map(|m| m.1),
            "encodes": self.made.encodes,
            "transparent": encoded.transparent,
            "pruned": encoded.pruned,
            "outliers": encoded.outliers(),
            "cameras": self.cameras.as_ref().map(Origin::json),
            "cameras_doubted": self.doubted,
            "seen_opacity_share": seen.map(|s| s.of_opacity),
            "unseen": seen.map(|s| s.unseen),
            "hardly_seen": seen.map(|s| s.hardly),
            "hardly_seen_kept": seen.map(|s| s.kept),
            "left_out": encoded.left_out,
            "max_error": max_error::json(encoded),
            "target_reached": self.made.missed.is_none(),
            "parts": parts(&encoded.parts()),
            "estimate_seconds": self.estimate_seconds,
        })
    }
}

/// Leaves out what no rasterizer draws, and returns how many Gaussians these are. The encoder does it too, in a copy.
fn leave_out_transparent(args: &EncodeArgs, scene: &mut Scene) -> gsvx::Result<usize> {
    let (all, drawn) = (scene.len(), scene.drawn().unwrap_or_default());
    if args.lossless || args.max_error.is_some() || drawn.is_empty() {
        return Ok(0);
    }
    // An error names the Gaussian of the file.
    gsvx::check_values(scene, args.scene.content.max_sh_degree(), 0)?;
    scene.keep(&drawn);
    Ok(all - scene.len())
}

/// The stream that the flags ask for.
fn encoded(args: &EncodeArgs, name: &str, mut scene: Scene) -> Result<Done> {
    let content = &args.scene.content;
    let transparent = leave_out_transparent(args, &mut scene).with_context(|| name.to_owned())?;
    let (mut seen_share, mut importance, mut cameras, mut origin) = (None, None, None, None);
    let mut doubted = false;
    if let Some(path) = &content.cameras {
        let read = views::training(path, scene.origin)?;
        doubted = photos::doubt_cameras(&scene, path, &read.views, content.drop_unseen)?;
        let Placed { cameras: training, origin: from } = views::as_pinholes(path, read)?;
        if !doubted {
            let seen = views::seen(&scene, &training, path)?;
            let (of_opacity, unseen) = (seen.share, seen.unseen());
            seen_share = Some(SeenShare { of_opacity, unseen, hardly: 0, kept: 0 });
            importance = Some(seen.weights);
        }
        (cameras, origin) = (Some(training), from);
    }
    // The likeness is to the input before pruning.
    let likeness = args.likeness().zip(cameras.as_ref());
    let likeness = likeness.map(|(wanted, cameras)| (references(&scene, cameras), wanted));
    let estimated = !args.no_estimate && !args.lossless;
    let alike =
        likeness.as_ref().map(|(references, (m, target))| tune::alike(references, *m, *target));
    let mut encoder = args.encoder(args.aim(alike));
    encoder.options.rows = importance.is_some();
    encoder.options.importance = importance;
    let mut bar = None;
    encoder.on_progress(move |event| {
        drop(bar.take());
        if let EncodeProgress::Begins(quality) = event {
            bar = Some(Meter::spinner(format!("encoding at quality {quality:.1}")));
        }
        ControlFlow::Continue(())
    });
    let judged = tune::encode_judged(&mut encoder, &scene, cameras.as_deref(), estimated);
    let judged = judged.with_context(|| name.to_owned())?;
    if let (Some(doubt), Some(path)) = (judged.doubt(), &content.cameras) {
        doubted = true;
        note(format_args!(
            "warning: {}: {doubt}; their importances are not used, but with --drop-unseen they are",
            path.display()
        ));
    }
    let Judged { mut made, loss, seconds, .. } = judged;
    made.encoded.transparent += transparent;
    let weights = encoder.options.importance.as_ref();
    if let (Some(share), Some(weights), Some(rows)) = (&mut seen_share, weights, &made.encoded.rows)
    {
        let least = match encoder.options.drop_unseen {
            true => weights.clone(),
            false => with_unseen(&scene, weights, made.quality.unwrap_or_default()),
        };
        share.count(weights, &least, rows);
    }
    Ok(Done {
        note: aimed(args, &made),
        cameras: origin,
        seen: seen_share,
        doubted,
        loss,
        estimate_seconds: seconds,
        made,
    })
}

/// What the stream aimed for, and how near it came.
fn aimed(args: &EncodeArgs, made: &Made) -> String {
    let Some(quality) = made.quality else {
        let bounds = max_error::human(&made.encoded);
        return bounds.unwrap_or_else(|| "every float bit for bit".into());
    };
    let reached = match (made.missed, made.measured) {
        (Some(Missed::Bytes { .. }), _) => "above the target".into(),
        (_, Some((measure, value))) => format!("{} from the input's renders", measure.words(value)),
        (None, None) if made.encodes > 1 || args.most_bytes().is_some() => {
            let most = args.most_bytes().unwrap_or_default().max(1);
            let share = 100.0 * made.encoded.bytes.len() as f64 / most as f64;
            format!("{share:.1} % of the target")
        }
        _ => {
            return match args.scene.content.preset() {
                Some(preset) => format!("preset {}, quality {quality}", preset.name),
                None => format!("quality {quality}"),
            };
        }
    };
    format!("quality {quality:.1}, {reached}, {} encodes", made.encodes)
}

/// Renders of the input.
fn references(scene: &Scene, cameras: &[Camera]) -> References {
    let mut bar: Option<Meter> = None;
    let Ok(references) = References::new(scene, cameras, |_, all| {
        bar.get_or_insert_with(|| Meter::new("renders of the input", all)).inc();
        Ok::<_, Infallible>(())
    });
    references
}
