//! `gsvx tune --profile paper`: the paper's fine-tune. The means stay at the centres of the voxels, and
//! bits have no price.

use crate::exit::note;
use crate::follow::{Follower, gpu_hint};
use crate::input;
use crate::interrupt;
use crate::output::{Output, megabytes};
use crate::progress::spinner;
use crate::report::Reporter;
use crate::views;
use anyhow::{Context, Result};
use finetune::backend::Backend;
use finetune::{RenderOptions, TrainView, photo_match};
use gs_model::Scene;
use gsvx::{EncodeOptions, Prepared};
use serde_json::json;
use std::path::Path;
use tune::{FineTune, FineTuneOptions, FineTuned};
use voxel::Voxelization;

/// Heading of what belongs to this profile.
const PAPER: &str = "With --profile paper";

/// Arguments of the profile.
#[derive(clap::Args, Debug)]
pub(crate) struct PaperArgs {
    /// Largest number of steps, one photo each [default: 8000].
    #[arg(long, value_name = "STEPS", hide_short_help = true, help_heading = PAPER)]
    steps: Option<u64>,
    /// Stop after so many passes over the photos without improvement; 0 for never [default: 5].
    #[arg(long, value_name = "PASSES", hide_short_help = true, help_heading = PAPER)]
    patience: Option<u32>,
    /// Go on when the photos are matched as well as by the input model.
    #[arg(long, hide_short_help = true, help_heading = PAPER)]
    past_input: bool,
    /// Steps between checkpoints; also how far back a run goes if the GPU fails [default: 1000].
    #[arg(long, value_name = "STEPS", hide_short_help = true, help_heading = PAPER,
          value_parser = clap::value_parser!(u64).range(1..))]
    checkpoint_every: Option<u64>,
}

impl PaperArgs {
    /// A flag of this profile that was given, if any.
    pub(crate) fn given(&self) -> Option<&'static str> {
        let Self { steps, patience, past_input, checkpoint_every } = self;
        [
            (steps.is_some(), "--steps"),
            (patience.is_some(), "--patience"),
            (*past_input, "--past-input"),
            (checkpoint_every.is_some(), "--checkpoint-every"),
        ]
        .into_iter()
        .find_map(|(given, name)| given.then_some(name))
    }
}

/// What to tune, whatever the profile.
pub(crate) struct Job<'a> {
    pub(crate) input: &'a Path,
    /// Where the cameras come from, for messages.
    pub(crate) cameras: &'a Path,
    pub(crate) scene: Scene,
    pub(crate) training: Vec<TrainView>,
    pub(crate) quality: f32,
    pub(crate) checkpoint: Option<&'a Path>,
    pub(crate) output: Output,
    /// The backend that was asked for.
    pub(crate) wanted: Backend,
    /// A model instead of a stream.
    pub(crate) ply: bool,
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
pub(crate) fn run(args: &PaperArgs, mut job: Job<'_>, report: Reporter) -> Result<()> {
    let options = EncodeOptions::from_quality(job.quality)?;
    let (scene, training) = (std::mem::take(&mut job.scene), std::mem::take(&mut job.training));
    let start = prepare(args, &job, scene, training)?;
    let (voxels, importance) = (start.voxels, start.importance);
    let outcome = tune(args, &job, start.scene, start.training, start.target)?;
    let (target, mut tuned) = (job.output.name(), outcome.scene);
    let gaussians = tuned.len();
    let mut bytes = 0;
    if job.ply {
        job.output.write(|out| Ok(gs_model::ply::write_to(out, &tuned)?))?;
    } else {
        let outliers = tuned.split_off(voxels.len());
        let outliers = (!outliers.is_empty()).then_some(outliers);
        let mut options = options;
        options.importance = Some(importance);
        let encoded = gsvx::encode_voxels(&tuned, voxels.octree(), outliers.as_ref(), &options)
            .with_context(|| input::name(job.input))?;
        bytes = encoded.bytes.len() as u64;
        job.output.write(|out| Ok(out.write_all(&encoded.bytes)?))?;
    }
    let size = if bytes > 0 { format!(", {}", megabytes(bytes)) } else { String::new() };
    let (steps, seconds, reason) = (outcome.steps, outcome.seconds, outcome.reason);
    let human =
        format!("{steps} steps in {seconds:.1} s: {reason}\n{target}: {gaussians} Gaussians{size}");
    let json = json!({
        "output": target,
        "gaussians": gaussians,
        "outliers": gaussians - voxels.len(),
        "bytes": bytes,
        "steps": steps,
        "seconds": seconds,
        "reason": reason.to_string(),
        "backend": format!("{:?}", outcome.backend.used).to_lowercase(),
    });
    report.say(false, &human, &json)
}

/// Voxelizes the model.
fn prepare(
    args: &PaperArgs,
    job: &Job<'_>,
    scene: Scene,
    training: Vec<TrainView>,
) -> Result<Start> {
    let name = || input::name(job.input);
    let cameras: Vec<_> = training.iter().map(|v| v.camera.clone()).collect();
    let seen = views::seen(&scene, &cameras, job.cameras)?;
    let unseen = seen.unseen();
    if unseen > 0 {
        let n = scene.len();
        note(format_args!("{unseen} of {n} Gaussians show in no training view: kept, coarsely"));
    }
    let target = if args.past_input {
        None
    } else {
        let _alive = spinner("input model".into());
        photo_match(&scene, &training, training.len(), &RenderOptions::default())
            .map(|m| m.mean_psnr)
    };
    if let Some(db) = target {
        note(format_args!(
            "input model: {db:.2} dB at the training views; the fine-tune ends there"
        ));
    }
    let mut options = EncodeOptions::from_quality(job.quality)?;
    options.importance = Some(seen.weights);
    let Prepared { mut scene, voxels, importance, outliers } =
        gsvx::prepare(&scene, &options).with_context(name)?;
    // The means of Gaussians that are coded exactly stay where they are, as those of the leaves do.
    if let Some(outliers) = &outliers {
        let n = outliers.len();
        let s = if n == 1 { "" } else { "s" };
        note(format_args!("{n} outlier{s} will be coded exactly"));
        scene.append(outliers);
    }
    Ok(Start { scene, voxels, importance, training, target })
}

/// Runs the fine-tune.
fn tune(
    args: &PaperArgs,
    job: &Job<'_>,
    scene: Scene,
    training: Vec<TrainView>,
    target_psnr: Option<f64>,
) -> Result<FineTuned> {
    let name = || input::name(job.input);
    let (steps, patience) = (args.steps.unwrap_or(8000), args.patience.unwrap_or(5));
    let tuning = FineTuneOptions {
        steps,
        target_psnr,
        patience: (patience > 0).then_some(patience),
        checkpoint: job.checkpoint.map(Path::to_owned),
        checkpoint_every: args.checkpoint_every.unwrap_or(1000),
        cancel: Some(interrupt::cancel_flag()),
        // With auto, a GPU that fails is followed by the processor.
        backend: job.wanted,
        ..Default::default()
    };
    let hint = |e| gpu_hint(e, job.checkpoint);
    let run = FineTune::new(scene, training, tuning).map_err(hint).with_context(name)?;
    let begun = run.backend().used;
    let mut follower = Follower::new(steps, run.backend());
    let outcome = run.run(|p| follower.see(p)).map_err(hint).with_context(name)?;
    drop(follower);
    if outcome.backend.used != begun {
        note(format_args!("backend: {}", outcome.backend.reason));
    }
    Ok(outcome)
}
