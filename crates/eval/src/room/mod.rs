//! Makes the default scene, `fixtures/room`, from a seed: a path-traced room with cameras and
//! photos, and a model sampled from its surfaces and fitted to the photos.

mod fit;
mod furniture;
mod light;
mod noise;
mod paint;
mod patch;
mod raytrace;
mod sample;
mod sh_fit;
mod shape;
mod write;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use gs_model::dataset::{Dataset, HOLD_OUT_EVERY};
use gs_model::{Camera, Scene};

use crate::progress::Bar;
use crate::{measure, pictures};

/// What [`run`] makes.
#[derive(Clone, Debug)]
pub struct Options {
    /// Folder to write, replacing what is there.
    pub out: PathBuf,
    /// Seed of every random number.
    pub seed: u64,
    /// Number of photos.
    pub views: u32,
    /// Light paths per pixel.
    pub samples: u32,
    /// Number of Gaussians, about.
    pub gaussians: usize,
    /// Optimiser steps that fit the model to the training photos.
    pub steps: u64,
    /// Write only the model: keep photos and cameras that are already there.
    pub model_only: bool,
}

/// Makes the fixture.
///
/// # Errors
/// If the folder cannot be written or the fit fails.
pub fn run(args: &Options) -> Result<()> {
    let room = furniture::Room::furnished();
    let cameras = raytrace::tour(args.views);
    if !args.model_only {
        photos(args, &room, &cameras)?;
    }
    let training: Vec<Camera> = cameras
        .iter()
        .enumerate()
        .filter(|(i, _)| i % HOLD_OUT_EVERY != 0)
        .map(|(_, c)| c.clone())
        .collect();
    let scene = sample::gaussians(&room, &training, args.gaussians, args.seed);
    let sparse = args.out.join("sparse/0");
    fs::create_dir_all(&sparse).with_context(|| format!("create {}", sparse.display()))?;
    let put = |name: &str, text: String| {
        fs::write(sparse.join(name), text).with_context(|| format!("write {name}"))
    };
    if let Some(camera) = cameras.first() {
        put("cameras.txt", write::cameras_txt(camera))?;
    }
    put("images.txt", write::images_txt(&cameras))?;
    put("points3D.txt", write::points_txt(&scene, 4))?;
    let model = args.out.join("point_cloud.ply");
    let save = |scene: &Scene| {
        gs_model::ply::write(&model, scene).with_context(|| format!("write {}", model.display()))
    };
    save(&scene)?;

    let dataset = Dataset::open(&args.out).context("read the fixture back")?;
    let scene = if args.steps == 0 {
        scene
    } else {
        let fitted = fit::fit(scene, &dataset, args.steps, args.seed)?;
        save(&fitted)?;
        fitted
    };
    let views = measure::load(dataset.held_out())?;
    let (score, _) = measure::score(&scene, &views, &Bar::new("score", views.len() as u64));
    let facts = write::Facts {
        seed: args.seed,
        samples: args.samples,
        views: cameras.len(),
        gaussians: scene.len(),
        steps: args.steps,
        held_out_psnr_db: score.psnr_db,
        held_out_ssim: score.ssim,
        held_out_views: views.len(),
        command: command(args),
    };
    let readme = write::readme(&facts, (raytrace::WIDTH, raytrace::HEIGHT));
    fs::write(args.out.join("README.md"), readme).context("write README.md")?;

    let bytes = folder_bytes(&args.out)?;
    println!(
        "held out: {:.3} dB PSNR, {:.4} SSIM over {} views",
        score.psnr_db,
        score.ssim,
        views.len()
    );
    println!(
        "{}: {} photos, {} Gaussians, {:.2} MB in all",
        args.out.display(),
        cameras.len(),
        scene.len(),
        bytes as f64 / 1e6
    );
    Ok(())
}

/// The command that makes this fixture again.
fn command(args: &Options) -> String {
    format!(
        "cargo xtask fixture --seed {} --views {} --samples {} --gaussians {} --steps {}",
        args.seed, args.views, args.samples, args.gaussians, args.steps
    )
}

fn photos(args: &Options, room: &furniture::Room, cameras: &[Camera]) -> Result<()> {
    let images = args.out.join("images");
    if images.exists() {
        fs::remove_dir_all(&images).with_context(|| format!("clear {}", images.display()))?;
    }
    fs::create_dir_all(&images).with_context(|| format!("create {}", images.display()))?;
    let rows = cameras.iter().map(|c| u64::from(c.height)).sum();
    let bar = Bar::new("take photos", rows);
    for camera in cameras {
        let rgb = raytrace::photo(room, camera, args.seed, args.samples, &bar);
        pictures::write_rgb8(&images.join(&camera.name), &rgb, camera.width, camera.height)?;
    }
    bar.done();
    Ok(())
}

fn folder_bytes(dir: &Path) -> Result<u64> {
    let mut sum = 0;
    for entry in fs::read_dir(dir).with_context(|| format!("list {}", dir.display()))? {
        let entry = entry?;
        let meta = entry.metadata()?;
        sum += if meta.is_dir() { folder_bytes(&entry.path())? } else { meta.len() };
    }
    Ok(sum)
}
