//! `gsvx tune`.

use crate::commands::compare::words;
use crate::commands::info::parts;
use crate::content::quality;
use crate::exit::{missed, note, usage};
use crate::follow::{Follower, duration};
use crate::input::{self, Reading};
use crate::orbit::Orbit;
use crate::output::{Output, empty_folder};
use crate::progress::Meter;
use crate::report::Reporter;
use crate::views::{self, Origin, PlacedCameras};
use crate::{interrupt, photos, pictures, size};
use anyhow::{Context, Result, bail};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use finetune::metrics::Scores;
use finetune::{Backend, RenderOptions, render};
use gs_model::{Camera, Scene};
use indicatif::DecimalBytes;
use serde_json::json;
use std::cell::RefCell;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use tune::{
    AgainstInput, Layout, Progress, StopReason, Target, Targets, Tune, TuneEffort, TuneOptions,
    TuneOutcome,
};

pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx tune model.ply --cameras data/fox -o small.gsvx
  gsvx tune model.ply --cameras data/fox -o small.gsvx --target-bytes 200k
  gsvx tune model.ply --cameras data/fox -o small.gsvx --target-psnr 31 --effort long
  gsvx tune model.ply --cameras data/fox -o small.gsvx --qualities 42,58,78
  gsvx tune model.ply --cameras data/fox -o small.gsvx --web      for a web page
  gsvx tune model.ply --cameras data/fox --distil -o small.gsvx   no photos
  gsvx tune model.ply --orbit 60 -o small.gsvx                    no cameras either
  gsvx tune model.ply --cameras data/fox -o small.gsvx --checkpoint run.ckpt

Ctrl-C, or SIGTERM, ends the tuning early; what has been reached is written. A second one, later, ends
the command without an output.";

/// A stream that is worse away from the cameras than at them by more than this is warned of, unless it shows at most
/// small differences there, dB.
const WORSE_ELSEWHERE: f64 = 3.0;
const WELL_ELSEWHERE: f64 = 35.0;
/// Steps between two pictures.
const PICTURED: u64 = 100;

#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("which_views").required(true).args(["cameras", "orbit"]))]
pub(crate) struct TuneArgs {
    /// The trained model, of any format that gsvx convert reads; `-` for standard input.
    input: PathBuf,
    /// Scene folder with cameras and photos (PNG, JPEG, WebP; in images, or else images_2, _4 or _8; with
    /// any extension). Without photos, or with --distil, the model is tuned to its own renders at the cameras.
    #[arg(long, value_name = "PATH")]
    cameras: Option<PathBuf>,
    /// What to write: NAME.gsvx for a stream, NAME.ply for the tuned model.
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Quality of the stream, 0 to 100 [default: 58].
    #[arg(short, long, group = "target", value_parser = quality)]
    quality: Option<f32>,
    /// Several qualities, such as 42,58,78: NAME-q42.gsvx, NAME-q58.gsvx ... Each stream goes on from that of the next
    /// higher quality, so five take about twice the time of one.
    #[arg(long, value_name = "LIST", group = "target", value_delimiter = ',', value_parser = quality)]
    qualities: Vec<f32>,
    /// Best stream of at most this size: 800000, 500k, 1.5MB.
    #[arg(long, value_name = "SIZE", group = "target", value_parser = size::bytes)]
    target_bytes: Option<u64>,
    /// Smallest stream of this PSNR against the photos, in dB, at views kept aside.
    #[arg(long, value_name = "DB", group = "target", value_parser = crate::commands::encode::finite)]
    target_psnr: Option<f64>,
    /// How long to tune.
    #[arg(long, default_value = "normal", value_name = "EFFORT", value_parser = efforts())]
    effort: TuneEffort,
    /// Tune to renders of the model itself, also where there are photos.
    #[arg(long)]
    distil: bool,
    /// Tune also to photos that seem to be of other views than their cameras'.
    #[arg(long, conflicts_with = "distil")]
    force_photos: bool,
    /// Leave out what the views do not show: fewer bytes, and good only where the cameras stand.
    #[arg(long)]
    drop_unseen: bool,
    /// Store a coarse scene first, for viewers that show a scene while it loads. Its bytes count.
    #[arg(long)]
    lod: bool,
    /// What a web page wants: a coarse scene first, and small chunks.
    #[arg(long)]
    web: bool,
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
    /// Where to compute: cpu, gpu, or auto for a GPU if there is one [default: cpu].
    /// A GPU does not make the same bytes as the processor.
    #[arg(long, value_name = "WHERE", hide_short_help = true)]
    backend: Option<Backend>,
    #[command(flatten)]
    orbit: Orbit,
    #[command(flatten)]
    reading: Reading,
}

