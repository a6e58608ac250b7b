//! `gsvx tune`.

use crate::content::quality;
use crate::exit::{missed, note, usage};
use crate::follow::{Follower, duration, gpu_hint};
use crate::input::{self, Reading};
use crate::orbit::Orbit;
use crate::output::{Output, megabytes};
use crate::paper_tune::{self, PaperArgs};
use crate::report::Reporter;
use crate::{interrupt, photos, pictures, size};
use anyhow::{Context, Result};
use finetune::{Backend, RenderOptions, TrainView, render};
use gs_model::{Camera, Scene};
use serde_json::json;
use std::path::{Path, PathBuf};
use tune::{Progress, StopReason, Target, Tune, TuneEffort, TuneOptions, TuneOutcome};

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx tune model.ply --cameras data/fox -o small.gsvx
  gsvx tune model.ply --cameras data/fox -o small.gsvx --target-bytes 200k
  gsvx tune model.ply --cameras data/fox -o small.gsvx --target-psnr 31 --effort long
  gsvx tune model.ply --cameras data/fox --distil -o small.gsvx   no photos
  gsvx tune model.ply --orbit 60 -o small.gsvx                    no cameras either
  gsvx tune model.ply --cameras data/fox -o small.gsvx --checkpoint run.ckpt

Ctrl-C, or SIGTERM, ends the tuning early; what has been reached is written. A second one, later, ends
the command without an output.";

/// Steps between two pictures.
const PICTURED: u64 = 100;

