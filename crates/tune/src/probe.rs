//! The plans that follow from a target: for a size, by streams of the scene without tuning.

use finetune::Removal;
use gs_model::Scene;
use gsvx::{VoxelScene, rate};

use crate::error::{Error, Result};
use crate::options::{Target, TuneOptions};
use crate::plan::{self, Spare, TunePlan, quality_for_psnr};
use crate::views::FirstLook;

/// Bytes of a tuned stream over those of one of the same plan without tuning, about: where a search for
/// a size begins.
const TUNED_OVER_PROBED: f64 = 0.85;

/// The plans of all streams, the target's first.
pub(crate) fn plans(
    scene: &Scene,
    looked: &FirstLook,
    options: &TuneOptions,
) -> Result<Vec<TunePlan>> {
    let spare = Spare::new(&looked.removal.effects, &looked.removal.squared);
    let mut plans = vec![match options.plan {
        Some(plan) => plan.checked()?,
        None => first(scene, looked, options, &spare)?,
    }];
    for &quality in &options.further {
        let descends = matches!(options.target, Target::Quality(first) if quality < first);
        if !descends || plans.iter().any(|plan| quality >= plan.quality) {
            let (option, range) = ("further quality", "below the quality before it");
            return Err(Error::Option { option, value: quality.into(), range });
        }
        plans.push(TunePlan::new(quality, options.effort, &spare)?.further());
    }
    Ok(plans)
}

fn first(
    scene: &Scene,
    looked: &FirstLook,
    options: &TuneOptions,
    spare: &Spare,
) -> Result<TunePlan> {
    let FirstLook { removal: Removal { effects, squared }, input_scores, .. } = looked;
    let quality = match options.target {
        Target::Quality(quality) => quality,
        Target::Psnr(db) => quality_for_psnr(db, input_scores.psnr),
        Target::Bytes(bytes) => {
            // The stream of a plan without any tuning.
            let probe = |quality: f32| {
                let plan = TunePlan::new(quality, options.effort, spare)?;
                let kept = gsvx::prune(effects, plan.fraction)?;
                let importance: Vec<f32> = kept.iter().map(|&i| squared[i]).collect();
                probe(&scene.select(&kept), &importance, quality, options)
            };
            let found = rate::to_bytes((bytes as f64 / TUNED_OVER_PROBED) as u64, &probe)?;
            if !found.reached || is_empty(&found.encoded)? {
                let smallest = smallest(probe)? as f64 * TUNED_OVER_PROBED;
                return Err(Error::TargetTooSmall { target: bytes, smallest: smallest as u64 });
            }
            found.quality
        }
    };
    Ok(TunePlan::new(quality, options.effort, spare)?)
}

/// Bytes of the smallest stream that has a Gaussian, to five points of quality.
fn smallest(mut probe: impl FnMut(f32) -> gsvx::Result<Vec<u8>>) -> Result<usize> {
    for quality in (0..=100u8).step_by(5) {
        let stream = probe(quality.into())?;
        if !is_empty(&stream)? {
            return Ok(stream.len());
        }
    }
    Err(Error::NothingSeen)
}

fn is_empty(stream: &[u8]) -> Result<bool> {
    Ok(gsvx::Index::parse(stream)?.header.count == 0)
}

/// The stream of a scene at a quality.
fn probe(
    scene: &Scene,
    importance: &[f32],
    quality: f32,
    options: &TuneOptions,
) -> gsvx::Result<Vec<u8>> {
    let VoxelScene { scene, voxels, importance, .. } =
        plan::prepare(scene, importance, quality, options.drop_unseen)?;
    let (steps, code) = (plan::steps(quality)?, options.layout.code());
    let octree = voxels.octree();
    Ok(gsvx::encode_voxels(&scene, octree, None, Some(&importance), &steps, &code)?.bytes)
}
