//! Peak memory of every stage. Each stage runs in a process of its own, so that memory which an
//! earlier stage left behind does not count.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use finetune::{FineTune, FineTuneOptions, RenderOptions, TrainView};
use gs_model::{Scene, ply};
use gsvx::attributes::group::{Coding, Transform};
use gsvx::attributes::{colour, opacity};
use gsvx::covariance::log_euclidean;
use gsvx::{DecodeOptions, EncodeOptions, Entropy, OpacityDomain, Prepared, Seen, importance};
use serde::{Deserialize, Serialize};

use crate::scenes::{self, SceneFiles};
use crate::usage;

/// The stages, in the order in which a model passes them.
const STAGES: [&str; 18] = [
    "read PLY",
    "voxelize",
    "merge",
    "encode: geometry",
    "encode: importance",
    "encode: transform",
    "encode: opacity",
    "encode: DC",
    "encode: covariance",
    "encode: SH 1",
    "encode: SH 2",
    "encode: SH 3",
    "encode, all sections",
    "decode",
    "write PLY",
    "render one view",
    "fine-tune, one step",
    "encode --lossless",
];

/// The call of [`child`] that makes the stream for the stages of the decoder.
const STREAM: &str = "stream";

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
    // By another process, so that nothing of making the stream is in memory when it is decoded.
    run(STREAM)?;
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
    if stage == STREAM {
        return write_stream(&found, scratch);
    }
    let peak = match stage {
        "read PLY" => peak_of(|| Ok(ply::read(&found.dataset.model_path)?))?,
        "decode" | "write PLY" | "render one view" | "fine-tune, one step" => {
            of_decoded(&found, stage, &stream(scratch), scratch)?
        }
        _ => of_encoder(&found, stage)?,
    };
    println!("{}", serde_json::to_string(&peak)?);
    Ok(())
}

fn model(found: &SceneFiles) -> Result<Scene> {
    let (mut scene, _) = ply::read(&found.dataset.model_path)?;
    scene.drop_invalid();
    Ok(scene)
}

fn prepared(scene: &Scene) -> Result<Prepared> {
    let choose = |found: &[f32], seen| gsvx::default_strategy(gsvx::DEFAULT_QUALITY, found, seen);
    Ok(gsvx::prepare(scene, choose, None)?)
}

/// The scene's stream at default quality.
fn stream(scratch: &Path) -> PathBuf {
    scratch.join("model.gsvx")
}

/// Writes [`stream`].
fn write_stream(found: &SceneFiles, scratch: &Path) -> Result<()> {
    let scene = model(found)?;
    let Prepared { scene, voxels, importance } = prepared(&scene)?;
    let options = EncodeOptions { importance: Some(importance), ..Default::default() };
    let path = stream(scratch);
    std::fs::write(&path, gsvx::encode(&scene, &voxels, &options)?.bytes)
        .with_context(|| format!("write {}", path.display()))
}

fn of_encoder(found: &SceneFiles, stage: &str) -> Result<Peak> {
    let scene = model(found)?;
    let choose =
        |found: &[f32]| gsvx::default_strategy(gsvx::DEFAULT_QUALITY, found, Seen::Guessed);
    match stage {
        "encode --lossless" => return peak_of(|| Ok(gsvx::encode_lossless(&scene)?)),
        "voxelize" => {
            return peak_of(|| {
                let strategy = choose(&importance::without_cameras(&scene))?;
                Ok(voxel::voxelize(&scene, &voxel::Cube::of(&scene.means)?, &strategy)?)
            });
        }
        "merge" => {
            let strategy = choose(&importance::without_cameras(&scene))?;
            let voxels = voxel::voxelize(&scene, &voxel::Cube::of(&scene.means)?, &strategy)?;
            return peak_of(|| Ok(voxel::merge(&scene, &voxels, voxel::Merge::Moments)?));
        }
        _ => {}
    }
    let Prepared { scene: merged, voxels, importance: given } = prepared(&scene)?;
    drop(scene);
    let (leaves, j_high) = (&voxels.leaves, voxels.j_high);
    if stage == "encode: geometry" {
        return peak_of(|| Ok(gpcc_lite::geometry::encode(leaves, j_high)?));
    }
    let log_classes = importance::log_classes(&given);
    let options = EncodeOptions { importance: Some(given), ..Default::default() };
    if stage == "encode, all sections" {
        drop(log_classes);
        return peak_of(|| Ok(gsvx::encode(&merged, &voxels, &options)?));
    }
    let classes = || Ok(importance::encode(&log_classes, leaves, j_high, Entropy::Range)?);
    if stage == "encode: importance" {
        return peak_of(classes);
    }
    let (_, classes) = classes()?;
    let plan = || Ok(Transform::new(leaves, j_high, Some(&classes))?);
    if stage == "encode: transform" {
        return peak_of(plan);
    }
    let transform = plan()?;
    section(stage, &merged, &transform, &options)
}

/// A section of transform-coded attributes, as the encoder codes it.
fn section(
    stage: &str,
    scene: &Scene,
    transform: &Transform,
    options: &EncodeOptions,
) -> Result<Peak> {
    let steps = &options.steps;
    let code = |steps: &[f64], leaf: &dyn Fn(usize, &mut [f64])| {
        // The memory does not depend on how many coefficients are set to zero.
        let lambda = gpcc_lite::attribute::Options::default().lambda;
        let entropy = options.entropy.of(scene.len(), &options.steps);
        let how = Coding { entropy, lambda, period: u8::MAX };
        peak_of(|| Ok(transform.encode(steps, how, leaf)?))
    };
    let (range, step) = match stage {
        "encode: opacity" => {
            let value =
                |i: usize| opacity::forward(OpacityDomain::LogAlpha, scene.opacity_logits[i]);
            return code(&[f64::from(steps.opacity)], &|i, row| row.fill(value(i)));
        }
        "encode: covariance" => {
            return code(&[f64::from(steps.covariance); 6], &|i, row| {
                row.copy_from_slice(&log_euclidean::coordinates(
                    scene.rotations[i],
                    scene.log_scales[i],
                ));
            });
        }
        "encode: DC" => (0..1, steps.dc),
        "encode: SH 1" => (1..4, steps.sh[0]),
        "encode: SH 2" => (4..9, steps.sh[1]),
        "encode: SH 3" => (9..16, steps.sh[2]),
        _ => bail!("no stage {stage}; stages: {}", STAGES.join(", ")),
    };
    let all = vec![f64::from(step); 3 * range.len()];
    code(&all, &|i, row| {
        for (k, planes) in row.chunks_exact_mut(3).enumerate() {
            let rgb = scene.sh_of(i).get(range.start + k).copied().unwrap_or_default();
            planes.copy_from_slice(&colour::forward(rgb));
        }
    })
}

fn of_decoded(found: &SceneFiles, stage: &str, stream: &Path, scratch: &Path) -> Result<Peak> {
    let bytes = std::fs::read(stream)?;
    let decode = || Ok(gsvx::decode(&bytes, &DecodeOptions::default())?.scene);
    if stage == "decode" {
        return peak_of(decode);
    }
    let scene = decode()?;
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
