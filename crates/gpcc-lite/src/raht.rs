//! RAHT: the region-adaptive hierarchical transform (de Queiroz and Chou, 2016).
//!
//! Sorted Morton codes form a binary radix tree with exactly `N - 1` merges, whatever its depth.
//! [`RahtPlan`] finds them once, in `O(N)`, for all channels. The transform is orthonormal: for
//! children with weights `w1`, `w2`
//!
//! ```text
//! low  = (sqrt(w1) a + sqrt(w2) b) / sqrt(w1 + w2)
//! high = (sqrt(w1) b - sqrt(w2) a) / sqrt(w1 + w2)
//! ```
//!
//! Leaf weights other than 1 say how important a leaf is: its value is multiplied by `sqrt(w)`, so
//! a uniform quantiser of the coefficients leaves the value an error smaller by `sqrt(w)`.
//!
//! Coefficient 0 is the DC. Coefficients `1..N` are the merges from coarse to fine by the bit of
//! the Morton code that they split at: three levels for each octree depth, x, then y, then z.
//! Within a level they are in Morton order. So the merge above a merge is always in an earlier
//! level.

mod float;
mod rows;

pub(crate) use rows::{LANES, Lanes, split, undo};
pub use rows::{Rows, forward, inverse};

use crate::error::{Error, Result};
use crate::leaf::Leaf;
use crate::octree::Octree;

/// Greatest sum of leaf weights (exclusive): sums of weights are exact in `f64`.
const MAX_WEIGHT_SUM: u64 = 1 << 50;

/// The merges of a set of leaves, shared by all channels.
#[derive(Clone, Debug, Default)]
pub struct RahtPlan {
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
    /// Per merge: see [`RahtPlan::noise_gain`].
    noise_gain: Vec<f32>,
    /// First coefficient of each level of merges, `3 tree_depth` levels, then `N`.
    levels: Vec<u32>,
    tree: Octree,
    /// Sums of the weights of the leaves before each, and of their squares; empty if all weights
    /// are 1.
    prefix: Vec<Sums>,
}

/// A merge of a [`RahtPlan`], for an executor that does not run in Rust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RahtMerge {
    /// First leaf of the left child: its row holds the mean of the node.
    pub left: u32,
    /// First leaf of the right child: its row holds the difference of the children's means.
    pub right: u32,
    /// Coefficient of the merge above; 0 for the root.
    pub parent: u32,
    /// Weight of the right child over that of the node.
    pub share: f32,
    /// `sqrt(w / (w1 w2))`, which takes a coefficient to the difference of the children's means.
    pub scale: f32,
    /// Standard deviation of the coefficient if the values of the leaves were independent, each with one
    /// of 1.
    pub noise_gain: f32,
}

/// Sums of weights and of squared weights.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sums {
    weights: f64,
    squares: f64,
}

impl RahtPlan {
    /// The plan for the leaves of an octree, with weight 1 each.
    #[must_use]
    pub fn new(tree: Octree) -> Self {
        let points = tree.len();
        let merges = points.saturating_sub(1);
        let boundaries = Boundaries::between(tree.leaves());
        let (levels, sorted) = boundaries.sorted(tree.depth());
        let mut plan = Self {
            left: vec![0; merges],
            right: Vec::new(),
            parent: vec![0; merges],
            end: vec![0; merges],
            share: vec![0.0; merges],
            scale: vec![0.0; merges],
            noise_gain: vec![1.0; merges],
            levels,
            tree,
            prefix: Vec::new(),
        };
        // Parents come before their children. No boundary is above the root's: its parent is 0, the
        // DC.
        let mut coefficient = vec![0u32; points.max(1)];
        for (m, &j) in sorted.iter().enumerate() {
            let j = j as usize;
            coefficient[j] = m as u32 + 1;
            plan.left[m] = boundaries.first[j];
            plan.parent[m] = coefficient[boundaries.above[j] as usize];
            plan.end[m] = boundaries.end[j];
        }
        plan.right = sorted;
        for m in 0..merges {
            plan.set_factors(m);
        }
        plan
    }

    /// The plan for the same leaves with an importance weight each.
    ///
    /// # Errors
    /// If a weight is 0, the sum reaches 2^50, or the counts differ.
    pub fn weighted(mut self, weights: &[u32]) -> Result<Self> {
        check_weights(self.len(), weights)?;
        self.prefix = prefix_of(weights);
        for m in 0..self.left.len() {
            self.set_factors(m);
        }
        Ok(self)
    }

