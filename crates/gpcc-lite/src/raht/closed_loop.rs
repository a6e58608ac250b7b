//! Inverse RAHT level by level, each level predicted from the one above.
//!
//! The values of a node's children are predicted from the reconstructed means of the node, of
//! its neighbours and of those neighbours' children that are already known; the prediction goes
//! through the same butterflies, and only the difference of the high-pass values is coded.

use super::blocks::{Lanes, Walk, mean_of};
use super::{Plan, round_shift};
use crate::context::CHUNK;

/// Where the high-pass values of `C` channels come from.
pub(crate) trait Residual<const C: usize> {
    /// Called before each octree level; the strength of the prediction there.
    fn start_level(&mut self, depth: usize) -> [f32; C];

    /// The reconstructed high-pass values `k`, given their predictions.
    fn high(&mut self, k: usize, predicted: [i64; C]) -> [i64; C];
}

/// Reconstructs all values (leaf order, still multiplied by the roots of the leaf weights)
/// from the DC and from what `source` returns, which is asked for `1..plan.len()` in order.
pub(crate) fn reconstruct<const C: usize, R: Residual<C>>(
    plan: &Plan,
    dc: [i64; C],
    source: &mut R,
) -> Vec<[i64; C]> {
    const { assert!(C <= CHUNK) };
    let pyramid = plan.pyramid();
    // Low-pass values at the first leaf of their node, means by node.
    let mut low = vec![[0i64; C]; plan.len()];
    let mut mean: Vec<Lanes> = vec![[0.0; 4]; pyramid.inverse_root.len()];
    if let (Some(first), Some(&root)) = (low.first_mut(), pyramid.inverse_root.first()) {
        *first = dc;
        mean[0] = mean_of(&dc, root);
    }
    let mut walk = Walk::new(pyramid);
    for (depth, range) in pyramid.levels.windows(2).enumerate() {
        let mut strength = [0.0; 4];
        strength[..C].copy_from_slice(&source.start_level(depth));
        let predicts = strength.iter().any(|&s| s != 0.0);
        for at in range[0] as usize..range[1] as usize {
            let block = walk.next(at);
            let predicted = if predicts && block.predicts() {
                block.predict(plan, &mean, &strength)
            } else {
                [[0.0; 4]; 7]
            };
            let count = block.merges.len();
            let left = plan.left[block.k - 1] as usize;
            let rights = &plan.right[block.k - 1..][..count];
            let factors = &plan.factor[block.k - 1..][..count];
            let roots = &pyramid.inverse_root[block.base..][..=count];
            let means = &mut mean[block.base..][..=count];
            let mut value = [[0i64; C]; 8];
            value[0] = low[left];
            for (m, &(l, r)) in block.merges.iter().enumerate() {
                let (l, r) = (usize::from(l & 7), usize::from(r & 7));
                let mut p = [0i64; C];
                for (p, &v) in p.iter_mut().zip(&predicted[m]) {
                    *p = v as i64;
                }
                let high = source.high(block.k + m, p);
                let [c, s] = factors[m].map(i128::from);
                for ch in 0..C {
                    let (v, h) = (i128::from(value[l][ch]), i128::from(high[ch]));
                    value[l][ch] = round_shift(c * v - s * h);
                    value[r][ch] = round_shift(s * v + c * h);
                }
            }
            low[left] = value[0];
            means[0] = mean_of(&value[0], roots[0]);
            for (&(_, r), &leaf) in block.merges.iter().zip(rights) {
                let r = usize::from(r & 7);
                low[leaf as usize] = value[r];
                if let (Some(mean), Some(&root)) = (means.get_mut(r), roots.get(r)) {
                    *mean = mean_of(&value[r], root);
                }
            }
        }
    }
    low
}
