//! RAHT: the region-adaptive hierarchical transform (de Queiroz and Chou, 2016).
//!
//! Sorted Morton codes form a binary radix tree with exactly `N - 1` merges, whatever the depth.
//! [`Plan`] finds them once, in `O(N)`; every channel then goes through the same list. The
//! transform is orthonormal: for children with weights `w1`, `w2`
//!
//! ```text
//! low  = (sqrt(w1) a + sqrt(w2) b) / sqrt(w1 + w2)
//! high = (sqrt(w1) b - sqrt(w2) a) / sqrt(w1 + w2)
//! ```
//!
//! Leaf weights other than 1 state importance: the leaf enters as `sqrt(w) * value`, so a
//! uniform quantiser of the coefficients leaves it an error smaller by `sqrt(w)`.
//!
//! Coefficient 0 is the DC. Coefficients `1..N` are the merges from coarse to fine by octree
//! level; within a level block by block in Morton order (a block is a node with two children or
//! more, hence 1 to 7 merges), within a block x, then y, then z.

mod blocks;
mod fixed;
mod float;
mod pyramid;
mod rows;

use pyramid::Pyramid;
pub(crate) use rows::{Gains, Lanes, Residual, forward, reconstruct};
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::leaf::{Leaf, check_leaves};

/// Fraction bits of the butterfly factors of the fixed-point transform.
pub const FACTOR_BITS: u32 = 30;

/// Greatest sum of leaf weights (exclusive): keeps `|value| 2^12 sqrt(sum)` below 2^62 for
/// every `i32` value.
pub const MAX_WEIGHT_SUM: u64 = 1 << 36;

/// Levels that end within so many coefficients of a thousand, or within so many, are not fine.
const PREDICTED_PER_MILLE: usize = 650;
const PREDICTED_AT_LEAST: usize = 20_000;

/// The merges of a set of leaves, shared by all channels.
#[derive(Clone, Debug)]
pub struct Plan {
    points: usize,
    /// Per merge, coarse to fine: position of the low-pass value (first leaf of the left child).
    left: Vec<u32>,
    /// Per merge: position of the high-pass value (first leaf of the right child).
    right: Vec<u32>,
    /// Per merge: coefficient index of the merge above, 0 for the root.
    parent: Vec<u32>,
    /// Per merge: the leaf after its last.
    end: Vec<u32>,
    /// Per merge: `w2 / w`, the share of the right child in the mean.
    share: Vec<f32>,
    /// Per merge: `sqrt(w / (w1 w2))`, which takes a high-pass value to the difference of the
    /// children's means.
    scale: Vec<f32>,
    /// Per merge: axis it splits, 0 = x, 1 = y, 2 = z.
    axis: Vec<u8>,
    /// First coefficient of the merges that split nodes of each depth `0..j_high`, then `N`.
    levels: Vec<u32>,
    leaves: Arc<Vec<Leaf>>,
    j_high: u8,
    /// Neighbour relations, built level by level on first use.
    pyramid: Arc<Pyramid>,
    /// Sums of the weights of the leaves before each; empty if all weights are 1.
    prefix: Vec<u64>,
}

impl Plan {
    /// The plan for `leaves` with weight 1 each.
    ///
    /// # Errors
    /// If the leaves are not sorted, disjoint cells of a tree of depth `j_high`.
    pub fn new(leaves: &[Leaf], j_high: u8) -> Result<Self> {
        Self::of(leaves.to_vec(), j_high)
    }

    /// As [`Plan::new`], without a copy of the leaves, which may be shared; [`Plan::into_leaves`]
    /// gives them back.
    ///
    /// # Errors
    /// As [`Plan::new`].
    pub fn of(leaves: impl Into<Arc<Vec<Leaf>>>, j_high: u8) -> Result<Self> {
        let leaves = leaves.into();
        check_leaves(&leaves, j_high)?;
        Ok(Self::build(leaves, j_high, None))
    }

    /// The plan for `leaves` with an importance weight each.
    ///
    /// # Errors
    /// As [`Plan::new`]; also if a weight is 0, the sum reaches [`MAX_WEIGHT_SUM`], or the counts
    /// differ.
    pub fn with_weights(leaves: &[Leaf], j_high: u8, weights: &[u32]) -> Result<Self> {
        check_leaves(leaves, j_high)?;
        check_weights(leaves.len(), weights)?;
        Ok(Self::build(Arc::new(leaves.to_vec()), j_high, Some(weights)))
    }