    /// Sets what a merge needs of the weights of its children.
    #[inline]
    fn set_factors(&mut self, merge: usize) {
        let (left, right, end) = (self.left[merge], self.right[merge], self.end[merge]);
        if self.prefix.is_empty() {
            let (w1, w2) = (f64::from(right - left), f64::from(end - right));
            self.share[merge] = (w2 / (w1 + w2)) as f32;
            self.scale[merge] = ((w1 + w2) / (w1 * w2)).sqrt() as f32;
            return;
        }
        let at = |leaf: u32| self.prefix[leaf as usize];
        let (a, b, c) = (at(left), at(right), at(end));
        let (w1, w2) = (b.weights - a.weights, c.weights - b.weights);
        let (s1, s2) = (b.squares - a.squares, c.squares - b.squares);
        let inverse = (w1 + w2) / (w1 * w2);
        self.share[merge] = (w2 / (w1 + w2)) as f32;
        self.scale[merge] = inverse.sqrt() as f32;
        self.noise_gain[merge] = ((s1 / (w1 * w1) + s2 / (w2 * w2)) / inverse).sqrt() as f32;
    }

    /// The merge of coefficient `k >= 1`.
    #[must_use]
    pub fn merge(&self, k: usize) -> RahtMerge {
        let m = k - 1;
        RahtMerge {
            left: self.left[m],
            right: self.right[m],
            parent: self.parent[m],
            share: self.share[m],
            scale: self.scale[m],
            noise_gain: self.noise_gain[m],
        }
    }

    /// Number of points, and of coefficients.
    #[must_use]
    pub fn len(&self) -> usize {
        self.tree.len()
    }

    /// The octree.
    #[must_use]
    pub fn octree(&self) -> &Octree {
        &self.tree
    }

    /// Its leaves.
    #[must_use]
    pub fn leaves(&self) -> &[Leaf] {
        self.tree.leaves()
    }

    /// `sqrt(w)` of each leaf; nothing if all are 1.
    fn root_weights(&self) -> impl Iterator<Item = f64> {
        self.prefix.windows(2).map(|w| (w[1].weights - w[0].weights).sqrt())
    }

    /// Weight of a leaf.
    #[must_use]
    pub fn weight_of_leaf(&self, leaf: usize) -> f64 {
        self.weight_of(leaf as u32, leaf as u32 + 1)
    }

