//! The stages that a model passes, one by one.

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use finetune::{RenderOptions, TrainView};
use gs_model::{Scene, ply};
use gsvx::{DecodeOptions, Decoder, EncodeOptions, Prepared, Seen, importance};
use serde::{Deserialize, Serialize};
use tune::{FineTune, FineTuneOptions};
use voxel::{Merge, Voxelization};

use crate::scenes::SceneFiles;
use crate::{measure, usage};

/// In the order in which a model passes them.
pub(super) const STAGES: [&str; 16] = [
    "read PLY",
    "importance, from cameras",
    "importance, guessed",
    "voxelize",
    "merge",
    "octree of all leaves",
    "encode, voxelized and merged before",
    "encode",
    "encode --lod",
    "encode --lossless",
    "decode",
    "decode in blocks",
    "decode, lossless",
    "write PLY",
    "render one view",
    "fine-tune, one step",
];

/// The call of [`child`] that makes the streams for the stages of the decoder.
pub(super) const STREAMS: &str = "streams";
/// Their files: at the default quality, and bit for bit.
const STREAM: &str = "model.gsvx";
const LOSSLESS: &str = "lossless.gsvx";

/// What one stage took.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Cost {
    /// Seconds of the fastest repetition: on the clock, and of all threads.
    pub(super) wall: f64,
    pub(super) cpu: f64,
    /// MB (10^6 bytes) resident before the stage: its inputs, and what the allocator kept of making them.
    pub(super) before: f64,
    /// Greatest while it ran.
    pub(super) peak: f64,
}

/// What a stage does, again and again.
type Work = Box<dyn FnMut() -> Result<()>>;

fn work<T>(mut f: impl FnMut() -> Result<T> + 'static) -> Work {
    Box::new(move || {
        black_box(f()?);
        Ok(())
    })
}

/// Makes the inputs of one stage, runs it and prints its cost as JSON, in a process that does nothing else.
///
/// # Errors
/// If there is no such stage, or it fails.
pub(super) fn child(found: &SceneFiles, stage: &str, scratch: &Path, repeat: usize) -> Result<()> {
    if stage == STREAMS {
        let scene = model(found)?;
        std::fs::write(
            scratch.join(STREAM),
            gsvx::encode(&scene, &EncodeOptions::default())?.bytes,
        )?;
        std::fs::write(scratch.join(LOSSLESS), gsvx::encode_lossless(&scene, false)?.bytes)?;
        return Ok(());
    }
    let mut work = match stage {
        "read PLY" | "importance, from cameras" | "importance, guessed" => of_input(found, stage)?,
        "voxelize" | "merge" | "octree of all leaves" => of_voxelization(found, stage)?,
        _ if stage.starts_with("encode") => of_encoder(found, stage)?,
        _ if stage.starts_with("decode") => of_decoder(stage, scratch)?,
        _ => of_decoded(found, stage, scratch)?,
    };
    let mut cost = Cost { wall: f64::MAX, cpu: f64::MAX, before: 0.0, peak: 0.0 };
    cost.before = usage::resident_bytes() as f64 / 1e6;
    usage::reset_peak();
    for _ in 0..repeat.max(1) {
        let (start, cpu) = (Instant::now(), usage::cpu_seconds());
        work()?;
        cost.cpu = cost.cpu.min(usage::cpu_seconds() - cpu);
        cost.wall = cost.wall.min(start.elapsed().as_secs_f64());
    }
    cost.peak = usage::peak_bytes() as f64 / 1e6;
    println!("{}", serde_json::to_string(&cost)?);
    Ok(())
}

fn model(found: &SceneFiles) -> Result<Scene> {
    let (mut scene, _) = ply::read(&found.dataset.model_path)?;
    scene.drop_invalid();
    Ok(scene)
}

