//! The transform of many channels at once, on the means of nodes rather than their low-pass values.
//!
//! A row holds the channels of a leaf, four to a chunk. While a tree is taken apart (or put
//! together) the mean of a node is at its first leaf, and the difference of the means of a merge's
//! children at the first leaf of the right one: the high-pass value is that difference times
//! `sqrt(w1 w2 / w)`. A difference of zero costs a copy; nothing grows with the number of leaves,
//! so single precision keeps every bit that matters.
//!
//! The values of a node's children are predicted from the means of the node, of its neighbours and
//! of those neighbours' children that are already known; the prediction goes through the same
//! merges, and only what the differences differ from it is coded.

use super::Plan;
use super::blocks::MERGES_AT_MOST;
use crate::context::CHUNK;

/// Four channels of a row.
pub(crate) type Lanes = [f32; CHUNK];

/// Where the differences come from.
pub(crate) trait Residual {
    /// Whether `row` of [`Residual::differences`] is to hold what was stored before.
    const STORED: bool;
    /// Whether the mean of the node that a coefficient splits is wanted, as far as it is rebuilt.
    const MEANS: bool;

    /// Called before each octree level; the strength of the prediction there, one per channel, or
    /// nothing if none is predicted.
    fn start_level(&mut self, depth: usize) -> Option<&[Lanes]>;

    /// Turns `row` into the differences of coefficient `k`; false if all of them are zero. Called
    /// for `1..plan.len()` in order. `mean` is that of the first channel, or 0 if not wanted;
    /// `predicted` is empty or has one entry per chunk.
    fn differences(&mut self, k: usize, mean: f32, predicted: &[Lanes], row: &mut [Lanes]) -> bool;
}

/// Puts the differences of coefficient `k` into the mean at its left child.
#[inline]
fn split(plan: &Plan, k: usize, rows: &mut [Lanes], row: &[Lanes]) {
    let width = row.len();
    let share = plan.share[k - 1];
    let (l, r) = (plan.left[k - 1] as usize * width, plan.right[k - 1] as usize * width);
    let (left, right) = rows.split_at_mut(r);
    for ((left, right), d) in left[l..l + width].iter_mut().zip(&mut right[..width]).zip(row) {
        for i in 0..CHUNK {
            left[i] -= d[i] * share;
            right[i] = left[i] + d[i];
        }
    }
}

/// The same with the differences at the right child, in whose place its mean goes.
#[inline]
fn split_stored(plan: &Plan, k: usize, rows: &mut [Lanes], width: usize) {
    let share = plan.share[k - 1];
    let (l, r) = (plan.left[k - 1] as usize * width, plan.right[k - 1] as usize * width);
    let (left, right) = rows.split_at_mut(r);
    for (left, right) in left[l..l + width].iter_mut().zip(&mut right[..width]) {
        for i in 0..CHUNK {
            let d = right[i];
            left[i] -= d * share;
            right[i] = left[i] + d;
        }
    }
}

/// The same for differences that are all zero.
#[inline]
fn split_equal(plan: &Plan, k: usize, rows: &mut [Lanes], width: usize) {
    let (l, r) = (plan.left[k - 1] as usize * width, plan.right[k - 1] as usize * width);
    let (left, right) = rows.split_at_mut(r);
    // A length that is known is a few moves, not a call.
    match width {
        1 => copy_chunks::<1>(&left[l..], right),
        2 => copy_chunks::<2>(&left[l..], right),
        3 => copy_chunks::<3>(&left[l..], right),
        4 => copy_chunks::<4>(&left[l..], right),
        6 => copy_chunks::<6>(&left[l..], right),
        _ => right[..width].copy_from_slice(&left[l..l + width]),
    }
}

#[inline]
fn copy_chunks<const N: usize>(from: &[Lanes], to: &mut [Lanes]) {
    to[..N].copy_from_slice(&from[..N]);
}

