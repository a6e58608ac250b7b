//! `gsvx tune --profile paper`: the paper's fine-tune. The means stay at the centres of the voxels, and
//! bits have no price.

use crate::exit::note;
use crate::follow::Follower;
use crate::input;
use crate::interrupt;
use crate::output::{Output, counted};
use crate::progress::Meter;
use crate::report::Reporter;
use crate::views::{self, Origin};
use anyhow::{Context, Result};
use finetune::TrainView;
use gs_model::Scene;
use gsvx::{CodeOptions, PrepareOptions, Prepared, Steps};
use indicatif::DecimalBytes;
use serde_json::json;
use std::path::Path;
use tune::{FineTune, FineTuneOptions, FineTuned};

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
    /// PSNR of the input model at the training views, where the fine-tune ends.
    fn target(&self, scene: &Scene, training: &[TrainView]) -> Option<f64> {
        if self.past_input {
            return None;
        }
        let alive = Meter::spinner("input model".into());
        let sum: f64 = training.iter().map(|view| view.psnr(scene)).sum();
        drop(alive);
        let db = sum / training.len() as f64;
        note(format_args!(
            "input model: {db:.2} dB at the training views; the fine-tune ends there"
        ));
        Some(db)
    }

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

/// What to tune.
pub(crate) struct PaperJob<'a> {
    pub(crate) input: &'a Path,
    /// Where the cameras come from, for messages.
    pub(crate) cameras: &'a Path,
    pub(crate) origin: Option<Origin>,
    pub(crate) scene: Scene,
    pub(crate) training: Vec<TrainView>,
    /// Quality and layout of the stream.
    pub(crate) quality: f32,
    pub(crate) options: CodeOptions,
    pub(crate) tuning: FineTuneOptions,
    pub(crate) output: Output,
    /// A model instead of a stream.
    pub(crate) ply: bool,
}

/// Voxelizes, fine-tunes with the means frozen, writes a stream or a model.
pub(crate) fn run(args: &PaperArgs, job: PaperJob<'_>, report: Reporter) -> Result<()> {
    let PaperJob { origin, training, quality, options, mut tuning, output, ply, .. } = job;
    let name = || input::name(job.input);
    let cameras: Vec<_> = training.iter().map(|v| v.camera.clone()).collect();
    let seen = views::visibility(&job.scene, &cameras, job.cameras)?;
    let (unseen, n) = (seen.unseen(), job.scene.len());
    if unseen > 0 {
        note(format_args!("{unseen} of {n} Gaussians show in no training view: kept, coarsely"));
    }
    let patience = args.patience.unwrap_or(5);
    tuning.target_psnr = args.target(&job.scene, &training);
    tuning.steps = args.steps.unwrap_or(tuning.steps);
    tuning.patience = (patience > 0).then_some(patience);
    tuning.checkpoint_every = args.checkpoint_every.unwrap_or(tuning.checkpoint_every);
    let seen = Some(&seen.squared[..]);
    let Prepared { mut scene, voxels, importance, outliers } =
        gsvx::prepare(&job.scene, seen, quality, &PrepareOptions::default()).with_context(name)?;
    drop(job.scene);
    // The means of Gaussians that are coded exactly stay where they are, as those of the leaves do.
    if let Some(outliers) = &outliers {
        note(format_args!("{} will be coded exactly", counted(outliers.len(), "outlier")));
        scene.append(outliers);
    }
    let steps = tuning.steps;
    let cancel = tuning.cancel.clone();
    let run = FineTune::new(scene, training, tuning).with_context(name)?;
    let mut follower = Follower::new(steps, run.backend());
    if let Some(cancel) = cancel {
        interrupt::sets(cancel);
    }
    let mut outcome = run.run(|p| follower.see(p)).with_context(name)?;
    follower.end(&outcome.backend);
    let (gaussians, outliers) = (outcome.scene.len(), outcome.scene.len() - voxels.len());
    let (written, bytes) = if ply {
        (output.write(|out| Ok(gs_model::ply::write_to(out, &outcome.scene)?))?, 0)
    } else {
        let exact = Some(outcome.scene.split_off(voxels.len())).filter(|exact| !exact.is_empty());
        let (exact, importance) = (exact.as_ref(), Some(&importance[..]));
        let (leaves, octree, steps) =
            (&outcome.scene, voxels.octree(), Steps::of_quality(quality)?);
        let encoded = gsvx::encode_voxels(leaves, octree, exact, importance, &steps, &options);
        let stream = encoded.with_context(name)?.bytes;
        (output.write(|out| Ok(out.write_all(&stream)?))?, stream.len() as u64)
    };
    let size = if ply { String::new() } else { format!(", {}", DecimalBytes(bytes)) };
    let (target, FineTuned { steps, seconds, reason, backend, .. }) = (written.name, outcome);
    let human =
        format!("{steps} steps in {seconds:.1} s: {reason}\n{target}: {gaussians} Gaussians{size}");
    let json = json!({
        "output": target,
        "cameras": origin.as_ref().map(Origin::json),
        "gaussians": gaussians,
        "outliers": outliers,
        "bytes": bytes,
        "steps": steps,
        "seconds": seconds,
        "reason": reason.to_string(),
        "backend": format!("{:?}", backend.used).to_lowercase(),
    });
    report.say(false, &human, &json)
}
