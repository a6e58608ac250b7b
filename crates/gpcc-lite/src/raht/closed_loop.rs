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

    /// The reconstructed high-pass values `k`, given their predictions and what was stored in
    /// their place.
    fn high(&mut self, k: usize, predicted: [i64; C], stored: [i64; C]) -> [i64; C];
}

/// Reconstructs all values (leaf order, still multiplied by the roots of the leaf weights)
/// from the DC and from what `source` returns, which is asked for `1..plan.len()` in order.
///
/// `low` holds what the source wants to be told of each coefficient, at the first leaf of its
/// right child; an encoder's exact coefficients need no second array.
pub(crate) fn reconstruct<const C: usize, R: Residual<C>>(
    plan: &Plan,
    dc: [i64; C],
    source: &mut R,
    mut low: Vec<[i64; C]>,
) -> Vec<[i64; C]> {
    const { assert!(C <= CHUNK) };
    let pyramid = plan.pyramid();
    // Low-pass values will be at the first leaf of their node; means by node.
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
            let mut leaf = [left; 8];
            for (&(_, r), &right) in block.merges.iter().zip(rights) {
                leaf[usize::from(r & 7)] = right as usize;
            }
            for (m, &(l, r)) in block.merges.iter().enumerate() {
                let (l, r) = (leaf[usize::from(l & 7)], leaf[usize::from(r & 7)]);
                let mut p = [0i64; C];
                for (p, &v) in p.iter_mut().zip(&predicted[m]) {
                    *p = v as i64;
                }
                let high = source.high(block.k + m, p, std::array::from_fn(|ch| low[r][ch]));
                let [c, s] = factors[m].map(i128::from);
                // In place: a copy of all channels would wait for the stores of each.
                for ch in 0..C {
                    let (v, h) = (i128::from(low[l][ch]), i128::from(high[ch]));
                    low[l][ch] = round_shift(c * v - s * h);
                    low[r][ch] = round_shift(s * v + c * h);
                }
            }
            for ((mean, &root), &leaf) in means.iter_mut().zip(roots).zip(&leaf) {
                *mean = mean_of(&low[leaf], root);
            }
        }
    }
    low
}
