//! The plan that follows from a target: for a size, by streams of the scene without tuning.

use finetune::Removal;
use gs_model::Scene;
use gsvx::{Prepared, rate};

use crate::error::{Error, Result};
use crate::options::{Target, TuneOptions};
use crate::plan::{self, Spare, TunePlan, quality_for_psnr};
use crate::views::FirstLook;

/// Bytes of a tuned stream over those of one of the same plan without tuning, about: where a search for
/// a size begins.
const TUNED_OVER_PROBED: f64 = 0.85;

/// The plan for the target.
pub(crate) fn plan(scene: &Scene, looked: &FirstLook, options: &TuneOptions) -> Result<TunePlan> {
    if let Some(plan) = options.plan {
        return plan.checked();
    }
    let FirstLook { removal: Removal { effects, squared }, input_scores, .. } = looked;
    let spare = Spare::new(effects, squared);
    let quality = match options.target {
        Target::Quality(quality) => quality,
        Target::Psnr(db) => quality_for_psnr(db, input_scores.psnr),
        Target::Bytes(bytes) => {
            // The stream of a plan without any tuning.
            let probe = |quality: f32| {
                let plan = TunePlan::new(quality, options.effort, &spare)?;
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
    Ok(TunePlan::new(quality, options.effort, &spare)?)
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
    let Prepared { scene, voxels, importance, .. } =
        plan::prepare(scene, importance, quality, options.drop_unseen)?;
    let (steps, code) = (plan::steps(quality)?, options.layout.code());
    let octree = voxels.octree();
    Ok(gsvx::encode_voxels(&scene, octree, None, Some(&importance), &steps, &code)?.bytes)
}