/// Reads the name of an effort.
fn efforts() -> impl TypedValueParser<Value = TuneEffort> {
    let help = |effort| match effort {
        TuneEffort::Quick => "about 45 seconds for 120,000 Gaussians and small photos on one core",
        TuneEffort::Normal => "about 3 minutes, and fewer bytes than quick at equal quality",
        TuneEffort::Long => "about 10 minutes",
    };
    let values = TuneEffort::ALL.map(|e| PossibleValue::new(e.name()).help(help(e)));
    PossibleValuesParser::new(values)
        .try_map(|name| TuneEffort::named(&name).ok_or_else(|| format!("no effort {name}")))
}

impl TuneArgs {
    fn target(&self) -> Target {
        match (self.target_bytes, self.target_psnr) {
            (Some(bytes), _) => Target::Bytes(bytes),
            (_, Some(db)) => Target::Psnr(db),
            _ => Target::Quality(self.descending()[0]),
        }
    }

    /// The qualities of the streams, the highest first.
    fn descending(&self) -> Vec<f32> {
        let mut all = self.qualities.clone();
        all.sort_by(|a, b| b.total_cmp(a));
        all.dedup();
        match all.is_empty() {
            true => vec![self.quality.unwrap_or(tune::DEFAULT_QUALITY)],
            false => all,
        }
    }

    /// What to write, by quality.
    fn outputs(&self) -> Result<Vec<(f32, Output)>> {
        // The streams that a run made before it was interrupted are there.
        let goes_on = self.checkpoint.as_ref().is_some_and(|path| path.exists());
        let force = self.force || goes_on && !self.qualities.is_empty();
        let [stem, extension] = [self.output.file_stem(), self.output.extension()]
            .map(|part| part.unwrap_or_default().to_string_lossy().into_owned());
        let path = |quality: f32| match self.qualities.is_empty() {
            true => self.output.clone(),
            false => self.output.with_file_name(format!("{stem}-q{quality}.{extension}")),
        };
        let open = |q: f32| Ok((q, Output::open(&path(q), force, &[&self.input])?));
        self.descending().into_iter().map(open).collect()
    }

    fn layout(&self) -> Layout {
        Layout::of(self.web, self.lod)
    }

    /// Combinations of flags that make no sense; `ply` is the output's format.
    fn check(&self, ply: bool) -> Result<()> {
        if ply && self.layout() != Layout::Finest {
            return Err(usage("--lod, --web: a PLY has no coarse level; name the output .gsvx"));
        }
        Ok(())
    }

    /// What the model is tuned to, and where its cameras are from.
    fn targets(&self, scene: &Scene) -> Result<(Targets, Option<Origin>)> {
        let path = match (&self.cameras, self.orbit.orbit) {
            (Some(path), _) => path,
            (None, Some(n)) => {
                let cameras = views::around(&self.orbit, n, &self.input, scene)?;
                return Ok((Targets::Renders(cameras), None));
            }
            (None, None) => return Err(usage("give --cameras or --orbit")),
        };
        let read = views::training(path, scene.origin)?;
        if !self.distil {
            let found = photos::photos(scene, path, &read.views, self.force_photos)?;
            if !found.is_empty() {
                return Ok((Targets::Photos(found), Some(read.origin)));
            }
        }
        let PlacedCameras { cameras, origin } = views::as_pinholes(path, read)?;
        self.refuse_misfits(scene, &cameras, path)?;
        Ok((Targets::Renders(cameras), origin))
    }

    /// Refuses cameras that seem not to be the model's own, where there are no photos that prove them.
    fn refuse_misfits(&self, scene: &Scene, cameras: &[Camera], path: &Path) -> Result<()> {
        let quality = self.descending()[0];
        let looking = Meter::spinner("looking from the cameras".into());
        let doubt = tune::misfit(scene, cameras, quality)?;
        drop(looking);
        let path = path.display();
        match doubt {
            Some(doubt) if self.drop_unseen => note(format_args!("warning: {path}: {doubt}")),
            Some(doubt) => bail!(
                "{path}: {doubt}; --orbit 60 tunes to renders around the model instead, and --drop-unseen to what these \
                 cameras see alone"
            ),
            None => {}
        }
        Ok(())
    }

    /// Where to compute. A note says it, unless the default is used.
    fn backend(&self) -> Result<Backend> {
        let Some(wanted) = self.backend else { return Ok(Backend::Cpu) };
        // The note comes before the run, so that a user who asked for a GPU learns at once that there is none.
        note(format_args!("backend: {}", finetune::backend::choose(wanted)?.reason));
        Ok(wanted)
    }
}

