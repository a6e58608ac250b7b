//! `gsvx compare`.

mod frames;
mod hint;
mod photos;

use crate::attribute_errors::AttributeErrors;
use crate::commands::sequence;
use crate::exit::{note, usage};
use crate::frame_source::is_sequence_path;
use crate::input::ReadingAny;
use crate::output::{Output, empty_folder, is_stdio};
use crate::pictures;
use crate::progress::Meter;
use crate::report::Reporter;
use crate::views::{Origin, PlacedCameras, WhichViews};
use anyhow::Result;
use finetune::metrics::Scores;
use finetune::{Image, RenderOptions, render};
use gs_model::{Camera, Scene};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx compare model.ply scene.gsvx --cameras data/fox
  gsvx compare model.ply scene.gsvx --cameras data/fox --every 8 --photos   both against the photos held out
  gsvx compare model.ply scene.gsvx --orbit 12
  gsvx compare model.ply scene.gsvx --orbit 12 -o pictures     reference, model, difference
  gsvx compare model.ply scene.spz --orbit 12 --json
  gsvx compare frames/ clip.gsvx --orbit 4                     some frames of two sequences, and flicker";

#[derive(clap::Args)]
pub(crate) struct CompareArgs {
    /// The reference: a stream or a model of any format. A folder, 'frames/*.ply' in quotes,
    /// and a PLY that moves are sequences.
    reference: PathBuf,
    /// What is judged, in the same forms as the reference.
    model: PathBuf,
    #[command(flatten)]
    views: WhichViews,
    /// Compare both models with the photos of the cameras too.
    #[arg(long, requires = "cameras", conflicts_with = "scale")]
    photos: bool,
    /// Folder for a PNG per view: the reference, the model, and their difference 8 times amplified,
    /// side by side. The worst view is the first.
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Of sequences, compare these frames, counted from 0, and what changes to those after them: 0,17,45 [default: five].
    #[arg(long, value_name = "N,N", value_delimiter = ',', help_heading = sequence::HEADING)]
    frames: Vec<u64>,
    #[command(flatten)]
    reading: ReadingAny,
    /// Replace existing pictures.
    #[arg(long)]
    force: bool,
}

/// How alike both models are in a view.
struct ViewScore<'a> {
    camera: &'a Camera,
    scores: Scores,
    /// Both pictures are black.
    empty: bool,
}

/// Compares two models. PSNR and SSIM are of the float renders, clamped to 0..=1, SSIMULACRA2 of 8-bit ones; means are
/// over the views' figures.
pub(crate) fn run(args: &CompareArgs, report: Reporter) -> Result<()> {
    if is_stdio(&args.reference) && is_stdio(&args.model) {
        return Err(usage("only one of the two models can be standard input"));
    }
    let is_sequence = |path: &Path| is_sequence_path(path, &args.reading.model);
    let sequences = [is_sequence(&args.reference)?, is_sequence(&args.model)?];
    if sequences.contains(&true) {
        if args.photos {
            return Err(usage("--photos: the photos of a scene do not move, as a sequence does"));
        }
        return frames::run(args, report);
    }
    if !args.frames.is_empty() {
        return Err(usage("--frames: neither of the two is a sequence"));
    }
    let folder = args.output.as_deref();
    folder.map_or(Ok(()), |folder| empty_folder(folder, args.force))?;
    let (mut a, _) = args.reading.any(&args.reference)?;
    let (mut b, _) = args.reading.any(&args.model)?;
    // Both relative to one place: the origin of the one that has one.
    let place = if a.origin == [0.0; 3] { b.origin } else { a.origin };
    // The format of the second model may have lost the origin.
    let lost = a.origin != b.origin && b.origin == [0.0; 3];
    let unmoved = lost.then(|| b.means.clone());
    [&mut a, &mut b].into_iter().for_each(|scene| scene.move_origin(place));
    let PlacedCameras { cameras, origin } = args.views.cameras(&a, &args.reference)?;
    let photos = if args.photos { args.views.photos(&cameras, place)? } else { Vec::new() };
    let seen = score_views(&a, &b, &cameras);
    let to_photos = photos::scores([&a, &b], &photos);
    let mut order: Vec<_> = seen.iter().collect();
    order.sort_by(|x, y| x.scores.psnr.total_cmp(&y.scores.psnr));
    let pictures = match folder {
        Some(folder) => write_pictures(&a, &b, &order, folder, args.force)?,
        None => Vec::new(),
    };
    let scores = Scores::mean(&seen.iter().map(|s| s.scores).collect::<Vec<_>>());
    let errors = AttributeErrors::of(&a, &b);
    let model = |path: &Path, scene: &Scene| {
        let (gaussians, degree) = (scene.len(), scene.sh_degree);
        format!("{}: {gaussians} Gaussians, SH degree {degree}\n", path.display())
    };
    let mut human = model(&args.reference, &a) + &model(&args.model, &b);
    if let Some(origin) = &origin {
        human += &format!("{}\n", origin.human());
    }
    human += &format!("renders, mean over {} views: {}\n", seen.len(), words(&scores));
    if let Some(worst) = order.first() {
        human += &format!("  worst: {} with {}\n", worst.camera.name, words(&worst.scores));
    }
    if let Some(scores) = &to_photos {
        human += &photos::human(scores, photos.len());
    }
    if seen.iter().all(|s| s.empty) {
        note(
            "warning: nothing of either model shows in any view, so the renders say nothing; give --cameras",
        );
    }
    if let (Some(folder), Some(first)) = (folder, pictures.first()) {
        let (n, folder) = (pictures.len(), folder.display());
        human += &format!("  {n} pictures in {folder}, the worst view first: {first}\n");
    }
    human +=
        &errors.as_ref().map_or("attributes: a model is empty\n".into(), AttributeErrors::human);
    let view = |s: &ViewScore<'_>| {
        let mut view = scores_json(&s.scores);
        view["name"] = json!(s.camera.name);
        view
    };
    let mut json = scores_json(&scores);
    json["gaussians"] = json!([a.len(), b.len()]);
    json["sh_degree"] = json!([a.sh_degree, b.sh_degree]);
    json["cameras"] = origin.as_ref().map_or(Value::Null, Origin::json);
    json["views"] = seen.iter().map(view).collect();
    json["pictures"] = json!(pictures);
    json["photos"] = to_photos.map_or(Value::Null, |scores| json!(scores.map(|s| scores_json(&s))));
    json["attributes"] = errors.as_ref().map_or(Value::Null, AttributeErrors::json);
    if let Some(hint) = hint::hint(&a, b, unmoved, &cameras, scores.psnr) {
        note(format_args!("hint: {hint}"));
    }
    report.say(false, human.trim_end(), &json)
}