    /// True for a plan of no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.tree.is_empty()
    }

    /// Coefficient index of the merge above coefficient `k`; 0 (the DC) for the root merge.
    #[must_use]
    pub fn parent(&self, k: usize) -> usize {
        if k == 0 { 0 } else { self.parent[k - 1] as usize }
    }

    /// The parents of coefficients `1..len()`, in order.
    pub(crate) fn parents(&self) -> &[u32] {
        &self.parent
    }

    /// First coefficient of each level of merges, `3 tree_depth` levels, then `len()` (or 1 if that is
    /// greater). The DC (coefficient 0) precedes the first.
    #[must_use]
    pub fn levels(&self) -> &[u32] {
        &self.levels
    }

    /// Sum of the weights of leaves `a..b`.
    fn weight_of(&self, a: u32, b: u32) -> f64 {
        if self.prefix.is_empty() {
            f64::from(b - a)
        } else {
            self.prefix[b as usize].weights - self.prefix[a as usize].weights
        }
    }

    /// Of coefficient `k >= 1`: `sqrt(w / (w1 w2))`, which takes a high-pass value to a difference
    /// of means.
    #[inline]
    pub(crate) fn scale_of(&self, k: usize) -> f32 {
        self.scale[k - 1]
    }

    /// Of coefficient `k >= 1`: its standard deviation if the leaves' values were independent, each
    /// with a standard deviation of 1. With equal weights it is 1. A leaf that outweighs its
    /// neighbours makes it large.
    #[inline]
    pub(crate) fn noise_gain(&self, k: usize) -> f32 {
        self.noise_gain[k - 1]
    }

    /// [`RahtPlan::noise_gain`] of coefficients `1..len()`.
    pub(crate) fn noise_gains(&self) -> &[f32] {
        &self.noise_gain
    }

    /// The root of the sum of all weights: what takes the mean of all leaves to coefficient 0.
    #[must_use]
    pub fn root_of_weight(&self) -> f64 {
        self.weight_of(0, self.len() as u32).max(1.0).sqrt()
    }

    /// The first leaf on the far side of the split of coefficient `k >= 1`: one coefficient per
    /// leaf but the first.
    #[must_use]
    pub fn split_leaf(&self, k: usize) -> usize {
        self.right[k - 1] as usize
    }

    /// Weights of the two children of coefficient `k >= 1`.
    #[must_use]
    pub fn child_weights(&self, k: usize) -> [f64; 2] {
        let (left, right) = (self.left[k - 1], self.right[k - 1]);
        [self.weight_of(left, right), self.weight_of(right, self.end[k - 1])]
    }

    fn check(&self, len: usize) -> Result<()> {
        if len == self.len() {
            Ok(())
        } else {
            Err(Error::ChannelLength { channel: 0, got: len, want: self.len() })
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

/// The boundaries between consecutive leaves. Boundary `j` lies before leaf `j`, and every boundary
/// separates the two children of one merge. Entry 0 is not used.
struct Boundaries {
    /// The bit of the Morton code at which the merge splits: the highest in which leaves `j - 1`
    /// and `j` differ.
    bit: Vec<u8>,
    /// The merge's first leaf.
    first: Vec<u32>,
    /// The leaf after the merge's last.
    end: Vec<u32>,
    /// The boundary of the merge above; 0 for the root.
    above: Vec<u32>,
}

impl Boundaries {
    /// Finds all merges in one pass. A merge reaches on both sides to the nearest boundary with a
    /// higher bit, and the lower of these two is the merge above.
    fn between(leaves: &[Leaf]) -> Self {
        let n = leaves.len();
        let mut bit = vec![0u8; n.max(1)];
        let mut first = vec![0u32; n.max(1)];
        let mut end = vec![n as u32; n.max(1)];
        let mut above = vec![0u32; n.max(1)];
        // Boundaries whose end is not known yet: their bits descend.
        let mut open: Vec<u32> = Vec::with_capacity(64);
        for j in 1..n {
            let b = 63 - (leaves[j - 1].morton ^ leaves[j].morton).leading_zeros() as u8;
            bit[j] = b;
            while let Some(&t) = open.last() {
                if bit[t as usize] >= b {
                    break;
                }
                open.pop();
                end[t as usize] = j as u32;
                above[t as usize] = match open.last().copied() {
                    Some(left) if bit[left as usize] < b => left,
                    _ => j as u32,
                };
            }
            first[j] = open.last().copied().unwrap_or(0);
            open.push(j as u32);
        }
        while let Some(t) = open.pop() {
            above[t as usize] = open.last().copied().unwrap_or(0);
        }
        Self { bit, first, end, above }
    }

    /// The boundaries by descending bit, in Morton order within a bit, and the first coefficient of
    /// each bit: a counting sort.
    fn sorted(&self, tree_depth: u8) -> (Vec<u32>, Vec<u32>) {
        let bits = 3 * usize::from(tree_depth);
        let mut histogram = [0u32; 64];
        for &b in &self.bit[1..] {
            histogram[usize::from(b)] += 1;
        }
        let mut levels = vec![1u32];
        for b in (0..bits).rev() {
            levels.push(levels[levels.len() - 1] + histogram[b]);
        }
        let mut slots: Vec<u32> = levels.iter().map(|&first| first - 1).collect();
        let mut sorted = vec![0u32; self.bit.len() - 1];
        for (j, &b) in self.bit.iter().enumerate().skip(1) {
            let slot = &mut slots[bits - 1 - usize::from(b)];
            sorted[*slot as usize] = j as u32;
            *slot += 1;
        }
        (levels, sorted)
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

/// Sums over the leaves before each, and over all.
fn prefix_of(weights: &[u32]) -> Vec<Sums> {
    let mut sum = Sums::default();
    let sums = weights.iter().map(|&w| {
        let w = f64::from(w);
        sum.weights += w;
        sum.squares += w * w;
        sum
    });
    std::iter::once(Sums::default()).chain(sums).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some_leaves() -> Octree {
        let leaves = (0..300u64).map(|i| Leaf { morton: i * i % 4093, depth: 5 });
        let mut leaves: Vec<Leaf> = leaves.collect();
        leaves.sort_unstable();
        leaves.dedup();
        Octree::of_points(5, leaves).unwrap()
    }

    #[test]
    fn weights_of_one_change_nothing_and_others_come_back() {
        let plan = RahtPlan::new(some_leaves());
        let ones = plan.clone().weighted(&vec![1; plan.len()]).unwrap();
        assert_eq!((&plan.share, &plan.scale), (&ones.share, &ones.scale));
        assert_eq!(plan.noise_gain, ones.noise_gain);
        let weights: Vec<u32> = (0..plan.len() as u32).map(|i| 1 + i * 7 % 50).collect();
        let weighted = plan.clone().weighted(&weights).unwrap();
        assert!(
            weighted.root_weights().map(|r| (r * r).round() as u32).eq(weights.iter().copied())
        );
        assert!(plan.clone().weighted(&weights[1..]).is_err());
        assert!(plan.clone().weighted(&vec![0; plan.len()]).is_err());
    }
}