/// Tunes and writes a stream or a model.
pub(crate) fn run(args: &TuneArgs, report: Reporter) -> Result<()> {
    let extension = args.output.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let extension = extension.to_ascii_lowercase();
    if extension != "gsvx" && extension != "ply" {
        let name = args.output.display();
        return Err(usage(format!("{name}: the output must end in .gsvx or .ply")));
    }
    let ply = extension == "ply";
    args.check(ply)?;
    let mut outputs = args.outputs()?;
    let pictures = args.pictures.as_deref();
    pictures.map_or(Ok(()), |folder| empty_folder(folder, args.force))?;
    let backend = args.backend()?;
    let scene = args.reading.model(&args.input, true)?.scene;
    let (targets, origin) = args.targets(&scene)?;
    if let Some(origin) = &origin {
        note(origin.human());
    }
    let distilled = targets.are_renders();
    tuned(args, scene, targets, backend, |outcome| {
        // A run with a target in bytes or dB has one output.
        let at = outputs.iter().position(|(quality, _)| *quality == outcome.quality);
        let (quality, output) = outputs.remove(at.unwrap_or(0));
        outputs.retain(|(other, _)| *other < quality);
        let written = if ply {
            output.write(|out| Ok(gs_model::ply::write_to(out, &outcome.scene)?))?
        } else {
            output.write(|out| Ok(out.write_all(&outcome.encoded.bytes)?))?
        };
        tell(args, &written.name, origin.as_ref(), distilled, &outcome, report)
    })?;
    for (_, output) in outputs {
        note(format_args!("{}: not made, as the run was interrupted", output.name()));
    }
    Ok(())
}