/// For a person. Pictures below 8 pixels have no SSIMULACRA2.
pub(crate) fn words(scores: &Scores) -> String {
    let Scores { psnr, ssim, ssimulacra2 } = scores;
    let third = if ssimulacra2.is_nan() { "none".into() } else { format!("{ssimulacra2:.2}") };
    format!("PSNR {psnr:.3} dB, SSIM {ssim:.5}, SSIMULACRA2 {third}")
}

/// As JSON; null for what is not finite.
pub(crate) fn scores_json(scores: &Scores) -> Value {
    let Scores { psnr, ssim, ssimulacra2 } = *scores;
    json!({ "psnr": finite(psnr), "ssim": finite(ssim), "ssimulacra2": finite(ssimulacra2) })
}

fn render_both(a: &Scene, b: &Scene, camera: &Camera) -> [Image; 2] {
    [a, b].map(|scene| render(scene, camera, &RenderOptions::default()))
}

/// Compares both models from every camera.
fn score_views<'a>(a: &Scene, b: &Scene, cameras: &'a [Camera]) -> Vec<ViewScore<'a>> {
    let steps = Meter::new("compare", cameras.len());
    let mut seen = Vec::with_capacity(cameras.len());
    for camera in cameras {
        let [reference, image] = render_both(a, b, camera);
        let scores = Scores::of(&image, &reference);
        let empty = [&reference, &image].iter().all(|i| i.to_rgb8().iter().all(|&v| v == 0));
        seen.push(ViewScore { camera, scores, empty });
        steps.inc();
    }
    seen
}

/// Writes a picture per view. Returns their names. Views are drawn again: kept images of many
/// large views would not fit into memory.
fn write_pictures(
    a: &Scene,
    b: &Scene,
    order: &[&ViewScore<'_>],
    dir: &Path,
    force: bool,
) -> Result<Vec<String>> {
    let digits = order.len().to_string().len();
    let steps = Meter::new("pictures", order.len());
    let mut names = Vec::with_capacity(order.len());
    for (rank, view) in order.iter().enumerate() {
        let stem = pictures::stem(&view.camera.name).unwrap_or_default();
        let path = dir.join(format!("{:0digits$}-{stem}.png", rank + 1));
        let output = Output::open::<&Path>(&path, force, &[])?;
        names.push(output.name());
        let [reference, image] = render_both(a, b, view.camera);
        pictures::write(&pictures::side_by_side(&reference, &image), output)?;
        steps.inc();
    }
    Ok(names)
}

/// JSON has no infinity: null stands for it (equal images).
fn finite(v: f64) -> Value {
    if v.is_finite() { json!(v) } else { Value::Null }
}