/// Arguments of `gsvx tune`.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("target"))]
#[command(group = clap::ArgGroup::new("which_views").required(true).args(["cameras", "orbit"]))]
pub(crate) struct Args {
    /// The trained model, of any format that gsvx convert reads; `-` for standard input.
    input: PathBuf,
    /// Scene folder with cameras and photos. Without photos, or with --distil, the model is tuned to
    /// its own renders at the cameras.
    #[arg(long, value_name = "PATH")]
    cameras: Option<PathBuf>,
    /// What to write: NAME.gsvx for a stream, NAME.ply for the tuned model.
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Quality of the stream, 0 to 100 [default: 58].
    #[arg(short, long, group = "target", value_parser = quality)]
    quality: Option<f32>,
    /// Best stream of at most this size: 800000, 500k, 1.5MB.
    #[arg(long, value_name = "SIZE", group = "target", value_parser = size::bytes)]
    target_bytes: Option<u64>,
    /// Smallest stream of this PSNR against the photos, in dB, at views kept aside.
    #[arg(long, value_name = "DB", group = "target", value_parser = crate::encode::finite)]
    target_psnr: Option<f64>,
    /// How long to tune.
    #[arg(long, default_value = "normal", value_name = "EFFORT")]
    effort: EffortName,
    /// Tune to renders of the model itself, also where there are photos.
    #[arg(long)]
    distil: bool,
    /// File that keeps what is needed to go on after an interruption; an existing one is continued.
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
    /// Folder for renders of the first training view, one every 100 steps.
    #[arg(long, value_name = "DIR", hide_short_help = true)]
    pictures: Option<PathBuf>,
    /// Seed of the order of the views.
    #[arg(long, default_value_t = 0, hide_short_help = true)]
    seed: u64,
    /// Where to compute: cpu, gpu, or auto for a GPU if there is one [default: cpu; auto with --profile paper].
    /// Pruning is on the processor. A GPU does not make the same bytes as the processor.
    #[arg(long, value_name = "WHERE", hide_short_help = true)]
    backend: Option<Backend>,
    /// rate: the codec in the loop, for fewer bytes. paper: attributes only, after voxelization, until
    /// the photos are matched as well as by the input.
    #[arg(long, default_value = "rate", value_name = "PROFILE", hide_short_help = true)]
    profile: Profile,
    #[command(flatten)]
    paper: PaperArgs,
    #[command(flatten)]
    orbit: Orbit,
    #[command(flatten)]
    reading: Reading,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum EffortName {
    /// About 1 minute for 120,000 Gaussians and small photos on one core.
    Quick,
    /// About 5 minutes.
    Normal,
    /// About 30 minutes.
    Long,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Profile {
    Rate,
    Paper,
}

impl Args {
    fn target(&self) -> Target {
        match (self.target_bytes, self.target_psnr) {
            (Some(bytes), _) => Target::Bytes(bytes),
            (_, Some(db)) => Target::Psnr(db),
            _ => Target::Quality(self.quality.unwrap_or(tune::DEFAULT_QUALITY)),
        }
    }

    /// Combinations of flags that make no sense.
    fn check(&self) -> Result<()> {
        if self.profile == Profile::Paper {
            if self.target_bytes.is_some() || self.target_psnr.is_some() {
                return Err(usage("--profile paper has no target but --quality"));
            }
            return Ok(());
        }
        match self.paper.given() {
            Some(flag) => Err(usage(format!("{flag}: only with --profile paper"))),
            None => Ok(()),
        }
    }

    /// Views to tune on, and whether their images are renders of the model.
    fn views(&self, scene: &Scene) -> Result<(Vec<TrainView>, bool)> {
        if let (None, Some(n)) = (&self.cameras, self.orbit.orbit) {
            return Ok((photos::renders_around(&self.orbit, n, &self.input, scene)?, true));
        }
        let Some(path) = &self.cameras else { return Err(usage("give --cameras or --orbit")) };
        let photos = if self.distil { None } else { photos::photos(path)? };
        match photos {
            Some(views) => Ok((views, false)),
            None => Ok((photos::renders_at(path, scene)?, true)),
        }
    }
}

/// Tunes and writes a stream or a model.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let extension = args.output.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let extension = extension.to_ascii_lowercase();
    if extension != "gsvx" && extension != "ply" {
        let name = args.output.display();
        return Err(usage(format!("{name}: the output must end in .gsvx or .ply")));
    }
    args.check()?;
    let output = Output::open(&args.output, args.force, &[&args.input])?;
    let pictures = args.pictures.as_deref().map(|p| pictures::folder(p, args.force)).transpose()?;
    let wanted = args.backend.unwrap_or_default();
    let wanted = match (args.profile, args.backend) {
        (Profile::Rate, None) => Backend::Cpu,
        _ => {
            // Whoever asked for a GPU should not wait to hear that there is none.
            let found = finetune::backend::choose(wanted).context("try --backend cpu or auto")?;
            note(format_args!("backend: {}", found.reason));
            wanted
        }
    };
    let scene = args.reading.model(&args.input)?.scene;
    let (training, distilled) = args.views(&scene)?;
    let cameras = args.cameras.as_deref().unwrap_or(&args.input);
    if distilled {
        note("no photos: the model is tuned to its own renders");
    } else if args.profile == Profile::Paper {
        // The other profile refuses photos that show something else.
        photos::warn_of_others(&scene, &training, cameras);
    }
    let ply = extension == "ply";
    if args.profile == Profile::Paper {
        let job = paper_tune::Job {
            input: &args.input,
            cameras,
            scene,
            training,
            quality: args.quality.unwrap_or(gsvx::DEFAULT_QUALITY),
            checkpoint: args.checkpoint.as_deref(),
            output,
            wanted,
            ply,
        };
        return paper_tune::run(&args.paper, job, report);
    }
    let first = training.first().map(|v| v.camera.clone());
    let pictures = pictures.zip(first);
    let outcome = tuned(args, (scene, training), wanted, pictures.as_ref())?;
    let name = output.name();
    if ply {
        output.write(|out| Ok(gs_model::ply::write_to(out, &outcome.scene)?))?;
    } else {
        output.write(|out| Ok(out.write_all(&outcome.encoded.bytes)?))?;
    }
    tell(args, &name, distilled, &outcome, report)
}

/// Says what will be done, and does it.
fn tuned(
    args: &Args,
    (scene, training): (Scene, Vec<TrainView>),
    backend: Backend,
    pictures: Option<&(PathBuf, Camera)>,
) -> Result<TuneOutcome> {
    let name = || input::name(&args.input);
    let gaussians = scene.len();
    let mut options = TuneOptions::new(args.target());
    options.effort = match args.effort {
        EffortName::Quick => TuneEffort::Quick,
        EffortName::Normal => TuneEffort::Normal,
        EffortName::Long => TuneEffort::Long,
    };
    options.backend = backend;
    options.seed = args.seed;
    options.checkpoint.clone_from(&args.checkpoint);
    options.cancel = Some(interrupt::cancel_flag());
    let run = Tune::new(scene, training, options).with_context(name)?;
    announce(&run, gaussians);
    let begun = run.backend().used;
    let mut follower = Follower::new(run.plan().steps(), run.backend());
    let outcome = run.run(|p| {
        follower.see(p);
        if let Some((folder, camera)) = pictures
            && p.step.is_multiple_of(PICTURED)
            && let Err(error) = picture(folder, camera, p)
        {
            follower.say(&format!("warning: {error:#}"));
        }
    });
    drop(follower);
    let outcome =
        outcome.map_err(|e| gpu_hint(e, args.checkpoint.as_deref())).with_context(name)?;
    if outcome.backend.used != begun {
        note(format_args!("backend: {}", outcome.backend.reason));
    }
    Ok(outcome)
}

/// What will be done, and how long it takes.
fn announce(run: &Tune, gaussians: usize) {
    let plan = run.plan();
    let (used, aside) = run.views();
    note(format_args!(
        "input model: {gaussians} Gaussians, {:.2} dB at {aside} of {} views, which are kept aside",
        run.input_psnr(),
        used + aside,
    ));
    let done = match run.steps_done() {
        0 => String::new(),
        n => format!(", {n} of them done"),
    };
    note(format_args!(
        "plan: quality {:.1}; leave out {:.0} % of the Gaussians in {} rounds of {} steps, then {} steps \
         with the codec in the loop{done}; about {}",
        plan.quality,
        100.0 * plan.fraction,
        plan.rounds,
        plan.round_steps,
        plan.loop_steps,
        duration(run.estimated_seconds()),
    ));
}

fn picture(folder: &Path, camera: &Camera, p: &Progress<'_>) -> Result<()> {
    let file = folder.join(format!("step-{:06}.png", p.step));
    let image = render(p.scene, camera, &RenderOptions::default());
    pictures::write(&image, Output::open(&file, true, &[])?)
}

/// Reports what has been written.
fn tell(
    args: &Args,
    name: &str,
    distilled: bool,
    outcome: &TuneOutcome,
    report: Reporter,
) -> Result<()> {
    let bytes = outcome.encoded.bytes.len() as u64;
    let ended = if outcome.cancelled { StopReason::Cancelled } else { StopReason::Steps };
    let of = if distilled { "renders of the input" } else { "photos" };
    let gaussians = outcome.scene.len();
    let human = format!(
        "{} steps in {:.1} s: {ended}\n{name}: {gaussians} Gaussians, {}; {:.2} dB against {of} kept \
         aside (input model: {:.2} dB)",
        outcome.steps,
        outcome.seconds,
        megabytes(bytes),
        outcome.psnr,
        outcome.input_psnr.min(100.0),
    );
    let parts = outcome.encoded.parts().into_iter().map(|(part, n)| (part.to_owned(), json!(n)));
    let json = json!({
        "output": name,
        "gaussians": gaussians,
        "outliers": outcome.outliers,
        "bytes": bytes,
        "counted_bytes": outcome.counted_bytes,
        "psnr": outcome.psnr,
        "input_psnr": outcome.input_psnr,
        "quality": outcome.quality,
        "distilled": distilled,
        "steps": outcome.steps,
        "seconds": outcome.seconds,
        "reason": ended.to_string(),
        "target_reached": outcome.reached,
        "parts": parts.collect::<serde_json::Map<_, _>>(),
    });
    report.say(false, &human, &json)?;
    if loss(outcome.psnr, outcome.input_psnr) < finetune::Likeness::POOR {
        note(format_args!(
            "warning: the loss is easy to see; use a higher --quality, or a larger target"
        ));
    }
    match (outcome.reached, args.target()) {
        (true, _) | (_, Target::Quality(_)) => Ok(()),
        (false, Target::Bytes(wanted)) => Err(missed(format!(
            "{name}: written, but {bytes} bytes are above the target of {wanted}"
        ))),
        (false, Target::Psnr(db)) => Err(missed(format!(
            "{name}: written, but {:.2} dB are below the target of {db} dB",
            outcome.psnr
        ))),
    }
}

/// PSNR of the error that tuning adds to that of the input, dB: the mean squared errors are subtracted.
fn loss(psnr: f64, input_psnr: f64) -> f64 {
    let mse = |db: f64| libm::pow(10.0, -db / 10.0);
    -10.0 * libm::log10((mse(psnr) - mse(input_psnr)).max(1e-10))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_is_what_was_added() {
        // Against renders of the input, all error was added.
        assert!((loss(30.0, f64::INFINITY) - 30.0).abs() < 1e-9);
        // 3 dB below 30 dB is as much again as there was.
        assert!((loss(26.9897, 30.0) - 30.0).abs() < 1e-3);
        assert!(loss(31.0, 30.0) == 100.0);
    }
}