/// Says what will be done, and does it. `made` gets each stream.
fn tuned(
    args: &TuneArgs,
    scene: Scene,
    targets: Targets,
    backend: Backend,
    mut made: impl FnMut(TuneOutcome) -> Result<()>,
) -> Result<()> {
    let name = || input::name(&args.input);
    let pictured = args.pictures.as_deref().zip(targets.cameras().next().cloned());
    let distilled = targets.are_renders();
    let gaussians = scene.len();
    let mut options = TuneOptions::new(args.target());
    options.further = args.descending().split_off(1);
    options.layout = args.layout();
    options.effort = args.effort;
    options.drop_unseen = args.drop_unseen;
    options.backend = backend;
    options.seed = args.seed;
    options.checkpoint.clone_from(&args.checkpoint);
    let cancel = Arc::new(AtomicBool::new(false));
    options.cancel = Some(Arc::clone(&cancel));
    let mut bar = None;
    let run = Tune::with_progress(scene, targets, options, |_, all| {
        bar.get_or_insert_with(|| Meter::new("input model", all)).inc();
    });
    drop(bar);
    let run = run.with_context(name)?;
    announce(&run, gaussians, distilled, args);
    let (steps, begins) = (run.steps(), run.backend().clone());
    let followed = RefCell::new(None);
    let mut end = Ok(());
    interrupt::sets(cancel);
    let follow = |p: &Progress<'_>| {
        let mut follower = followed.borrow_mut();
        let follower = follower.get_or_insert_with(|| Follower::new(steps, &begins));
        follower.see(p);
        if let Some((folder, camera)) = &pictured
            && p.step.is_multiple_of(PICTURED)
            && let Err(error) = picture(folder, camera, p)
        {
            follower.say(&format!("warning: {error:#}"));
        }
    };
    let run = run.run_all(follow, |outcome| {
        if let Some(follower) = followed.take() {
            follower.end(&outcome.backend);
        }
        end = made(outcome);
        if end.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    run.with_context(name)?;
    end
}

/// What will be done, and how long it takes.
fn announce(run: &Tune, gaussians: usize, distilled: bool, args: &TuneArgs) {
    let (plan, effort) = (run.plan(), args.effort);
    let (views, aside) = run.views();
    let judge = match aside {
        0 => format!("at the first of {views} photos"),
        n => format!("at {n} of {views} photos, which are kept aside"),
    };
    if distilled {
        note(format_args!(
            "input model: {gaussians} Gaussians; {views} renders of it are the targets"
        ));
    } else {
        let db = run.input_scores().psnr;
        note(format_args!("input model: {gaussians} Gaussians, {db:.2} dB {judge}"));
    }
    let done = match run.steps_done() {
        0 => String::new(),
        n => format!(", {n} of them done"),
    };
    let further: Vec<String> =
        args.descending()[1..].iter().map(|quality| format!("{quality}")).collect();
    let further = match further.is_empty() {
        true => String::new(),
        false => format!("; then qualities {}, each from the stream before", further.join(", ")),
    };
    note(format_args!(
        "plan: quality {:.1}; leave out {:.0} % of the Gaussians in {} rounds of {} steps, then {} steps \
         with the codec in the loop{done}{further}; about {}",
        plan.quality,
        100.0 * plan.fraction,
        plan.rounds,
        plan.round_steps,
        plan.loop_steps,
        duration(run.estimated_seconds()),
    ));
    let other = |other: TuneEffort| {
        let (name, time) = (other.name(), duration(run.seconds_with(other)));
        let bytes = other.bytes_over_quick() / effort.bytes_over_quick() - 1.0;
        let fewer = if bytes < 0.0 { "fewer" } else { "more" };
        format!("{name} takes about {time}, for {:.0} % {fewer} bytes", 100.0 * bytes.abs())
    };
    let others = TuneEffort::ALL.into_iter().filter(|&e| e != effort).map(other);
    let others = others.collect::<Vec<_>>().join("; ");
    note(format_args!("other efforts, at equal PSNR: {others}"));
}

fn picture(folder: &Path, camera: &Camera, p: &Progress<'_>) -> Result<()> {
    let file = folder.join(format!("step-{:06}.png", p.step));
    let image = render(p.scene, camera, &RenderOptions::default());
    pictures::write(&image, Output::open::<&Path>(&file, true, &[])?)
}

/// Reports what has been written.
fn tell(
    args: &TuneArgs,
    name: &str,
    origin: Option<&Origin>,
    distilled: bool,
    outcome: &TuneOutcome,
    report: Reporter,
) -> Result<()> {
    let bytes = outcome.encoded.bytes.len() as u64;
    let ended = if outcome.cancelled { StopReason::Cancelled } else { StopReason::Steps };
    let gaussians = outcome.scene.len();
    let of = match distilled {
        true => "renders of the input".into(),
        false => format!("the photos kept aside (input model: {})", words(&outcome.input_scores)),
    };
    let elsewhere = outcome.against_input.map_or(String::new(), |shown| {
        let AgainstInput { nearby, around, .. } = shown;
        let both = match (nearby - around).abs() > WORSE_ELSEWHERE {
            true => format!(" (near the cameras {nearby:.2}, around the model {around:.2})"),
            false => String::new(),
        };
        format!("; elsewhere {:.2} dB from renders of the input{both}", shown.elsewhere())
    });
    let human = format!(
        "{} steps in {:.1} s: {ended}\n{name}: {gaussians} Gaussians, {}; {} at {of}{elsewhere}",
        outcome.steps,
        outcome.seconds,
        DecimalBytes(bytes),
        words(&outcome.scores),
    );
    let input = |score: fn(Scores) -> f64| (!distilled).then(|| score(outcome.input_scores));
    let json = json!({
        "output": name,
        "cameras": origin.map(Origin::json),
        "gaussians": gaussians,
        "outliers": outcome.outliers,
        "bytes": bytes,
        "counted_bytes": outcome.counted_bytes,
        "psnr": outcome.scores.psnr,
        "ssim": outcome.scores.ssim,
        "ssimulacra2": outcome.scores.ssimulacra2,
        "input_psnr": input(|s| s.psnr),
        "input_ssim": input(|s| s.ssim),
        "input_ssimulacra2": input(|s| s.ssimulacra2),
        "elsewhere_psnr": outcome.against_input.map(|shown| shown.elsewhere()),
        "quality": outcome.quality,
        "distilled": distilled,
        "steps": outcome.steps,
        "seconds": outcome.seconds,
        "reason": ended.to_string(),
        "target_reached": outcome.reached,
        "parts": parts(&outcome.encoded.parts()),
    });
    report.say(false, &human, &json)?;
    if loss(outcome.scores.psnr, outcome.input_scores.psnr) < finetune::Likeness::POOR {
        note(format_args!(
            "warning: the loss is easy to see; use a higher --quality, or a larger target"
        ));
    }
    if let Some(shown) = outcome.against_input
        && shown.elsewhere() < WELL_ELSEWHERE.min(shown.aside - WORSE_ELSEWHERE)
    {
        let (aside, elsewhere) = (shown.aside, shown.elsewhere());
        let remedy = if args.drop_unseen {
            "without --drop-unseen the rest is kept"
        } else {
            "more views help"
        };
        note(format_args!(
            "warning: away from the cameras the stream is worse than at the cameras: {elsewhere:.1} against \
             {aside:.1} dB from the input; {remedy}"
        ));
    }
    match (outcome.reached, args.target()) {
        (true, _) | (_, Target::Quality(_)) => Ok(()),
        (false, Target::Bytes(wanted)) => Err(missed(format!(
            "{name}: written, but {bytes} bytes are above the target of {wanted}"
        ))),
        (false, Target::Psnr(db)) => Err(missed(format!(
            "{name}: written, but {:.2} dB are below the target of {db} dB",
            outcome.scores.psnr
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
        // Compared with renders of the input itself, the tune has added all of the error.
        assert!((loss(30.0, f64::INFINITY) - 30.0).abs() < 1e-9);
        // 3 dB below 30 dB is as much again as there was.
        assert!((loss(26.9897, 30.0) - 30.0).abs() < 1e-3);
        assert!(loss(31.0, 30.0) == 100.0);
    }
}
