//! `gsvx compare`.

use crate::attribute_errors::AttributeErrors;
use crate::report::Reporter;
use crate::views::ViewArgs;
use crate::{input, progress};
use anyhow::Result;
use finetune::{RenderOptions, metrics, render};
use gs_model::{Camera, Scene};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx compare model.ply scene.gsvx --cameras data/fox
  gsvx compare model.ply scene.gsvx --orbit 12
  gsvx compare model.ply scene.spz --orbit 12 --json";

/// Arguments of `gsvx compare`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The reference: a stream, PLY, .splat or SPZ.
    reference: PathBuf,
    /// The model that is judged: a stream, PLY, .splat or SPZ.
    model: PathBuf,
    #[command(flatten)]
    views: ViewArgs,
    /// Leave out Gaussians with NaN, infinity or a zero quaternion instead of failing.
    #[arg(long)]
    drop_invalid: bool,
}

struct Seen {
    name: String,
    psnr: f64,
    ssim: f64,
}

/// Compares two models. PSNR and SSIM are of the float renders, clamped to 0..=1; means are over the
/// views' figures.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let a = input::any(&args.reference, args.drop_invalid)?;
    let b = input::any(&args.model, args.drop_invalid)?;
    let cameras = args.views.cameras(&a)?;
    let bar = progress::bar("compare", cameras.len() as u64);
    let mut seen = Vec::with_capacity(cameras.len());
    for camera in &cameras {
        seen.push(look(&a, &b, camera));
        bar.inc(1);
    }
    bar.finish_and_clear();
    let n = seen.len() as f64;
    let psnr = seen.iter().map(|s| s.psnr).sum::<f64>() / n;
    let ssim = seen.iter().map(|s| s.ssim).sum::<f64>() / n;
    let mut human = format!(
        "{}: {} Gaussians, SH degree {}\n{}: {} Gaussians, SH degree {}\n",
        args.reference.display(),
        a.len(),
        a.sh_degree,
        args.model.display(),
        b.len(),
        b.sh_degree,
    );
    human +=
        &format!("renders, mean over {} views: PSNR {psnr:.3} dB, SSIM {ssim:.5}\n", seen.len());
    if let Some(worst) = seen.iter().min_by(|x, y| x.psnr.total_cmp(&y.psnr)) {
        human += &format!(
            "  worst: {} with PSNR {:.3} dB, SSIM {:.5}\n",
            worst.name, worst.psnr, worst.ssim
        );
    }
    let errors = AttributeErrors::of(&a, &b);
    human +=
        &errors.as_ref().map_or("attributes: a model is empty\n".into(), AttributeErrors::human);
    let json = json!({
        "gaussians": [a.len(), b.len()],
        "sh_degree": [a.sh_degree, b.sh_degree],
        "psnr": finite(psnr),
        "ssim": finite(ssim),
        "views": seen
            .iter()
            .map(|s| json!({ "name": s.name, "psnr": finite(s.psnr), "ssim": finite(s.ssim) }))
            .collect::<Vec<_>>(),
        "attributes": errors.as_ref().map(AttributeErrors::json),
    });
    report.say(false, human.trim_end(), &json);
    Ok(())
}

fn look(a: &Scene, b: &Scene, camera: &Camera) -> Seen {
    let reference = render(a, camera, &RenderOptions::default());
    let image = render(b, camera, &RenderOptions::default());
    Seen {
        name: camera.name.clone(),
        psnr: metrics::psnr(&image, &reference),
        ssim: metrics::ssim(&image, &reference),
    }
}

/// JSON has no infinity: null stands for it (equal images).
fn finite(v: f64) -> Value {
    if v.is_finite() { json!(v) } else { Value::Null }
}
