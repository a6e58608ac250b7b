//! Peak memory of every stage. Each stage runs in a process of its own, so that memory which an
//! earlier stage left behind does not count.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use finetune::{RenderOptions, TrainView};
use gs_model::{Scene, ply};
use gsvx::{DecodeOptions, Decoder, EncodeOptions, Prepared, Seen, importance};
use serde::{Deserialize, Serialize};
use tune::{FineTune, FineTuneOptions};

use crate::scenes::{self, SceneFiles};
use crate::usage;

/// The stages, in the order in which a model passes them.
const STAGES: [&str; 14] = [
    "read PLY",
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
const STREAMS: &str = "streams";

/// Memory of one stage, MB (10^6 bytes).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Peak {
    #[serde(default)]
    pub(super) stage: String,
    /// Resident before the stage: its inputs, and what the allocator kept of making them.
    pub(super) before: f64,
    /// Greatest while it ran.
    pub(super) peak: f64,
}

/// How to start a process that calls [`child`] with this scene, stage and scratch folder.
type Child = fn(&str, &str, &Path) -> std::io::Result<Command>;

/// Runs every stage on the scene in a child process.
pub(super) fn measure(scene: &str, child: Child) -> Result<Vec<Peak>> {
    let dir = tempfile::tempdir().context("make a temporary folder")?;
    let run = |stage: &str| -> Result<Vec<u8>> {
        let out = child(scene, stage, dir.path())?.output()?;
        let error = String::from_utf8_lossy(&out.stderr);
        ensure!(out.status.success(), "memory of {stage}: {error}");
        Ok(out.stdout)
    };
    // By another process, so that nothing of making the streams is in memory when they are decoded.
    run(STREAMS)?;
    let peak = |stage: &str| -> Result<Peak> {
        let out = run(stage)?;
        let peak: Peak = serde_json::from_slice(&out).context("the child's answer")?;
        Ok(Peak { stage: stage.into(), ..peak })
    };
    STAGES.iter().map(|stage| peak(stage)).collect()
}

/// Runs `f` and returns the resident memory before it and at its peak.
fn peak_of<T>(f: impl FnOnce() -> Result<T>) -> Result<Peak> {
    let before = usage::resident_bytes() as f64 / 1e6;
    usage::reset_peak();
    let made = f()?;
    let peak = usage::peak_mb();
    drop(made);
    Ok(Peak { stage: String::new(), before, peak })
}

/// Makes the inputs of one stage, runs it and prints its peak memory as JSON, in a process that
/// does nothing else. [`run`](super::run) starts it.
///
/// # Errors
/// If there is no such scene or stage, or the stage fails.
pub fn child(scene: &str, stage: &str, scratch: &Path) -> Result<()> {
    let found = scenes::find(scene)?;
    if stage == STREAMS {
        return write_streams(&found, scratch);
    }
    let peak = match stage {
        "read PLY" => peak_of(|| Ok(ply::read(&found.dataset.model_path)?))?,
        "voxelize" | "merge" | "octree of all leaves" | "encode, voxelized and merged before" => {
            of_voxelization(&found, stage)?
        }
        "encode" | "encode --lod" | "encode --lossless" => of_encoder(&found, stage)?,
        "decode" | "decode in blocks" => of_decoder(stage, &stream(scratch))?,
        "decode, lossless" => of_decoder("decode", &lossless_stream(scratch))?,
        "write PLY" | "render one view" | "fine-tune, one step" => {
            of_decoded(&found, stage, scratch)?
        }
        _ => bail!("no stage {stage}; stages: {}", STAGES.join(", ")),
    };
    println!("{}", serde_json::to_string(&peak)?);
    Ok(())
}

fn model(found: &SceneFiles) -> Result<Scene> {
    let (mut scene, _) = ply::read(&found.dataset.model_path)?;
    scene.drop_invalid();
    Ok(scene)
}

/// The scene's stream at default quality.
fn stream(scratch: &Path) -> PathBuf {
    scratch.join("model.gsvx")
}

