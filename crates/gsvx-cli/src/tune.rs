//! `gsvx finetune`.

use crate::encode::quality;
use crate::exit::{note, usage};
use crate::input::{self, Reading};
use crate::output::{Output, megabytes};
use crate::progress::Steps;
use crate::report::Reporter;
use crate::trim::Trim;
use crate::{interrupt, views};
use anyhow::{Context, Result, anyhow, bail};
use finetune::backend::Backend;
use finetune::{
    FineTune, FineTuneOptions, Image, Outcome, Quantization, QuantizationMode, RenderOptions,
    StopReason, TrainView, metrics, photo_match, render,
};
use gs_model::Scene;
use gsvx::{EncodeOptions, Prepared};
use serde_json::json;
use std::path::{Path, PathBuf};
use voxel::Voxelization;

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx finetune model.ply --cameras data/fox -o tuned.gsvx
  gsvx finetune model.ply --cameras data/fox -o tuned.ply --steps 3000 --backend cpu
  gsvx finetune model.ply --cameras data/fox -o tuned.gsvx --checkpoint run.ckpt

Ctrl-C, or SIGTERM, ends the tuning early; what has been reached is written. A second one, later, ends
the command without an output.";

/// Arguments of `gsvx finetune`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The trained model: a PLY in the Inria layout, .splat or .spz; `-` for standard input.
    input: PathBuf,
    /// Scene folder with cameras and photos.
    #[arg(long, value_name = "DIR")]
    cameras: PathBuf,
    /// What to write: NAME.gsvx for a stream, NAME.ply for the tuned model.
    #[arg(short, long)]
    output: PathBuf,
    /// Largest number of steps, one photo each.
    #[arg(long, default_value_t = 8000)]
    steps: u64,
    /// Quality of the voxelization and of the stream, 0 to 100.
    #[arg(short, long, default_value_t = gsvx::DEFAULT_QUALITY, value_parser = quality)]
    quality: f32,
    /// Where to compute: cpu, gpu or auto.
    #[arg(long, default_value = "auto")]
    backend: Backend,
    /// Stop after so many passes over the photos without improvement; 0 for never.
    #[arg(long, default_value_t = 5)]
    patience: u32,
    /// Go on when the photos are matched as well as by the input model.
    #[arg(long)]
    past_input: bool,
    /// Quantise attributes while tuning, at the steps of the quality: round or noise.
    #[arg(long, value_name = "MODE", value_parser = quantizer)]
    quantize: Option<QuantizationMode>,
    /// Gaussians so far away that the others lose octree levels: auto tunes them too and codes them
    /// exactly where that is cheaper, off keeps them in the octree.
    #[arg(long, default_value = "auto")]
    trim: Trim,
    /// Checkpoint file; an existing one is continued.
    #[arg(long)]
    checkpoint: Option<PathBuf>,
    /// Steps between checkpoints; also how far back a run goes if the GPU fails.
    #[arg(long, value_name = "STEPS", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..))]
    checkpoint_every: u64,
    #[command(flatten)]
    reading: Reading,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

fn quantizer(text: &str) -> std::result::Result<QuantizationMode, String> {
    match text {
        "round" => Ok(QuantizationMode::StraightThrough),
        "noise" => Ok(QuantizationMode::UniformNoise),
        _ => Err("use round or noise".into()),
    }
}

/// The codec's steps of the middle importance class, in the space of the scene's arrays: ln(alpha)
/// moves at most as far as the logit, and a covariance's logarithm twice as far as the log-scale.
fn quantization(mode: QuantizationMode, options: &EncodeOptions) -> Quantization {
    let steps = &options.steps;
    Quantization {
        mode,
        sh_dc: steps.dc,
        sh_rest: steps.sh[0],
        opacity_logit: steps.opacity,
        log_scale: 0.5 * steps.covariance,
        ..Default::default()
    }
}

/// Mean PSNR of the model at the training views, dB.
fn quality_of(scene: &Scene, views: &[TrainView]) -> f64 {
    let steps = Steps::new("input model", views.len() as u64);
    let mut sum = 0.0;
    for view in views {
        let image = render(scene, &view.camera, &RenderOptions::default());
        sum += metrics::psnr(&image, &view.photo);
        steps.inc();
    }
    sum / views.len() as f64
}

