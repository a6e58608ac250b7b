//! The same bytes, floats and pixels for any number of threads.

use anyhow::{Context, Result, ensure};
use eval::{hash_bytes, measure, scenes};
use finetune::{RenderOptions, TrainView};
use gs_model::Scene;
use gsvx::{DEFAULT_QUALITY, EncodeOptions};
use std::num::NonZeroUsize;

use testing::sha256;
use tune::{FineTune, FineTuneOptions, Target, Targets, Tune, TuneOptions, TunePlan};

use super::{Tally, Verdict};

const THREADS: [usize; 4] = [1, 2, 3, 8];

/// What `work` gives on each number of threads; an error if they differ.
fn same(what: &str, work: impl Fn() -> Result<String> + Send + Sync) -> Result<Verdict> {
    let mut first: Option<String> = None;
    for threads in THREADS {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let got = pool.context("start threads")?.install(&work)?;
        let want = first.get_or_insert_with(|| got.clone());
        ensure!(*want == got, "{threads} threads give {got}, {} give {want}", THREADS[0]);
    }
    let hash = first.unwrap_or_default();
    Ok(Verdict::Holds(format!(
        "{what} with 1, 2, 3 and 8 threads, {}",
        &hash[..hash.len().min(12)]
    )))
}

/// Two views of the room, and its model.
fn room() -> Result<(Vec<TrainView>, Scene)> {
    let room = scenes::find(scenes::DEFAULT)?.dataset;
    Ok((measure::load(room.training().take(2))?, gs_model::ply::read(&room.model_path)?.0))
}

pub(super) fn checks(tally: &mut Tally) {
    let (views, scene) = match room() {
        Ok(all) => all,
        Err(why) => return tally.check("threads", || Err(why)),
    };
    let default = EncodeOptions::default();
    // Many chunks, so that threads have something to share.
    let mut levels = default;
    levels.code.lod = true;
    levels.code.chunk_leaves = NonZeroUsize::MIN.saturating_add(999);
    for (name, options) in [("default", &default), ("levels of detail", &levels)] {
        tally.check(&format!("encoder over threads, {name}"), || {
            same("the same bytes", || {
                let encoded = gsvx::encode(&scene, None, DEFAULT_QUALITY, options)?;
                Ok(hash_bytes(&encoded.bytes))
            })
        });
    }
    tally.check("encoder over threads, lossless", || {
        same("the same bytes", || Ok(hash_bytes(&gsvx::encode_lossless(&scene, false)?.bytes)))
    });
    tally.check("decoder over threads", || {
        let bytes = gsvx::encode(&scene, None, DEFAULT_QUALITY, &levels)?.bytes;
        same("the same floats", || Ok(sha256(&gsvx::decode(&bytes)?)))
    });
    tally.check("paper's codec over threads", || {
        same("the same bytes and floats", || {
            let voxelized = paper::voxelize(&scene, &paper::Strategy::paper(8, 12))?;
            let qp = paper::Qp { ac: 28, dc: 4, opacity: 16 };
            let covariance = paper::CovarianceCoding::Lossy { codebook_bits: 8 };
            let options = paper::PaperOptions { qp, covariance };
            let bytes =
                paper::encode(&voxelized.scene, voxelized.voxels.octree(), None, &options)?.bytes;
            Ok(hash_bytes(&[&*bytes, sha256(&paper::decode(&bytes)?).as_bytes()].concat()))
        })
    });
    tally.check("rasterizer over threads", || {
        same("the same pixels", || {
            let image = finetune::render(&scene, &views[0].camera, &RenderOptions::default());
            let bytes: Vec<u8> = image.rgb.iter().flat_map(|v| v.to_le_bytes()).collect();
            Ok(hash_bytes(&bytes))
        })
    });
    tally.check("fine-tune over threads", || {
        same("the same floats after 4 steps", || {
            let options = FineTuneOptions { steps: 4, ..FineTuneOptions::default() };
            let tune = FineTune::new(scene.clone(), views.clone(), options)?;
            Ok(sha256(&tune.run(|_| ())?.scene))
        })
    });
    tally.check("tune over threads", || {
        same("the same bytes after 8 steps", || {
            let mut options = TuneOptions::new(Target::Quality(54.0));
            let (rounds, round_steps, loop_steps) = (1, 4, 4);
            let (quality, fraction) = (54.0, 0.5);
            options.plan = Some(TunePlan { quality, fraction, rounds, round_steps, loop_steps });
            let tune = Tune::new(scene.clone(), Targets::Photos(views.clone()), options)?;
            Ok(hash_bytes(&tune.run(|_| ())?.encoded.bytes))
        })
    });
}
