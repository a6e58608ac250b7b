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
mod closed_loop;
mod float;
mod forward;
mod pyramid;

pub(crate) use closed_loop::{Residual, reconstruct};
pub(crate) use forward::Forward;
use pyramid::Pyramid;
use std::sync::OnceLock;

use crate::error::{Error, Result};
use crate::leaf::{Leaf, check_leaves};

/// Fraction bits of the butterfly factors of the fixed-point transform.
pub const FACTOR_BITS: u32 = 30;

/// Greatest sum of leaf weights (exclusive): keeps `|value| 2^12 sqrt(sum)` below 2^62 for
/// every `i32` value.
pub const MAX_WEIGHT_SUM: u64 = 1 << 36;

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
    /// Per merge: `[sqrt(w1 / w), sqrt(w2 / w)]` with [`FACTOR_BITS`] fraction bits.
    factor: Vec<[i32; 2]>,
    /// Per merge: `sqrt(w1 w2 / w)`, which takes a difference of the children's means to the
    /// high-pass value.
    gain: Vec<f32>,
    /// Per merge: axis it splits, 0 = x, 1 = y, 2 = z.
    axis: Vec<u8>,
    /// First coefficient of the merges that split nodes of each depth `0..j_high`, then `N`.
    levels: Vec<u32>,
    /// `sqrt(w)` of each leaf, or empty if all are 1.
    root_weight: Vec<f64>,
    leaves: Vec<Leaf>,
    j_high: u8,
    /// Neighbour relations, built on first use.
    pyramid: OnceLock<Pyramid>,
    /// Sums of the weights of the leaves before each; empty if all weights are 1.
    prefix: Vec<u64>,
}

impl Plan {
    /// The plan for `leaves` with weight 1 each.
    ///
    /// # Errors
    /// If the leaves are not sorted, disjoint cells of a tree of depth `j_high`.
    pub fn new(leaves: &[Leaf], j_high: u8) -> Result<Self> {
        check_leaves(leaves, j_high)?;
        Ok(Self::build(leaves, j_high, None))
    }

    /// The plan for `leaves` with an importance weight each.
    ///
    /// # Errors
    /// As [`Plan::new`]; also if a weight is 0, the sum reaches [`MAX_WEIGHT_SUM`], or the counts
    /// differ.
    pub fn with_weights(leaves: &[Leaf], j_high: u8, weights: &[u32]) -> Result<Self> {
        check_leaves(leaves, j_high)?;
        if weights.len() != leaves.len() {
            return Err(Error::Count {
                what: "leaf weights",
                got: weights.len(),
                want: leaves.len(),
            });
        }
        let mut sum = 0u64;
        for (index, &w) in weights.iter().enumerate() {
            sum += u64::from(w);
            if w == 0 || sum >= MAX_WEIGHT_SUM {
                return Err(Error::Weight { index, weight: u64::from(w) });
            }
        }
        Ok(Self::build(leaves, j_high, Some(weights)))
    }

    fn build(leaves: &[Leaf], j_high: u8, weights: Option<&[u32]>) -> Self {
        let n = leaves.len();
        let merges = n.saturating_sub(1);
        let mut prefix: Vec<u64> = Vec::new();
        if let Some(w) = weights {
            prefix.reserve(n + 1);
            prefix.push(0);
            let mut sum = 0;
            for &x in w {
                sum += u64::from(x);
                prefix.push(sum);
            }
        }
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
        // Counting sort by octree level, coarse first; Morton order within it.
        let mut levels = vec![1u32];
        for depth in 0..j_high {
            let before = levels[depth as usize];
            levels.push(before + histogram[(j_high - 1 - depth) as usize]);
        }
        let mut slot = levels.clone();
        let mut sorted = vec![0u32; merges];
        for j in 1..n {
            let s = &mut slot[(j_high - 1 - bit[j] / 3) as usize];
            sorted[*s as usize - 1] = j as u32;
            *s += 1;
        }
        // Within a block (boundaries under one node) the higher bit comes first.
        for level in 0..j_high as usize {
            let shift = 3 * (u32::from(j_high) - level as u32);
            let run = &mut sorted[levels[level] as usize - 1..levels[level + 1] as usize - 1];
            let node = |j: u32| leaves[j as usize].morton >> shift;
            for block in run.chunk_by_mut(|&a, &b| node(a) == node(b)) {
                block.sort_by_key(|&j| std::cmp::Reverse(bit[j as usize]));
            }
        }
        let mut plan = Self {
            points: n,
            left: vec![0; merges],
            right: vec![0; merges],
            parent: vec![0; merges],
            end: vec![0; merges],
            factor: vec![[0; 2]; merges],
            gain: vec![0.0; merges],
            axis: vec![0; merges],
            levels,
            root_weight: weights
                .map(|w| w.iter().map(|&x| f64::from(x).sqrt()).collect())
                .unwrap_or_default(),
            leaves: leaves.to_vec(),
            j_high,
            pyramid: OnceLock::new(),
            prefix,
        };
        // Most merges are of few leaves: square roots and divisions would be half of the time.
        const FEW: u64 = 16;
        let known: Vec<([i32; 2], f32)> =
            (0..FEW * FEW).map(|i| (factors(i / FEW, i % FEW), gain(i / FEW, i % FEW))).collect();
        let mut index = vec![0u32; n.max(1)];
        for (m, &j) in sorted.iter().enumerate() {
            index[j as usize] = m as u32 + 1;
        }
        for (m, &j) in sorted.iter().enumerate() {
            let (j, at) = (j as usize, j);
            plan.left[m] = first[j];
            plan.right[m] = at;
            plan.parent[m] = if above[j] == 0 { 0 } else { index[above[j] as usize] };
            plan.axis[m] = 2 - bit[j] % 3;
            let w1 = plan.weight_of(first[j], at);
            let w2 = plan.weight_of(at, last[j]);
            plan.end[m] = last[j];
            (plan.factor[m], plan.gain[m]) = if w1 < FEW && w2 < FEW {
                known[(w1 * FEW + w2) as usize]
            } else {
                (factors(w1, w2), gain(w1, w2))
            };
        }
        plan
    }