/// A model about to be tuned.
struct Start {
    /// The voxelized scene, then the Gaussians that are coded exactly.
    scene: Scene,
    voxels: Voxelization,
    importance: Vec<f32>,
    training: Vec<TrainView>,
    /// PSNR of the input model at the training views.
    target: Option<f64>,
}

/// Voxelizes, fine-tunes with the means frozen, writes a stream or a model.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let extension = args.output.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let extension = extension.to_ascii_lowercase();
    if extension != "gsvx" && extension != "ply" {
        let name = args.output.display();
        return Err(usage(format!("{name}: the output must end in .gsvx or .ply")));
    }
    let options = EncodeOptions::from_quality(args.quality)?;
    let output = Output::open(&args.output, args.force, &[&args.input])?;
    // Before any work: whoever asked for a GPU should not wait to hear that there is none.
    let backend = finetune::backend::choose(args.backend).context("try --backend cpu or auto")?;
    note(format_args!("backend: {}", backend.reason));
    let start = prepare(args)?;
    let (voxels, importance) = (start.voxels, start.importance);
    let outcome = tune(args, start.scene, start.training, start.target, &options, backend.used)?;
    let (target, mut tuned) = (output.name(), outcome.scene);
    let gaussians = tuned.len();
    let mut bytes = 0;
    if extension == "ply" {
        output.write(|out| Ok(gs_model::ply::write_to(out, &tuned)?))?;
    } else {
        let outliers = tuned.split_off(voxels.len());
        let outliers = (!outliers.is_empty()).then_some(outliers);
        let mut options = options;
        options.importance = Some(importance);
        let encoded = gsvx::encode_voxels(&tuned, &voxels, outliers.as_ref(), &options)
            .with_context(|| input::name(&args.input))?;
        bytes = encoded.bytes.len() as u64;
        output.write(|out| Ok(out.write_all(&encoded.bytes)?))?;
    }
    let size = if bytes > 0 { format!(", {}", megabytes(bytes)) } else { String::new() };
    let (steps, seconds, reason) = (outcome.steps, outcome.seconds, outcome.reason);
    let human = format!(
        "{steps} steps in {seconds:.1} s: {}\n{target}: {gaussians} Gaussians{size}",
        in_words(reason)
    );
    let json = json!({
        "output": target,
        "gaussians": gaussians,
        "outliers": gaussians - voxels.len(),
        "bytes": bytes,
        "steps": steps,
        "seconds": seconds,
        "reason": in_words(reason),
        "backend": format!("{:?}", outcome.backend.used).to_lowercase(),
    });
    report.say(false, &human, &json)
}

fn in_words(reason: StopReason) -> &'static str {
    match reason {
        StopReason::Steps => "all steps are done",
        StopReason::TargetReached => "the photos are matched as well as by the input model",
        StopReason::NoImprovement => "the match no longer improves",
        StopReason::Cancelled => "interrupted",
        _ => "ended",
    }
}

/// Reads model, cameras and photos, and voxelizes the model.
fn prepare(args: &Args) -> Result<Start> {
    let name = || input::name(&args.input);
    let mut scene = args.reading.model(&args.input, None)?.scene;
    let training = photos(&args.cameras)?;
    let cameras: Vec<_> = training.iter().map(|v| v.camera.clone()).collect();
    let seen = views::Seen::of(&scene, &cameras, &args.cameras)?;
    warn_of_other_photos(&scene, &training, &args.cameras);
    let unseen = seen.unseen();
    if unseen > 0 {
        let n = scene.len();
        note(format_args!("{unseen} of {n} Gaussians show in no training view: kept, coarsely"));
    }
    let mut importance = gsvx::importance::with_unseen(&scene, &seen.weights);
    let target = (!args.past_input).then(|| quality_of(&scene, &training));
    if let Some(db) = target {
        note(format_args!(
            "input model: {db:.2} dB at the training views; the fine-tune ends there"
        ));
    }
    let strategy = |found: &[f32], seen| gsvx::default_strategy(args.quality, found, seen);
    let outliers = args.trim.split(&mut scene, Some(&mut importance), name)?;
    let Prepared { mut scene, voxels, importance } =
        gsvx::prepare(&scene, strategy, Some(&importance)).with_context(name)?;
    // The means of Gaussians that are coded exactly stay where they are, as those of the leaves do.
    if let Some(outliers) = &outliers {
        let n = outliers.len();
        let s = if n == 1 { "" } else { "s" };
        note(format_args!("{n} outlier{s} will be coded exactly"));
        scene.append(outliers);
    }
    Ok(Start { scene, voxels, importance, training, target })
}