    /// The same leaves with other weights: what [`Plan::with_weights`] gives, for less. Neighbour
    /// relations already found are kept.
    ///
    /// # Errors
    /// As [`Plan::with_weights`].
    pub fn weighted(mut self, weights: &[u32]) -> Result<Self> {
        check_weights(self.points, weights)?;
        self.prefix = prefix_of(weights);
        let factors = Factors::new();
        for m in 0..self.left.len() {
            let [w1, w2] = self.child_weights(m + 1);
            (self.share[m], self.scale[m]) = factors.of(w1, w2);
        }
        Ok(self)
    }

    fn build(leaves: Arc<Vec<Leaf>>, j_high: u8, weights: Option<&[u32]>) -> Self {
        let n = leaves.len();
        let merges = n.saturating_sub(1);
        let prefix = weights.map(prefix_of).unwrap_or_default();
        // Boundary j lies between leaves j-1 and j; its bit is the highest in which they differ.
        // A boundary's subtree reaches to the nearest boundaries with a higher bit.
        let mut bit = vec![0u8; n.max(1)];
        let mut first = vec![0u32; n.max(1)];
        let mut last = vec![n as u32; n.max(1)];
        let mut above = vec![0u32; n.max(1)];
        let mut stack: Vec<u32> = Vec::with_capacity(64);
        let mut histogram = [0u32; 22];
        for j in 1..n {
            let b = 63 - (leaves[j - 1].morton ^ leaves[j].morton).leading_zeros() as u8;
            bit[j] = b;
            histogram[b as usize / 3] += 1;
            while let Some(&t) = stack.last() {
                if bit[t as usize] >= b {
                    break;
                }
                stack.pop();
                last[t as usize] = j as u32;
                let left = stack.last().copied();
                // The smaller of the two enclosing boundaries is the parent.
                above[t as usize] = match left {
                    Some(l) if bit[l as usize] < b => l,
                    _ => j as u32,
                };
            }
            first[j] = stack.last().copied().unwrap_or(0);
            stack.push(j as u32);
        }
        while let Some(t) = stack.pop() {
            above[t as usize] = stack.last().copied().unwrap_or(0);
        }
        // Counting sort by octree level, coarse first; Morton order within it, but within a block
        // (boundaries under one node) the higher bit comes first.
        let mut levels = vec![1u32];
        for depth in 0..j_high {
            let before = levels[depth as usize];
            levels.push(before + histogram[(j_high - 1 - depth) as usize]);
        }
        // By level from the finest: the next slot, the first of the block, the block's node.
        let mut slots = [(0usize, 0usize, u64::MAX); 22];
        for (slot, &first) in slots.iter_mut().zip(levels.iter().rev().skip(1)) {
            slot.0 = first as usize - 1;
        }
        let mut sorted = vec![0u32; merges];
        for j in 1..n {
            let b = bit[j];
            let (next, block, node) = &mut slots[usize::from(b / 3)];
            let here = leaves[j].morton >> (3 * (b / 3) + 3);
            if here != *node {
                (*block, *node) = (*next, here);
            }
            let mut at = *next;
            *next += 1;
            while at > *block && bit[sorted[at - 1] as usize] < b {
                sorted[at] = sorted[at - 1];
                at -= 1;
            }
            sorted[at] = j as u32;
        }
        let mut plan = Self {
            points: n,
            left: vec![0; merges],
            right: Vec::new(),
            parent: vec![0; merges],
            end: vec![0; merges],
            share: vec![0.0; merges],
            scale: vec![0.0; merges],
            axis: vec![0; merges],
            levels,
            leaves,
            j_high,
            pyramid: Arc::default(),
            prefix,
        };
        // Parents come before their children, and what is above all is 0.
        let mut index = vec![0u32; n.max(1)];
        let factors = Factors::new();
        for (m, &j) in sorted.iter().enumerate() {
            let (j, at) = (j as usize, j);
            index[j] = m as u32 + 1;
            plan.left[m] = first[j];
            plan.parent[m] = index[above[j] as usize];
            plan.axis[m] = 2 - bit[j] % 3;
            let w1 = plan.weight_of(first[j], at);
            let w2 = plan.weight_of(at, last[j]);
            plan.end[m] = last[j];
            (plan.share[m], plan.scale[m]) = factors.of(w1, w2);
        }
        plan.right = sorted;
        plan
    }