    /// Number of points, and of coefficients.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points
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
        let _ = self.pyramid();
    }

    fn pyramid(&self) -> &Pyramid {
        self.pyramid.get_or_init(|| Pyramid::new(self))
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

    /// Forward transform in fixed point, from leaf order to coefficient order, in place.
    ///
    /// The scale of `values` is the caller's; rounding errors are a few units of its last place,
    /// so give it fraction bits (this crate's attribute coder uses 12).
    ///
    /// # Errors
    /// If `values` is not one per point.
    pub fn forward_fixed(&self, values: &mut Vec<i64>) -> Result<()> {
        self.check(values.len())?;
        for (v, &r) in values.iter_mut().zip(&self.root_weight) {
            *v = scale_up(*v, r);
        }
        for m in (0..self.left.len()).rev() {
            let [c, s] = self.factor[m].map(i128::from);
            let (i, j) = (self.left[m] as usize, self.right[m] as usize);
            let (a, b) = (i128::from(values[i]), i128::from(values[j]));
            values[i] = round_shift(c * a + s * b);
            values[j] = round_shift(c * b - s * a);
        }
        *values = self.to_coefficient_order(values);
        Ok(())
    }

    /// Inverse of [`Plan::forward_fixed`]: integers only (and correctly rounded IEEE square
    /// roots for the factors), hence the same bits on every machine.
    ///
    /// # Errors
    /// If `coefficients` is not one per point.
    pub fn inverse_fixed(&self, coefficients: &mut Vec<i64>) -> Result<()> {
        self.check(coefficients.len())?;
        let mut values = self.to_leaf_order(coefficients);
        for m in 0..self.left.len() {
            let [c, s] = self.factor[m].map(i128::from);
            let (i, j) = (self.left[m] as usize, self.right[m] as usize);
            let (low, high) = (i128::from(values[i]), i128::from(values[j]));
            values[i] = round_shift(c * low - s * high);
            values[j] = round_shift(s * low + c * high);
        }
        self.unweight(&mut values);
        *coefficients = values;
        Ok(())
    }

    /// Divides values in leaf order by the roots of the leaf weights.
    pub(crate) fn unweight(&self, values: &mut [i64]) {
        for (v, &r) in values.iter_mut().zip(&self.root_weight) {
            *v = scale_down(*v, r);
        }
    }

    /// One such value.
    #[inline]
    pub(crate) fn unweight_one(&self, leaf: usize, value: i64) -> i64 {
        match self.root_weight.get(leaf) {
            Some(&r) => scale_down(value, r),
            None => value,
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

/// `[sqrt(w1 / (w1 + w2)), sqrt(w2 / (w1 + w2))]`: IEEE division and square root, then exact
/// scaling by a power of two, so the integers agree everywhere.
fn factors(w1: u64, w2: u64) -> [i32; 2] {
    let one = f64::from(1u32 << FACTOR_BITS);
    let w = (w1 + w2) as f64;
    let f = |x: u64| ((x as f64 / w).sqrt() * one + 0.5) as i32;
    [f(w1), f(w2)]
}

fn gain(w1: u64, w2: u64) -> f32 {
    (w1 as f64 * (w2 as f64 / (w1 + w2) as f64)).sqrt() as f32
}

/// `1 / sqrt(w)`.
fn inverse_root(w: u64) -> f32 {
    (1.0 / (w as f64).sqrt()) as f32
}

#[inline]
fn round_shift(v: i128) -> i64 {
    ((v + (1 << (FACTOR_BITS - 1))) >> FACTOR_BITS) as i64
}

fn scale_up(v: i64, root: f64) -> i64 {
    ((i128::from(v) * i128::from((root * 65536.0) as i64)) >> 16) as i64
}

fn scale_down(v: i64, root: f64) -> i64 {
    // proof: root >= 1, so the divisor is at least 65536.
    ((i128::from(v) << 16) / i128::from((root * 65536.0) as i64)) as i64
}