/// A model of the photos shows them better than this, dB; photos of anything else rarely reach it.
const LEAST_MATCH: f64 = 15.0;
/// Photos that are compared with the model; more only take longer.
const MATCHED: usize = 8;

/// Warns of photos that the model does not show.
fn warn_of_other_photos(scene: &Scene, training: &[TrainView], path: &Path) {
    let Some(found) = photo_match(scene, training, MATCHED, &RenderOptions::default()) else {
        return;
    };
    if found.mean_psnr < LEAST_MATCH {
        note(format_args!(
            "warning: {}: the model shows these photos at {:.1} dB only (mean of {}); are they of \
             this scene?",
            path.display(),
            found.mean_psnr,
            found.views
        ));
    }
}

/// Runs the fine-tune.
fn tune(
    args: &Args,
    scene: Scene,
    training: Vec<TrainView>,
    target: Option<f64>,
    options: &EncodeOptions,
    chosen: Backend,
) -> Result<Outcome> {
    let name = || input::name(&args.input);
    let tuning = FineTuneOptions {
        steps: args.steps,
        target_psnr: target,
        patience: (args.patience > 0).then_some(args.patience),
        quantization: args.quantize.map(|mode| quantization(mode, options)),
        checkpoint: args.checkpoint.clone(),
        checkpoint_every: args.checkpoint_every,
        cancel: Some(interrupt::cancel_flag()),
        backend: args.backend,
        report_every: (args.steps / 200).clamp(1, 50),
        ..Default::default()
    };
    let tune =
        FineTune::new(scene, training, tuning).map_err(|e| gpu_hint(e, args)).with_context(name)?;
    let begun = tune.backend().used;
    let mut used = begun;
    if begun != chosen {
        note(format_args!("backend: {}", tune.backend().reason));
    }
    let steps = Steps::new("fine-tune", args.steps);
    let outcome = tune
        .run(|p| {
            if p.backend != used {
                steps.say("the GPU failed: going on without it");
                used = p.backend;
            }
            let (loss, psnr, speed) = (p.loss, p.psnr, p.steps_per_second);
            steps.set(p.step, &format!("loss {loss:.4}, {psnr:.2} dB, {speed:.1} steps/s"));
        })
        .map_err(|e| gpu_hint(e, args))
        .with_context(name)?;
    drop(steps);
    if outcome.backend.used != begun {
        note(format_args!("backend: {}", outcome.backend.reason));
    }
    Ok(outcome)
}

/// Says what to do about a GPU that failed.
fn gpu_hint(error: finetune::Error, args: &Args) -> anyhow::Error {
    if !matches!(error, finetune::Error::Gpu { .. }) {
        return error.into();
    }
    let kept = args.checkpoint.as_deref().filter(|p| p.exists());
    let kept = kept.map(|p| format!(", from {}", p.display())).unwrap_or_default();
    anyhow!("{error}: --backend auto or cpu goes on without it{kept}")
}

/// Training cameras with their photos.
fn photos(dir: &Path) -> Result<Vec<TrainView>> {
    let (_, found) = gs_model::dataset::open_views(dir)?;
    let training = found.into_iter().enumerate().filter(|(i, _)| i % 8 != 0);
    let mut out = Vec::new();
    for (_, view) in training {
        let file = view.image_path.display();
        let photo = image::ImageReader::open(&view.image_path)
            .with_context(|| format!("photo {file}"))?
            .with_guessed_format()
            .with_context(|| format!("photo {file}"))?
            .decode()
            .with_context(|| format!("photo {file}: PNG or JPEG expected"))?
            .to_rgb8();
        let (width, height) = photo.dimensions();
        let Some(camera) = view.camera.scaled_to(width, height) else {
            bail!("photo {file} is {width}x{height}, which is not its camera's aspect ratio");
        };
        let photo = Image::from_rgb8(width, height, photo.as_raw())
            .with_context(|| format!("photo {file} is empty"))?;
        out.push(TrainView { camera, photo });
    }
    if out.is_empty() {
        bail!("{}: no training photos", dir.display());
    }
    Ok(out)
}
