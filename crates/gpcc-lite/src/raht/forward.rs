//! Forward RAHT of several channels at once, and how much of it neighbouring means predict.

use super::blocks::{Lanes, Walk, mean_of};
use super::{Plan, round_shift, scale_up};
use crate::context::CHUNK;

/// Blocks looked at in a run when strengths are measured, and one run of how many.
const RUN: usize = 64;
const ONE_OF: usize = 4;

/// Exact coefficients of `C` channels, with the means of all nodes if asked for.
pub(crate) struct Forward<const C: usize> {
    /// High-pass values at the first leaf of their right child, the DC at leaf 0.
    pub(crate) exact: Vec<[i64; C]>,
    mean: Vec<Lanes>,
}

impl<const C: usize> Forward<C> {
    /// Transforms `channels` (leaf order) after adding `fraction` bits.
    pub(crate) fn new(plan: &Plan, channels: [&[i32]; C], fraction: u32, means: bool) -> Self {
        const { assert!(C <= CHUNK) };
        let n = plan.len();
        let value = |i: usize| channels.map(|c| i64::from(c[i]) << fraction);
        let mut low: Vec<[i64; C]> = (0..n).map(value).collect();
        for (v, &r) in low.iter_mut().zip(&plan.root_weight) {
            *v = v.map(|v| scale_up(v, r));
        }
        let merge = |low: &mut [[i64; C]], k: usize| {
            let [c, s] = plan.factor[k - 1].map(i128::from);
            let (i, j) = (plan.left[k - 1] as usize, plan.right[k - 1] as usize);
            for ch in 0..C {
                let (a, b) = (i128::from(low[i][ch]), i128::from(low[j][ch]));
                low[i][ch] = round_shift(c * a + s * b);
                low[j][ch] = round_shift(c * b - s * a);
            }
        };
        let mut mean = Vec::new();
        if means && n > 0 {
            let pyramid = plan.pyramid();
            mean = vec![[0.0; 4]; pyramid.inverse_root.len()];
            let (mut k, mut base) = (n, mean.len());
            for &mask in pyramid.mask.iter().rev() {
                let (merges, count) = &super::blocks::MERGES[usize::from(mask)];
                let count = usize::from(*count);
                k -= count;
                base -= count + 1;
                mean[base] = mean_of(&low[plan.left[k - 1] as usize], pyramid.inverse_root[base]);
                for (m, &(_, r)) in merges[..count].iter().enumerate() {
                    let at = base + usize::from(r);
                    let leaf = plan.right[k + m - 1] as usize;
                    mean[at] = mean_of(&low[leaf], pyramid.inverse_root[at]);
                }
                (k..k + count).rev().for_each(|k| merge(&mut low, k));
            }
            mean[0] = mean_of(&low[0], pyramid.inverse_root[0]);
        } else {
            (1..n).rev().for_each(|k| merge(&mut low, k));
        }
        Self { exact: low, mean }
    }

    /// How much of each level its prediction explains, in 1/16 and at most 15; empty if none.
    ///
    /// The means here are exact and only a quarter of the larger levels is looked at; it costs
    /// less than 0.1 % in rate.
    pub(crate) fn measure_strength(&mut self, plan: &Plan) -> [Vec<u8>; C] {
        let pyramid = plan.pyramid();
        let mut strength: [Vec<u8>; C] = std::array::from_fn(|_| Vec::new());
        let mut walk = Walk::new(pyramid);
        for range in pyramid.levels.windows(2) {
            let (mut at, end) = (range[0] as usize, range[1] as usize);
            let sample = end - at > 16 * RUN;
            // Sums of exact times predicted, and of predicted squared.
            let mut sums = [[0.0f64; 2]; C];
            while at < end {
                let run = if sample { end.min(at + RUN) } else { end };
                for i in at..run {
                    let block = walk.next(i);
                    if !block.predicts() {
                        continue;
                    }
                    let predicted = block.predict(plan, &self.mean, &[1.0; 4]);
                    let leaves = &plan.right[block.k - 1..][..block.merges.len()];
                    for (&leaf, p) in leaves.iter().zip(&predicted) {
                        let e = &self.exact[leaf as usize];
                        for ch in 0..C {
                            let p = f64::from(p[ch]);
                            sums[ch][0] += e[ch] as f64 * p;
                            sums[ch][1] += p * p;
                        }
                    }
                }
                let next = if sample { end.min(run + (ONE_OF - 1) * RUN) } else { end };
                walk.skip(run..next);
                at = next;
            }
            for (s, out) in sums.iter().zip(&mut strength) {
                let ratio = if s[1] > 0.0 { 16.0 * s[0] / s[1] } else { 0.0 };
                out.push((ratio + 0.5).clamp(0.0, 15.0) as u8);
            }
        }
        self.mean = Vec::new();
        strength.map(|s| if s.iter().all(|&s| s == 0) { Vec::new() } else { s })
    }
}
