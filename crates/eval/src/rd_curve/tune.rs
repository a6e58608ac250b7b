//! Fine-tunes of voxelized models, scored at the held-out views at a few steps. A fine-tune that was
//! cut goes on from its checkpoint.

use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use gs_model::Scene;
use gsvx::Prepared;
use tune::{FineTune, FineTuneOptions};

use super::options::Tuning;
use super::record::Tuned;
use super::study::Study;
use crate::cache;
use crate::measure;
use crate::progress::Bar;
use crate::usage;

/// How often the held-out views are scored, the end included.
const STOPS: u64 = 4;

fn stage(name: &str) -> String {
    format!("tune-{name}")
}

/// The record of a fine-tune that is done and whose model is still there.
pub(super) fn find(study: &Study, name: &str, key: &str) -> Result<Option<Tuned>> {
    study.cache.find(&stage(name), &key, |r: &Tuned| study.out.join(&r.file).is_file())
}

/// The record of the fine-tune, which runs unless there is one.
pub(super) fn tuned(
    study: &Study,
    name: &str,
    key: &str,
    prepared: &Prepared,
    tuning: Tuning,
) -> Result<Tuned> {
    if let Some(record) = find(study, name, key)? {
        return Ok(record);
    }
    let start = if tuning.initialised { prepared.scene.clone() } else { blank(prepared) };
    let dir = study.out.join("tuned");
    fs::create_dir_all(&dir).with_context(|| format!("create {}", dir.display()))?;
    // The key is in the name, so that a checkpoint of other settings is not continued.
    let checkpoint = dir.join(format!("{name}-{}.part", &cache::hash_bytes(key.as_bytes())[..8]));
    let (scene, record) = fine_tune(study, name, start, tuning, &checkpoint)
        .with_context(|| format!("fine-tune ({name})"))?;
    gs_model::ply::write(study.out.join(&record.file), &scene)?;
    // The model is complete: its checkpoint is no longer needed.
    let _ = fs::remove_file(&checkpoint);
    study.cache.store(&stage(name), &key, &record)?;
    Ok(record)
}

/// Runs the fine-tune, or what is left of it.
fn fine_tune(
    study: &Study,
    name: &str,
    start: Scene,
    tuning: Tuning,
    checkpoint: &Path,
) -> Result<(Scene, Tuned)> {
    let Tuning { steps, initialised, backend } = tuning;
    let bar = Bar::new(&format!("fine-tune {name}"), steps);
    let score =
        |scene: &Scene| measure::score(scene, &study.test.held_out, &Bar::hidden()).0.psnr_db;
    let mut held_out_db = vec![(0, score(&start))];
    let options = FineTuneOptions {
        steps,
        checkpoint: Some(checkpoint.to_owned()),
        checkpoint_every: (steps / STOPS).max(1),
        backend,
        ..Default::default()
    };
    usage::reset_peak();
    let user_seconds = || usage::user_seconds(usage::SELF).unwrap_or(0.0);
    let (started, began) = (Instant::now(), user_seconds());
    let run = FineTune::new(start, study.photos()?.to_vec(), options)?;
    let (mut done, mut scoring) = (run.steps_done(), [0.0; 2]);
    // A run that goes on from a checkpoint is beyond some of the stops.
    let mut next = STOPS * done / steps.max(1) + 1;
    let outcome = run.run(|p| {
        bar.step(p.step - done);
        done = p.step;
        if p.step < steps && STOPS * p.step >= next * steps {
            let (wall, user) = (Instant::now(), user_seconds());
            held_out_db.push((p.step, score(p.scene)));
            scoring[0] += wall.elapsed().as_secs_f64();
            scoring[1] += user_seconds() - user;
            next = STOPS * p.step / steps + 1;
        }
    })?;
    let (seconds, user) = (started.elapsed().as_secs_f64(), user_seconds() - began);
    held_out_db.push((outcome.steps, score(&outcome.scene)));
    bar.done();
    let record = Tuned {
        steps,
        initialised,
        held_out_db,
        seconds: seconds - scoring[0],
        user_seconds: user - scoring[1],
        peak_bytes: usage::peak_bytes(usage::SELF).unwrap_or(0),
        file: format!("tuned/{name}.ply"),
    };
    Ok((outcome.scene, record))
}

/// The nearest leaves are looked for among this many before and after a leaf in Morton order.
const REACH: usize = 16;
/// Number of nearest leaves whose distances give the size, as in the reference implementation.
const NEAREST: usize = 3;

/// The start of a trainer without initialisation, at the same means: grey, round, translucent
/// Gaussians as large as the distances between them.
fn blank(prepared: &Prepared) -> Scene {
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