    /// Number of points, and of coefficients.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points
    }

    /// The leaves.
    #[must_use]
    pub fn leaves(&self) -> &[Leaf] {
        &self.leaves
    }

    /// The leaves, of a plan that is not needed any more.
    #[must_use]
    pub fn into_leaves(self) -> Vec<Leaf> {
        Arc::unwrap_or_clone(self.leaves)
    }

    /// `sqrt(w)` of each leaf; nothing if all are 1.
    fn root_weights(&self) -> impl Iterator<Item = f64> {
        self.prefix.windows(2).map(|w| ((w[1] - w[0]) as f64).sqrt())
    }

    /// True for a plan of no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points == 0
    }

    /// Coefficient index of the merge above coefficient `k`; 0 (the DC) for the root merge.
    #[must_use]
    pub fn parent(&self, k: usize) -> usize {
        if k == 0 { 0 } else { self.parent[k - 1] as usize }
    }

    /// The parents of coefficients `1..len()`, in order.
    #[must_use]
    pub fn parents(&self) -> &[u32] {
        &self.parent
    }

    /// The axis (0 = x, 1 = y, 2 = z) that coefficients `1..len()` split, in order.
    #[must_use]
    pub fn axes(&self) -> &[u8] {
        &self.axis
    }

    /// First coefficient of the merges that split nodes of each depth `0..j_high`, then `len()`
    /// (or 1 if that is greater). The DC (coefficient 0) precedes the first.
    #[must_use]
    pub fn levels(&self) -> &[u32] {
        &self.levels
    }

    /// Sum of the weights of leaves `a..b`.
    fn weight_of(&self, a: u32, b: u32) -> u64 {
        if self.prefix.is_empty() {
            u64::from(b - a)
        } else {
            self.prefix[b as usize] - self.prefix[a as usize]
        }
    }

    /// Builds the neighbour relations that prediction needs, which otherwise happens at its first
    /// use. They are kept, and shared by all channels and threads.
    pub fn prepare_prediction(&self) {
        self.prepare_levels(self.predicted_levels(true));
    }

    /// The same for so many levels from the top; levels that are asked for one by one are all built
    /// again for each.
    pub(crate) fn prepare_levels(&self, levels: usize) {
        if let Some(last) = levels.checked_sub(1) {
            let _ = self.pyramid.level(self, last);
        }
    }

    /// Of coefficient `k >= 1`: what takes a high-pass value to a difference of means.
    #[inline]
    pub(crate) fn scale_of(&self, k: usize) -> f32 {
        self.scale[k - 1]
    }

    /// Of coefficient `k >= 1`: the share of the right child in the mean.
    #[inline]
    pub(crate) fn share_of(&self, k: usize) -> f32 {
        self.share[k - 1]
    }

    /// The root of the sum of all weights: what takes the mean of all leaves to coefficient 0.
    pub(crate) fn root_of_weight(&self) -> f64 {
        (self.weight_of(0, self.points as u32).max(1) as f64).sqrt()
    }

    /// Number of octree levels, from the top, that may be predicted from the one above: all if
    /// `fine`, else as long as they have few of the coefficients.
    pub(crate) fn predicted_levels(&self, fine: bool) -> usize {
        if self.points >= 1 << pyramid::LEAF_BITS {
            return 0;
        }
        if fine {
            return self.levels.len() - 1;
        }
        let most = PREDICTED_AT_LEAST.max(self.points / 1000 * PREDICTED_PER_MILLE);
        self.levels[1..].iter().take_while(|&&k| k as usize <= most).count()
    }

    /// The first leaf on the far side of the split of coefficient `k >= 1`: one coefficient per
    /// leaf but the first.
    #[must_use]
    pub fn split_leaf(&self, k: usize) -> usize {
        self.right[k - 1] as usize
    }

    /// Weights of the two children of coefficient `k >= 1`.
    #[must_use]
    pub fn child_weights(&self, k: usize) -> [u64; 2] {
        let (left, right) = (self.left[k - 1], self.right[k - 1]);
        [self.weight_of(left, right), self.weight_of(right, self.end[k - 1])]
    }

    fn check(&self, len: usize) -> Result<()> {
        if len == self.points {
            Ok(())
        } else {
            Err(Error::ChannelLength { channel: 0, got: len, want: self.points })
        }
    }

    fn to_coefficient_order<T: Copy>(&self, values: &[T]) -> Vec<T> {
        let dc = values.first().copied();
        dc.into_iter().chain(self.right.iter().map(|&j| values[j as usize])).collect()
    }

    fn to_leaf_order<T: Copy + Default>(&self, coefficients: &[T]) -> Vec<T> {
        let mut values = vec![T::default(); coefficients.len()];
        if let Some((&dc, rest)) = coefficients.split_first() {
            values[0] = dc;
            for (&j, &c) in self.right.iter().zip(rest) {
                values[j as usize] = c;
            }
        }
        values
    }
}

