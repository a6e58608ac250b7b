//! SH coefficients of merged Gaussians: weighted means over the members.

use std::ops::Range;

use gs_model::{Scene, sh_len};
use multiversion::multiversion;
use rayon::prelude::*;

use super::{BATCH, BatchMembers, Merging, Scratch};

impl Merging<'_> {
    /// The SH coefficients of one degree of [`Merging::scene`], with the same bits: `2 degree + 1` per
    /// leaf, or none if the scene's degree is lower. For callers that have no memory for all merged
    /// Gaussians beside the scene.
    #[must_use]
    pub fn sh(&self, degree: u8) -> Vec<[f32; 3]> {
        if degree > self.scene.sh_degree {
            return Vec::new();
        }
        let coefficients = degree.checked_sub(1).map_or(0, sh_len)..sh_len(degree);
        let mut out = vec![[0.0; 3]; self.voxelization.len() * coefficients.len()];
        out.par_chunks_mut(BATCH * coefficients.len())
            .enumerate()
            .for_each_init(Scratch::default, |scratch, (batch, out)| {
                fill(self, batch * BATCH, coefficients.clone(), scratch, out)
            });
        out
    }
}

/// Of the leaves from `first` on, as many as `out` has room for.
#[multiversion(targets("x86_64+avx2"))]
fn fill(
    merging: &Merging<'_>,
    first: usize,
    coefficients: Range<usize>,
    scratch: &mut Scratch,
    out: &mut [[f32; 3]],
) {
    let len = out.len() / coefficients.len();
    let batch = BatchMembers::new(merging.voxelization, first, len);
    copy(merging.scene, &batch, coefficients.clone(), out);
    scratch.find(merging, &batch, false);
    average_shared(merging.scene, &batch, scratch, coefficients, out);
}

/// Copies some coefficients of the first member of every leaf.
#[inline(always)]
pub(super) fn copy(
    scene: &Scene,
    batch: &BatchMembers<'_>,
    coefficients: Range<usize>,
    out: &mut [[f32; 3]],
) {
    for (i, sh) in out.chunks_exact_mut(coefficients.len()).enumerate() {
        sh.copy_from_slice(&scene.sh_of(batch.first(i))[coefficients.clone()]);
    }
}

/// Averages some coefficients over the members of every leaf that has more than one.
#[inline(always)]
pub(super) fn average_shared(
    scene: &Scene,
    batch: &BatchMembers<'_>,
    scratch: &Scratch,
    coefficients: Range<usize>,
    out: &mut [[f32; 3]],
) {
    let mut start = 0;
    for &i in &scratch.shared {
        let range = start..start + batch.of(i).len();
        start = range.end;
        let (members, weights) = (&scratch.members[range.clone()], &scratch.weights[range]);
        let sh = &mut out[i * coefficients.len()..(i + 1) * coefficients.len()];
        average(scene, members, weights, coefficients.start, sh);
    }
}

/// Number of members whose SH coefficients are summed in `f32`; such sums are added in `f64`.
const SHORT: usize = 16;

/// Weighted mean of the SH coefficients from `first` on, summed in member order. The error is at
/// most 1.2e-6 of the greatest coefficient of a member.
#[inline(always)]
fn average(scene: &Scene, members: &[u32], weights: &[f64], first: usize, out: &mut [[f32; 3]]) {
    let share = 1.0 / weights.iter().sum::<f64>();
    let short = |members: &[u32], weights: &[f64], out: &mut [[f32; 3]]| {
        let out = out.as_flattened_mut();
        out.fill(0.0);
        for (&member, &weight) in members.iter().zip(weights) {
            let weight = (weight * share) as f32;
            let sh = &scene.sh_of(member as usize)[first..];
            for (sum, x) in out.iter_mut().zip(sh.as_flattened()) {
                *sum += weight * x;
            }
        }
    };
    if members.len() <= SHORT {
        short(members, weights, out);
        return;
    }
    // 16 triples: SH degree 3.
    let (mut sums, mut part) = ([0.0f64; 48], [[0.0f32; 3]; 16]);
    for (members, weights) in members.chunks(SHORT).zip(weights.chunks(SHORT)) {
        short(members, weights, &mut part[..out.len()]);
        sums.iter_mut().zip(part.as_flattened()).for_each(|(sum, &x)| *sum += f64::from(x));
    }
    out.as_flattened_mut().iter_mut().zip(sums).for_each(|(out, sum)| *out = sum as f32);
}
