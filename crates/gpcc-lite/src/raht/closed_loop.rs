//! Inverse RAHT level by level, each level predicted from the one above.
//!
//! The values of a node's children are predicted from the reconstructed means of the node, of
//! its neighbours and of those neighbours' children that are already known; the prediction goes
//! through the same butterflies, and only the difference of the high-pass values is coded.

use super::pyramid::{NODE_BITS, SELF, WEIGHT};
use super::{FACTOR_BITS, GAIN_BITS, Plan, round_shift};

/// Where the high-pass values of `C` channels come from.
pub(crate) trait Residual<const C: usize> {
    /// Called before each octree level; the strength of the prediction there, in 1/16.
    fn start_level(&mut self, depth: usize) -> [i64; C];

    /// The reconstructed high-pass values `k`, given their predictions.
    fn high(&mut self, k: usize, predicted: [i64; C]) -> [i64; C];
}

/// Bounds of a mean: keeps sums of weighted means of a hostile stream within 63 bits.
const MEAN_MAX: i64 = 1 << 50;

/// The merges of a node by child mask, top down: ranks of the first child on either side.
const MERGES: [([(u8, u8); 7], u8); 256] = {
    let mut t = [([(0u8, 0u8); 7], 0u8); 256];
    let mut mask = 0usize;
    while mask < 256 {
        let mut count = 0;
        let mut size = 4; // children per half: x, then y, then z
        while size > 0 {
            let mut at = 0;
            while at < 8 {
                let low = (mask >> at) & ((1 << size) - 1);
                let high = (mask >> (at + size)) & ((1 << size) - 1);
                if low != 0 && high != 0 {
                    let l = (mask & ((1 << at) - 1)).count_ones() as u8;
                    let r = (mask & ((1 << (at + size)) - 1)).count_ones() as u8;
                    t[mask].0[count] = (l, r);
                    count += 1;
                }
                at += 2 * size;
            }
            size /= 2;
        }
        t[mask].1 = count as u8;
        mask += 1;
    }
    t
};

/// Reciprocals of the weight sums, 32 fraction bits.
const RECIPROCAL: [i64; 64] = {
    let mut t = [0i64; 64];
    let mut n = 1;
    while n < 64 {
        t[n] = (1 << 32) / n as i64;
        n += 1;
    }
    t
};

pub(crate) struct ClosedLoop;

impl ClosedLoop {
    /// Reconstructs all values (leaf order, still multiplied by the roots of the leaf weights)
    /// from the DC and from what `source` returns, which is asked for `1..plan.len()` in order.
    pub(crate) fn run<const C: usize, R: Residual<C>>(
        plan: &Plan,
        dc: [i64; C],
        source: &mut R,
    ) -> Vec<[i64; C]> {
        let pyramid = plan.pyramid();
        // Low-pass values at the first leaf of their node, means by node.
        let mut low = vec![[0i64; C]; plan.len()];
        let mut mean: Vec<[i64; C]> = Vec::with_capacity(pyramid.inverse_root.len());
        if let (Some(first), Some(&root)) = (low.first_mut(), pyramid.inverse_root.first()) {
            *first = dc;
            mean.push(dc.map(|v| mean_of(v, root)));
        }
        let mut k = 1usize;
        let mut terms = pyramid.terms.as_slice();
        for (depth, range) in pyramid.levels.windows(2).enumerate() {
            let strength = source.start_level(depth);
            let predicts = strength.iter().any(|&s| s != 0);
            for block in range[0] as usize..range[1] as usize {
                let (merges, count) = &MERGES[usize::from(pyramid.mask[block])];
                let count = usize::from(*count);
                let parent = pyramid.node[block] as usize;
                let base = mean.len();
                let mut predicted = [[0i64; C]; 7];
                let counts = &pyramid.count[base..=base + count];
                let all: usize = counts.iter().map(|&n| usize::from(n)).sum();
                let (here, rest) = terms.split_at(all);
                terms = rest;
                if predicts && all > 0 {
                    let mut value = [[0i64; C]; 8];
                    let mut from = here;
                    for (v, &n) in value[..=count].iter_mut().zip(counts) {
                        let (own, rest) = from.split_at(usize::from(n));
                        *v = predict(own, &mean[parent], &mean);
                        from = rest;
                    }
                    forward(plan, &merges[..count], k, &mut value, &strength, &mut predicted);
                }
                let mut value = [[0i64; C]; 8];
                let mut leaf = [0usize; 8];
                leaf[0] = plan.left[k - 1] as usize;
                value[0] = low[leaf[0]];
                for (m, p) in merges[..count].iter().zip(predicted) {
                    let (l, r) = (usize::from(m.0), usize::from(m.1));
                    let high = source.high(k, p);
                    let [c, s] = plan.factor[k - 1].map(i128::from);
                    for ch in 0..C {
                        let (v, h) = (i128::from(value[l][ch]), i128::from(high[ch]));
                        value[l][ch] = round_shift(c * v - s * h);
                        value[r][ch] = round_shift(s * v + c * h);
                    }
                    leaf[r] = plan.right[k - 1] as usize;
                    k += 1;
                }
                for (i, v) in value[..=count].iter().enumerate() {
                    low[leaf[i]] = *v;
                    mean.push(v.map(|v| mean_of(v, pyramid.inverse_root[base + i])));
                }
            }
        }
        low
    }
}

/// The weighted mean of the terms of a node.
#[inline]
fn predict<const C: usize>(terms: &[u32], own: &[i64; C], mean: &[[i64; C]]) -> [i64; C] {
    if terms.is_empty() {
        return *own;
    }
    let mut acc = own.map(|v| v * i64::from(SELF));
    let mut total = usize::from(SELF);
    for &t in terms {
        let other = &mean[(t & ((1 << NODE_BITS) - 1)) as usize];
        let weight = WEIGHT[(t >> NODE_BITS) as usize];
        total += usize::from(weight);
        for ch in 0..C {
            acc[ch] += other[ch] * i64::from(weight);
        }
    }
    let reciprocal = i128::from(RECIPROCAL[total & 63]);
    acc.map(|v| ((i128::from(v) * reciprocal) >> 32) as i64)
}

/// High-pass values of predicted means, times the strength.
#[inline]
fn forward<const C: usize>(
    plan: &Plan,
    merges: &[(u8, u8)],
    k: usize,
    value: &mut [[i64; C]; 8],
    strength: &[i64; C],
    predicted: &mut [[i64; C]; 7],
) {
    for (m, &(l, r)) in merges.iter().enumerate().rev() {
        let (l, r) = (usize::from(l), usize::from(r));
        let gain = i128::from(plan.gain[k + m - 1]);
        let s = i64::from(plan.factor[k + m - 1][1]);
        let share = i128::from((s * s) >> FACTOR_BITS);
        for ch in 0..C {
            let difference = i128::from(value[r][ch] - value[l][ch]);
            predicted[m][ch] =
                ((((difference * gain) >> GAIN_BITS) * i128::from(strength[ch])) >> 4) as i64;
            value[l][ch] += ((difference * share) >> FACTOR_BITS) as i64;
        }
    }
}

#[inline]
fn mean_of(low: i64, inverse_root: u32) -> i64 {
    let m = (i128::from(low) * i128::from(inverse_root)) >> FACTOR_BITS;
    (m as i64).clamp(-MEAN_MAX, MEAN_MAX)
}
