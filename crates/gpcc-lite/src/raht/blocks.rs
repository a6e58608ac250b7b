//! The blocks of a plan one after another, and the prediction of one.
//!
//! Predictions are in single precision, each operation rounded to nearest as IEEE 754 has it and
//! in the order written, so they are the same on every machine. The rest of the transform is in
//! integers.

use super::pyramid::{NODE_BITS, Pyramid, SELF, WEIGHT};
use super::{FACTOR_BITS, Plan};

/// Up to four channels of a node's mean, or of a predicted high-pass value.
pub(crate) type Lanes = [f32; 4];

/// The merges of a node by child mask, top down: ranks of the first child on either side.
pub(super) const MERGES: [([(u8, u8); 7], u8); 256] = {
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

/// Weights of the terms, and reciprocals of their sums.
const WEIGHTS: [f32; 4] = [WEIGHT[0] as f32, WEIGHT[1] as f32, WEIGHT[2] as f32, WEIGHT[3] as f32];
const RECIPROCAL: [f32; 64] = {
    let mut t = [0.0; 64];
    let mut n = 1;
    while n < 64 {
        t[n] = 1.0 / n as f32;
        n += 1;
    }
    t
};

/// One block: a node with two children or more.
#[derive(Clone, Copy)]
pub(super) struct Block<'a> {
    /// Its first coefficient.
    pub(super) k: usize,
    /// Number of its first child.
    pub(super) base: usize,
    /// Its own number.
    pub(super) node: usize,
    /// Its merges, top down.
    pub(super) merges: &'a [(u8, u8)],
    /// Number of terms of each child.
    counts: &'a [u8],
    /// The terms of its children.
    terms: &'a [u32],
}

/// Where a walk over the blocks has got to.
#[derive(Clone, Copy)]
pub(super) struct Walk<'a> {
    pyramid: &'a Pyramid,
    k: usize,
    base: usize,
    terms: &'a [u32],
}

impl<'a> Walk<'a> {
    pub(super) fn new(pyramid: &'a Pyramid) -> Self {
        Self { pyramid, k: 1, base: 1, terms: &pyramid.terms }
    }

    /// The next block, which is number `at`.
    #[inline]
    pub(super) fn next(&mut self, at: usize) -> Block<'a> {
        let p = self.pyramid;
        let (merges, count) = &MERGES[usize::from(p.mask[at])];
        let count = usize::from(*count);
        let counts = &p.count[self.base..=self.base + count];
        let all: usize = counts.iter().map(|&n| usize::from(n)).sum();
        let (terms, rest) = self.terms.split_at(all);
        let block = Block {
            k: self.k,
            base: self.base,
            node: p.node[at] as usize,
            merges: &merges[..count],
            counts,
            terms,
        };
        self.terms = rest;
        self.k += count;
        self.base += count + 1;
        block
    }

    /// Passes over some blocks.
    pub(super) fn skip(&mut self, blocks: std::ops::Range<usize>) {
        let p = self.pyramid;
        let merges: usize =
            p.mask[blocks.clone()].iter().map(|&m| usize::from(MERGES[usize::from(m)].1)).sum();
        let end = self.base + merges + blocks.len();
        let terms: usize = p.count[self.base..end].iter().map(|&n| usize::from(n)).sum();
        self.terms = &self.terms[terms..];
        self.k += merges;
        self.base = end;
    }
}

impl Block<'_> {
    /// True if its children have terms.
    #[inline]
    pub(super) fn predicts(&self) -> bool {
        !self.terms.is_empty()
    }

    /// High-pass values that the means around predict, times `strength`.
    #[inline]
    pub(super) fn predict(&self, plan: &Plan, mean: &[Lanes], strength: &Lanes) -> [Lanes; 7] {
        let own = mean[self.node];
        let mut value = [[0.0; 4]; 8];
        let mut terms = self.terms;
        for (v, &n) in value.iter_mut().zip(self.counts) {
            let (here, rest) = terms.split_at(usize::from(n));
            terms = rest;
            *v = mean_of_terms(here, &own, mean);
        }
        let mut predicted = [[0.0; 4]; 7];
        let gains = &plan.gain[self.k - 1..][..self.merges.len()];
        let factors = &plan.factor[self.k - 1..][..self.merges.len()];
        for (m, &(l, r)) in self.merges.iter().enumerate().rev() {
            let (l, r) = (usize::from(l & 7), usize::from(r & 7));
            let s = factors[m][1] as f32 * (1.0 / (1u32 << FACTOR_BITS) as f32);
            let (gain, share) = (gains[m], s * s);
            for i in 0..4 {
                let difference = value[r][i] - value[l][i];
                predicted[m][i] = (difference * gain) * strength[i];
                value[l][i] += difference * share;
            }
        }
        predicted
    }
}

/// The weighted mean of the terms of a node.
#[inline]
fn mean_of_terms(terms: &[u32], own: &Lanes, mean: &[Lanes]) -> Lanes {
    if terms.is_empty() {
        return *own;
    }
    let mut acc = own.map(|v| v * f32::from(SELF));
    let mut total = usize::from(SELF);
    for &t in terms {
        let other = &mean[(t & ((1 << NODE_BITS) - 1)) as usize];
        let kind = (t >> NODE_BITS) as usize;
        total += usize::from(WEIGHT[kind]);
        let weight = WEIGHTS[kind];
        for i in 0..4 {
            acc[i] += other[i] * weight;
        }
    }
    let reciprocal = RECIPROCAL[total & 63];
    acc.map(|v| v * reciprocal)
}

/// The mean of a node with this low-pass value.
#[inline]
pub(super) fn mean_of<const C: usize>(low: &[i64; C], inverse_root: f32) -> Lanes {
    let mut mean = [0.0; 4];
    for (m, &v) in mean.iter_mut().zip(low) {
        *m = v as f32 * inverse_root;
    }
    mean
}