/// The scene bit for bit.
fn lossless_stream(scratch: &Path) -> PathBuf {
    scratch.join("lossless.gsvx")
}

/// Writes [`stream`] and [`lossless_stream`].
fn write_streams(found: &SceneFiles, scratch: &Path) -> Result<()> {
    let scene = model(found)?;
    let write = |path: PathBuf, bytes: Vec<u8>| {
        std::fs::write(&path, bytes).with_context(|| format!("write {}", path.display()))
    };
    write(stream(scratch), gsvx::encode(&scene, &EncodeOptions::default())?.bytes)?;
    write(lossless_stream(scratch), gsvx::encode_lossless(&scene, false)?.bytes)
}

/// The steps of an encoder one after the other, and its last step alone.
fn of_voxelization(found: &SceneFiles, stage: &str) -> Result<Peak> {
    let scene = model(found)?;
    let voxelize = || {
        let guess = importance::without_cameras(&scene);
        let strategy = gsvx::default_strategy(gsvx::DEFAULT_QUALITY, &guess, Seen::Guessed)?;
        Ok(voxel::voxelize(&scene, &voxel::Cube::of(&scene.means)?, &strategy)?)
    };
    match stage {
        "voxelize" => peak_of(voxelize),
        "merge" => {
            let voxels = voxelize()?;
            peak_of(|| Ok(voxel::merge(&scene, &voxels, voxel::Merge::Moments)?))
        }
        "octree of all leaves" => {
            let voxels = voxelize()?;
            drop(scene);
            peak_of(|| Ok(gpcc_lite::geometry::encode(&voxels.leaves, voxels.j_high)?))
        }
        _ => {
            let mut options = EncodeOptions::default();
            let Prepared { scene: merged, voxels, importance, .. } =
                gsvx::prepare(&scene, &options)?;
            drop(scene);
            options.importance = Some(importance);
            peak_of(|| Ok(gsvx::encode_voxels(&merged, &voxels, None, &options)?))
        }
    }
}

/// The whole encoder, from a trained model to a stream.
fn of_encoder(found: &SceneFiles, stage: &str) -> Result<Peak> {
    let scene = model(found)?;
    if stage == "encode --lossless" {
        return peak_of(|| Ok(gsvx::encode_lossless(&scene, false)?));
    }
    let mut options = EncodeOptions::default();
    options.lod = stage == "encode --lod";
    peak_of(|| Ok(gsvx::encode(&scene, &options)?))
}

/// A decoder that returns the scene, or hands out blocks that the caller does not keep.
fn of_decoder(stage: &str, stream: &Path) -> Result<Peak> {
    let bytes = std::fs::read(stream)?;
    if stage == "decode" {
        return peak_of(|| Ok(gsvx::decode(&bytes)?));
    }
    peak_of(|| {
        let decoder = Decoder::new(&bytes, &DecodeOptions::default())?;
        let visit = |(): &mut (), _: usize, block: &Scene| {
            std::hint::black_box(block);
            Ok::<(), gsvx::Error>(())
        };
        Ok(decoder.blocks(visit)?)
    })
}

/// What is done with a decoded scene.
fn of_decoded(found: &SceneFiles, stage: &str, scratch: &Path) -> Result<Peak> {
    let scene = gsvx::decode(&std::fs::read(stream(scratch))?)?;
    let view = found.dataset.held_out().next().context("no view")?;
    match stage {
        "write PLY" => peak_of(|| Ok(ply::write(scratch.join("model.ply"), &scene)?)),
        "render one view" => {
            peak_of(|| Ok(finetune::render(&scene, &view.camera, &RenderOptions::default())))
        }
        _ => {
            let photo = crate::measure::read_photo(&view.image_path)?;
            let camera = view.camera.scaled_to(photo.width, photo.height);
            let camera = camera.with_context(|| format!("{}", view.image_path.display()))?;
            let options = FineTuneOptions { steps: 1, ..Default::default() };
            let tune = FineTune::new(scene, vec![TrainView { camera, photo }], options)?;
            peak_of(|| Ok(tune.run(|_| ())?))
        }
    }
}