fn of_input(found: &SceneFiles, stage: &str) -> Result<Work> {
    let path = found.dataset.model_path.clone();
    if stage == "read PLY" {
        return Ok(work(move || Ok(ply::read(&path)?)));
    }
    let scene = model(found)?;
    if stage == "importance, guessed" {
        return Ok(work(move || Ok(importance::without_cameras(&scene))));
    }
    let cameras: Vec<_> = found.dataset.training().map(|v| v.camera.clone()).collect();
    Ok(work(move || Ok(finetune::saliency(&scene, &cameras))))
}

/// The leaves of the default.
fn voxelize(scene: &Scene) -> Result<Voxelization> {
    let guess = importance::without_cameras(scene);
    let strategy = gsvx::default_strategy(gsvx::DEFAULT_QUALITY, &guess, Seen::Guessed)?;
    Ok(voxel::voxelize(scene, &voxel::cube_of(&scene.means)?, &strategy)?)
}

fn of_voxelization(found: &SceneFiles, stage: &str) -> Result<Work> {
    let scene = model(found)?;
    if stage == "voxelize" {
        return Ok(work(move || voxelize(&scene)));
    }
    let voxels = voxelize(&scene)?;
    if stage == "merge" {
        return Ok(work(move || Ok(voxel::merge(&scene, &voxels, Merge::Moments)?)));
    }
    drop(scene);
    Ok(work(move || Ok(gpcc_lite::geometry::encode(voxels.octree())?)))
}

fn of_encoder(found: &SceneFiles, stage: &str) -> Result<Work> {
    let scene = model(found)?;
    let mut options = EncodeOptions::default();
    options.lod = stage == "encode --lod";
    match stage {
        "encode --lossless" => Ok(work(move || Ok(gsvx::encode_lossless(&scene, false)?))),
        "encode, voxelized and merged before" => {
            let Prepared { scene: merged, voxels, importance, .. } =
                gsvx::prepare(&scene, &options)?;
            drop(scene);
            options.importance = Some(importance);
            Ok(work(move || Ok(gsvx::encode_voxels(&merged, voxels.octree(), None, &options)?)))
        }
        _ => Ok(work(move || Ok(gsvx::encode(&scene, &options)?))),
    }
}

/// A decoder that returns the scene, or hands out blocks that the caller does not keep.
fn of_decoder(stage: &str, scratch: &Path) -> Result<Work> {
    let file = if stage == "decode, lossless" { LOSSLESS } else { STREAM };
    let bytes = std::fs::read(scratch.join(file))?;
    if stage != "decode in blocks" {
        return Ok(work(move || Ok(gsvx::decode(&bytes)?)));
    }
    Ok(work(move || {
        let decoder = Decoder::new(&bytes, &DecodeOptions::default())?;
        let visit = |(): &mut (), _: usize, block: &Scene| {
            black_box(block);
            Ok::<(), gsvx::Error>(())
        };
        Ok(decoder.blocks(visit)?)
    }))
}

/// What is done with a decoded scene.
fn of_decoded(found: &SceneFiles, stage: &str, scratch: &Path) -> Result<Work> {
    let scene = gsvx::decode(&std::fs::read(scratch.join(STREAM))?)?;
    let views = measure::load(found.dataset.held_out().take(1))?;
    let camera = views.first().context("no view")?.camera.clone();
    match stage {
        "write PLY" => {
            let path = scratch.join("model.ply");
            Ok(work(move || Ok(ply::write(&path, &scene)?)))
        }
        "render one view" => {
            Ok(work(move || Ok(finetune::render(&scene, &camera, &RenderOptions::default()))))
        }
        "fine-tune, one step" => Ok(work(move || step(scene.clone(), views.clone()))),
        _ => bail!("no stage {stage}; stages: {}", STAGES.join(", ")),
    }
}

fn step(scene: Scene, views: Vec<TrainView>) -> Result<()> {
    let options = FineTuneOptions { steps: 1, ..FineTuneOptions::default() };
    FineTune::new(scene, views, options)?.run(|_| ())?;
    Ok(())
}