fn check_weights(leaves: usize, weights: &[u32]) -> Result<()> {
    if weights.len() != leaves {
        return Err(Error::Count { what: "leaf weights", got: weights.len(), want: leaves });
    }
    let mut sum = 0u64;
    for (index, &w) in weights.iter().enumerate() {
        sum += u64::from(w);
        if w == 0 || sum >= MAX_WEIGHT_SUM {
            return Err(Error::Weight { index, weight: u64::from(w) });
        }
    }
    Ok(())
}

/// Sums of the weights before each leaf, and of all.
fn prefix_of(weights: &[u32]) -> Vec<u64> {
    let mut sum = 0;
    let sums = weights.iter().map(|&w| {
        sum += u64::from(w);
        sum
    });
    std::iter::once(0).chain(sums).collect()
}

/// Share of the right child in the mean, and what takes a high-pass value to a difference of means.
fn factors(left: u64, right: u64) -> (f32, f32) {
    let (w1, w2) = (left as f64, right as f64);
    ((w2 / (w1 + w2)) as f32, ((w1 + w2) / (w1 * w2)).sqrt() as f32)
}

/// Weights below this have their [`factors`] in a table: most merges are of a few leaves.
const FEW: u64 = 16;

struct Factors([[(f32, f32); FEW as usize]; FEW as usize]);

impl Factors {
    fn new() -> Self {
        Self(std::array::from_fn(|l| std::array::from_fn(|r| factors(l as u64, r as u64))))
    }

    #[inline]
    fn of(&self, left: u64, right: u64) -> (f32, f32) {
        if left < FEW && right < FEW {
            self.0[left as usize][right as usize]
        } else {
            factors(left, right)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some_leaves() -> Vec<Leaf> {
        let leaves = (0..300u64).map(|i| Leaf { morton: i * i % 4093, depth: 5 });
        let mut leaves: Vec<Leaf> = leaves.collect();
        leaves.sort_unstable();
        leaves.dedup();
        leaves
    }

    #[test]
    fn neighbour_relations_do_not_depend_on_what_was_asked_for_before() {
        let [at_once, bit_by_bit] = [(); 2].map(|()| Plan::new(&some_leaves(), 5).unwrap());
        at_once.prepare_levels(5);
        for levels in [2, 1, 3, 5] {
            bit_by_bit.prepare_levels(levels);
        }
        for depth in 0..5 {
            let terms = at_once.pyramid.level(&at_once, depth);
            assert!(depth == 0 || terms.len() > 0);
            assert_eq!(terms, bit_by_bit.pyramid.level(&bit_by_bit, depth));
        }
    }

    #[test]
    fn weights_may_come_later() {
        let leaves = some_leaves();
        let weights: Vec<u32> = (0..leaves.len() as u32).map(|i| 1 + i * 7 % 50).collect();
        let at_once = Plan::with_weights(&leaves, 5, &weights).unwrap();
        let later = Plan::new(&leaves, 5).unwrap().weighted(&weights).unwrap();
        assert_eq!((&at_once.share, &at_once.scale), (&later.share, &later.scale));
        assert_eq!(at_once.prefix, later.prefix);
        assert!(later.root_weights().map(|r| (r * r).round() as u32).eq(weights.iter().copied()));
        assert!(Plan::new(&leaves, 5).unwrap().weighted(&weights[1..]).is_err());
        assert!(Plan::new(&leaves, 5).unwrap().weighted(&vec![0; leaves.len()]).is_err());
    }
}