/// Means of all leaves from that of the root, at leaf 0 of `rows`, and the differences that
/// `source` gives. After `levels` octree levels the rows stay as they are.
pub(crate) fn reconstruct<R: Residual>(
    plan: &Plan,
    width: usize,
    rows: &mut [Lanes],
    levels: usize,
    source: &mut R,
) {
    let mut row = vec![[0.0; CHUNK]; width];
    let mut predicted = vec![[0.0; CHUNK]; width * MERGES_AT_MOST];
    let mut strength = vec![[0.0; CHUNK]; width];
    for (depth, level) in plan.levels.windows(2).enumerate() {
        let range = level[0] as usize..level[1] as usize;
        let predicts = source.start_level(depth).map(|s| strength.copy_from_slice(s)).is_some();
        if depth >= levels {
            for k in range {
                let at = plan.right[k - 1] as usize * width;
                source.differences(k, 0.0, &[], &mut rows[at..at + width]);
            }
            continue;
        }
        let mut one = |k: usize, predicted: &[Lanes], rows: &mut [Lanes]| {
            let mean = if R::MEANS { rows[plan.left[k - 1] as usize * width][0] } else { 0.0 };
            if R::STORED {
                // Where they are, without a copy.
                let at = plan.right[k - 1] as usize * width;
                if source.differences(k, mean, predicted, &mut rows[at..at + width]) {
                    split_stored(plan, k, rows, width);
                } else {
                    split_equal(plan, k, rows, width);
                }
            } else if source.differences(k, mean, predicted, &mut row) {
                split(plan, k, rows, &row);
            } else {
                split_equal(plan, k, rows, width);
            }
        };
        if !predicts {
            for k in range {
                one(k, &[], rows);
            }
            continue;
        }
        let mut k = range.start;
        for block in plan.pyramid.level(plan, depth).blocks() {
            let count = block.merges.len();
            let own = plan.left[k - 1] as usize;
            if block.terms.is_empty() {
                (k..k + count).for_each(|k| one(k, &[], rows));
            } else {
                let shares = &plan.share[k - 1..k - 1 + count];
                block.predict(shares, own, rows, &strength, &mut predicted);
                for m in 0..count {
                    one(k + m, &predicted[m * width..(m + 1) * width], rows);
                }
            }
            k += count;
        }
    }
}

/// What the prediction of one level explains: per chunk and channel, over the blocks looked at,
/// sums of high-pass values squared, times their prediction, and of predictions squared.
#[derive(Clone, Debug, Default)]
pub(crate) struct Gains {
    pub(crate) sums: Vec<[[f64; 3]; CHUNK]>,
    /// Coefficients looked at.
    pub(crate) looked_at: usize,
    /// Blocks of the level.
    pub(crate) blocks: usize,
}

/// Blocks looked at in a run when gains are measured, and one run of how many.
const RUN: usize = 64;
const ONE_OF: usize = 4;

/// The forward transform of rows of values, in place; also what predictions of the first `measured`
/// levels would explain. Only a quarter of the larger levels is looked at, which costs less than
/// 0.1 % in rate; the means are the exact ones.
pub(crate) fn forward(
    plan: &Plan,
    width: usize,
    rows: &mut [Lanes],
    measured: usize,
) -> Vec<Gains> {
    let mut gains = vec![Gains::default(); measured];
    let mut predicted = vec![[0.0; CHUNK]; width * MERGES_AT_MOST];
    let ones = vec![[1.0; CHUNK]; width];
    for depth in (0..plan.levels.len() - 1).rev() {
        let range = plan.levels[depth] as usize..plan.levels[depth + 1] as usize;
        if depth >= measured {
            range.rev().for_each(|k| merge(plan, k, rows, width));
            continue;
        }
        let terms = plan.pyramid.level(plan, depth);
        let g = &mut gains[depth];
        g.blocks = terms.len();
        g.sums = vec![Default::default(); width];
        let sample = terms.len() > 16 * RUN;
        let mut end = range.end;
        for (i, block) in terms.blocks_backwards().enumerate() {
            let count = block.merges.len();
            let k = end - count;
            // In this order the means are those that a decoder would have here: of the nodes
            // that follow, and of the children of those that precede.
            (k..end).rev().for_each(|k| merge(plan, k, rows, width));
            end = k;
            if sample && !(i / RUN).is_multiple_of(ONE_OF) {
                continue;
            }
            g.looked_at += count;
            if block.terms.is_empty() {
                predicted[..count * width].fill([0.0; CHUNK]);
            } else {
                let shares = &plan.share[k - 1..k - 1 + count];
                block.predict(shares, plan.left[k - 1] as usize, rows, &ones, &mut predicted);
            }
            for m in 0..count {
                let scale = plan.scale[k - 1 + m];
                let gain = f64::from(1.0 / (scale * scale));
                let at = plan.right[k - 1 + m] as usize * width;
                for (chunk, sums) in g.sums.iter_mut().enumerate() {
                    for i in 0..CHUNK {
                        let e = f64::from(rows[at + chunk][i]);
                        let p = f64::from(predicted[m * width + chunk][i]);
                        sums[i][0] += e * e * gain;
                        sums[i][1] += e * p * gain;
                        sums[i][2] += p * p * gain;
                    }
                }
            }
        }
    }
    gains
}

/// Replaces the means of the children of coefficient `k` by their mean and their difference.
#[inline]
fn merge(plan: &Plan, k: usize, rows: &mut [Lanes], width: usize) {
    let share = plan.share[k - 1];
    let (l, r) = (plan.left[k - 1] as usize * width, plan.right[k - 1] as usize * width);
    let (left, right) = rows.split_at_mut(r);
    for (left, right) in left[l..l + width].iter_mut().zip(&mut right[..width]) {
        for i in 0..CHUNK {
            let d = right[i] - left[i];
            left[i] += d * share;
            right[i] = d;
        }
    }
}
