//! [`merge`]: one Gaussian per leaf.

mod moments;
mod paper;

use gs_model::Scene;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::importance::Importance;
use crate::order::CHUNK;
use crate::voxelize::Voxelization;

/// How the members of a leaf become one Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Merge {
    /// Paper section 3.3: plain averages of the SH coefficients and of the opacities (after
    /// the sigmoid); scale and rotation of the member of the largest volume.
    Paper,
    /// Averages weighted by opacity times area; covariance matched in second moments,
    /// including the scatter of the means; opacity that conserves transmittance.
    #[default]
    Moments,
}

/// Everything of a merged Gaussian but its mean and its SH coefficients.
struct Shape {
    rotation: [f32; 4],
    log_scale: [f32; 3],
    opacity_logit: f32,
}

/// Merges the members of every leaf into one Gaussian at the leaf's centre, in leaf order.
///
/// A leaf of one member keeps every attribute of it bit for bit, except the mean, which
/// becomes `cube.leaf_centre(leaf, j_high)` under either rule. The result does not depend on
/// the number of threads. Non-finite attributes spread into their leaf only.
///
/// # Errors
/// [`Error::Member`] if `voxelization` is not of this scene.
pub fn merge(scene: &Scene, voxelization: &Voxelization, rule: Merge) -> Result<Scene> {
    merge_weighted(scene, voxelization, rule, &Importance::OpacityArea)
}

/// As [`merge`], with [`Merge::Moments`] weighting members by `importance` (the rasterizer's
/// saliency knows what is hidden) instead of opacity times area. [`Merge::Paper`] ignores it.
///
/// # Errors
/// As [`merge`]; [`Error::Length`] if `importance` does not fit the scene.
pub fn merge_weighted(
    scene: &Scene,
    voxelization: &Voxelization,
    rule: Merge,
    importance: &Importance,
) -> Result<Scene> {
    importance.validate(scene)?;
    if let Some(&member) = voxelization.members.iter().find(|&&m| m as usize >= scene.len()) {
        return Err(Error::Member { member, len: scene.len() });
    }
    let len = voxelization.len();
    let sh_len = scene.sh_len();
    let mut out = Scene {
        means: vec![[0.0; 3]; len],
        rotations: vec![[0.0; 4]; len],
        log_scales: vec![[0.0; 3]; len],
        opacity_logits: vec![0.0; len],
        sh_degree: scene.sh_degree,
        sh: vec![[0.0; 3]; len * sh_len],
    };
    let leaf_of = |chunk: usize, i: usize| chunk * CHUNK + i;
    out.means.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, means)| {
        for (i, mean) in means.iter_mut().enumerate() {
            *mean = voxelization.centre(leaf_of(chunk, i));
        }
    });
    out.rotations
        .par_chunks_mut(CHUNK)
        .zip(out.log_scales.par_chunks_mut(CHUNK))
        .zip(out.opacity_logits.par_chunks_mut(CHUNK))
        .zip(out.sh.par_chunks_mut(CHUNK * sh_len))
        .enumerate()
        .for_each(|(chunk, (((rotations, log_scales), opacity_logits), sh))| {
            let mut weights = Vec::new();
            for (i, sh) in sh.chunks_exact_mut(sh_len).enumerate() {
                let members = voxelization.members_of(leaf_of(chunk, i));
                let shape = match (members, rule) {
                    (&[one], _) => {
                        sh.copy_from_slice(scene.sh_of(one as usize));
                        Shape::of(scene, one as usize)
                    }
                    (_, Merge::Paper) => {
                        weights.clear();
                        weights.resize(members.len(), 1.0);
                        average_sh(scene, members, &weights, sh);
                        paper::shape(scene, members)
                    }
                    (_, Merge::Moments) => {
                        moments::weights(scene, members, importance, &mut weights);
                        average_sh(scene, members, &weights, sh);
                        moments::shape(scene, members, &weights)
                    }
                };
                rotations[i] = shape.rotation;
                log_scales[i] = shape.log_scale;
                opacity_logits[i] = shape.opacity_logit;
            }
        });
    Ok(out)
}

impl Shape {
    fn of(scene: &Scene, i: usize) -> Self {
        Self {
            rotation: scene.rotations[i],
            log_scale: scene.log_scales[i],
            opacity_logit: scene.opacity_logits[i],
        }
    }
}

/// Weighted mean of the SH coefficients, summed in `f64` in member order.
fn average_sh(scene: &Scene, members: &[u32], weights: &[f64], out: &mut [[f32; 3]]) {
    // 16 triples: SH degree 3.
    let mut sums = [[0.0f64; 3]; 16];
    let sums = &mut sums[..out.len()];
    let mut total = 0.0;
    for (&member, &weight) in members.iter().zip(weights) {
        total += weight;
        for (sum, coefficient) in sums.iter_mut().zip(scene.sh_of(member as usize)) {
            for c in 0..3 {
                sum[c] += weight * f64::from(coefficient[c]);
            }
        }
    }
    for (out, sum) in out.iter_mut().zip(sums) {
        *out = sum.map(|s| (s / total) as f32);
    }
}

/// Keeps a computed logit inside the range of the members' logits, where every average of
/// opacities lies; also catches the overflow of the logit at opacities that round to 1.
fn clamp_logit(scene: &Scene, members: &[u32], logit: f64) -> f32 {
    let logits = members.iter().map(|&i| scene.opacity_logits[i as usize]);
    let (low, high) =
        logits.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
    (logit as f32).max(low).min(high)
}
