//! Fine-tunes of voxelized models. A fine-tune that was cut goes on from its checkpoint.

use std::fs;

use anyhow::{Context, Result, ensure};
use gs_model::{Scene, ply};
use gsvx::VoxelScene;
use tune::{FineTune, FineTuneOptions};

use super::options::Tuning;
use crate::cache;
use crate::progress::Bar;
use crate::study::Study;

/// Checkpoints of a fine-tune, the end included.
const STOPS: u64 = 4;

/// The fine-tuned model, which is kept in a file.
pub(super) fn fine_tuned(
    study: &Study,
    name: &str,
    key: &str,
    prepared: &VoxelScene,
    Tuning { steps, initialised, backend }: Tuning,
) -> Result<Scene> {
    let (stage, file) = (format!("tune-{name}"), format!("tuned/{name}.ply"));
    let path = study.out.join(&file);
    if study.cache.find(&stage, &key, |_: &String| path.is_file())?.is_none() {
        let start = if initialised { prepared.scene.clone() } else { blank(prepared) };
        fs::create_dir_all(study.out.join("tuned")).context("create tuned/")?;
        // The key is in the name, so that a checkpoint of other settings is not continued.
        let part = format!("tuned/{name}-{}.part", &cache::hash_bytes(key.as_bytes())[..8]);
        let checkpoint = study.out.join(part);
        let options = FineTuneOptions {
            steps,
            checkpoint: Some(checkpoint.clone()),
            checkpoint_every: (steps / STOPS).max(1),
            backend,
            ..Default::default()
        };
        let run = FineTune::new(start, study.photos()?.to_vec(), options)?;
        let (bar, mut done) = (Bar::new(&format!("fine-tune {name}"), steps), run.steps_done());
        let outcome = run.run(|p| {
            bar.step(p.step - done);
            done = p.step;
        });
        let outcome = outcome.with_context(|| format!("fine-tune ({name})"))?;
        bar.done();
        ply::write(&path, &outcome.scene)?;
        // The model is complete: its checkpoint is no longer needed.
        let _ = fs::remove_file(&checkpoint);
        study.cache.store(&stage, &key, &file)?;
    }
    let (scene, _) = ply::read(&path)?;
    ensure!(scene.means == prepared.scene.means, "{}: other means", path.display());
    Ok(scene)
}

/// The nearest leaves are looked for among this many before and after a leaf in Morton order.
const REACH: usize = 16;
/// Number of nearest leaves whose distances give the size, as in the reference implementation.
const NEAREST: usize = 3;

/// The start of a trainer without initialisation, at the same means: grey, round, translucent
/// Gaussians as large as the distances between them.
fn blank(prepared: &VoxelScene) -> Scene {
    let merged = &prepared.scene;
    let n = merged.len();
    Scene {
        means: merged.means.clone(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
        log_scales: (0..n).map(|i| [gap(&merged.means, i).ln() as f32; 3]).collect(),
        // Opacity 0.1, as the reference implementation begins with.
        opacity_logits: vec![-2.197_224_6; n],
        sh_degree: merged.sh_degree,
        sh: vec![[0.0; 3]; merged.sh.len()],
        ..Scene::default()
    }
}

/// Root of the mean squared distance to the nearest means. The means are in Morton order, so near
/// means mostly have near indices.
fn gap(means: &[[f32; 3]], i: usize) -> f64 {
    let squared =
        |j: usize| -> f64 { (0..3).map(|k| f64::from(means[i][k] - means[j][k]).powi(2)).sum() };
    let around = i.saturating_sub(REACH)..(i + REACH + 1).min(means.len());
    let mut all: Vec<f64> = around.filter(|&j| j != i).map(squared).collect();
    all.sort_unstable_by(f64::total_cmp);
    all.truncate(NEAREST);
    // A single Gaussian has no neighbour.
    let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
    mean.max(1e-14).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_those_of_a_line() {
        let means: Vec<[f32; 3]> = (0..40).map(|i| [i as f32, 0.0, 0.0]).collect();
        // Neighbours at 1, 1 and 2; at the end 1, 2 and 3.
        assert!((gap(&means, 20) - 2f64.sqrt()).abs() < 1e-9);
        assert!((gap(&means, 0) - (14.0f64 / 3.0).sqrt()).abs() < 1e-9);
        assert!(gap(&means[..1], 0) > 0.0);
    }
}
