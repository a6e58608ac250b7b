//! `cargo xtask train`: a model from the photos of a scene, to tune and to measure with.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use eval::measure;
use eval::progress::Bar;
use eval::scenes;
use gs_model::View;
use gs_model::dataset::{self, HOLD_OUT_EVERY};
use tune::{Train, TrainOptions};

/// Flags of `cargo xtask train`.
#[derive(Debug, clap::Args)]
pub(crate) struct TrainArgs {
    /// A scene of scenes.toml, or a folder with photos and a COLMAP model.
    scene: String,
    /// Most Gaussians.
    #[arg(long, default_value_t = TrainOptions::default().cap)]
    cap: usize,
    /// Steps, one view each.
    #[arg(long, default_value_t = TrainOptions::default().steps)]
    steps: u64,
    /// Seed of the views' order, the noise and the places of new Gaussians.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Train a model that is drawn with opacities that make up for the blur of its small Gaussians (Mip-Splatting).
    #[arg(long)]
    antialiased: bool,
    /// Where the model goes [default: out/train/SCENE.ply]. A checkpoint beside it is continued; it is removed at the
    /// end.
    #[arg(long)]
    out: Option<PathBuf>,
}

/// Trains a model, and compares it with the photos that are held out.
///
/// # Errors
/// If the scene has no points or no photos, or the model cannot be written.
pub(crate) fn run(args: &TrainArgs) -> Result<()> {
    let dir = scenes::dir_of(&args.scene).unwrap_or_else(|_| args.scene.clone().into());
    // A missing folder is the first error.
    let views = dataset::open_views(&dir)?;
    let points = dataset::open_points(&dir)?;
    let (mut training, mut held_out) = (Vec::new(), Vec::new());
    for (i, view) in views.into_iter().enumerate() {
        let list = if i % HOLD_OUT_EVERY == 0 { &mut held_out } else { &mut training };
        list.push(view);
    }
    eprintln!(
        "{}: {} points, {} photos to train on, {} held out",
        dir.display(),
        points.len(),
        training.len(),
        held_out.len()
    );
    let training = photos(&dir, &training)?;
    let held_out = photos(&dir, &held_out)?;
    let name = dir.file_name().map_or_else(|| "scene".into(), |name| name.to_string_lossy());
    let out = args.out.clone().unwrap_or_else(|| scenes::trained(&scenes::root(), &name));
    if let Some(folder) = out.parent() {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make {}", folder.display()))?;
    }
    let checkpoint = out.with_extension("checkpoint");
    let options = TrainOptions {
        steps: args.steps,
        cap: args.cap,
        seed: args.seed,
        antialiased: args.antialiased,
        checkpoint: Some(checkpoint.clone()),
        ..TrainOptions::default()
    };
    let run = Train::new(&points, training, options)?;
    if run.steps_done() > 0 {
        eprintln!("goes on after step {} ({})", run.steps_done(), checkpoint.display());
    }
    let bar = Bar::new("train", args.steps);
    bar.step(run.steps_done());
    let mut last = run.steps_done();
    let trained = run.run(|p| {
        let psnr = p.pass_psnr.map(|db| format!(", {db:.2} dB at the photos")).unwrap_or_default();
        bar.note(&format!("train: {} Gaussians{psnr}", p.gaussians));
        bar.step(p.step - last);
        last = p.step;
        if let Some(error) = p.checkpoint_failed {
            eprintln!("warning: {}; the run goes on without checkpoints", gs_model::chain(error));
        }
    })?;
    bar.done();
    gs_model::ply::write(&out, &trained.scene)?;
    // The model is complete: its checkpoint is no longer needed.
    let _ = std::fs::remove_file(&checkpoint);
    let score = measure::score("held-out photos", &trained.scene, &held_out);
    println!(
        "{}: {} Gaussians, {} steps, {:.0} s; held-out photos: {:.2} dB, SSIM {:.4}",
        out.display(),
        trained.scene.len(),
        trained.steps,
        trained.seconds,
        score.psnr_db,
        score.ssim
    );
    Ok(())
}

/// Photos, with what is to be said of them.
fn photos(dir: &Path, views: &[View]) -> Result<Vec<finetune::TrainView>> {
    if views.is_empty() {
        bail!("{}: every {HOLD_OUT_EVERY}th photo is held out, none is left", dir.display());
    }
    let read = tune::photos(dir, views)?;
    if read.views.is_empty() {
        let images = dir.join("images");
        bail!("{}: none of the photos that the cameras name is there", images.display());
    }
    read.warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));
    Ok(read.views)
}
