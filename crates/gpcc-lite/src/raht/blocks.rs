//! The merges of one node with two children or more, and the prediction of its children.
//!
//! Predictions are in single precision, each operation rounded to nearest as IEEE 754 has it and
//! in the order written, so they are the same on every machine.

use super::pyramid::{LEAF_BITS, SELF, WEIGHT};
use super::rows::Lanes;
use crate::context::CHUNK;

/// A block has eight children at most.
pub(super) const MERGES_AT_MOST: usize = 7;

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
    /// Its merges, top down.
    pub(super) merges: &'a [(u8, u8)],
    /// Number of terms of each child.
    pub(super) counts: &'a [u8],
    /// The terms of its children.
    pub(super) terms: &'a [u32],
}

impl Block<'_> {
    /// Differences that the means around predict for every merge, times `strength`: those of merge
    /// `m` at `m * width`. `shares` are those of its merges, `own` is its first leaf.
    #[inline]
    pub(super) fn predict(
        &self,
        shares: &[f32],
        own: usize,
        rows: &[Lanes],
        strength: &[Lanes],
        predicted: &mut [Lanes],
    ) {
        let width = strength.len();
        for (chunk, strength) in strength.iter().enumerate() {
            let own = &rows[own * width + chunk];
            let mut value = [[0.0; CHUNK]; 8];
            let mut terms = self.terms;
            for (v, &n) in value.iter_mut().zip(self.counts) {
                let (here, rest) = terms.split_at(usize::from(n));
                terms = rest;
                *v = mean_of_terms(here, own, rows, width, chunk);
            }
            for (m, &(l, r)) in self.merges.iter().enumerate().rev() {
                let (l, r) = (usize::from(l & 7), usize::from(r & 7));
                let share = shares[m];
                let out = &mut predicted[m * width + chunk];
                for i in 0..CHUNK {
                    let difference = value[r][i] - value[l][i];
                    out[i] = difference * strength[i];
                    value[l][i] += difference * share;
                }
            }
        }
    }
}

/// The weighted mean of the terms of a node.
#[inline]
fn mean_of_terms(terms: &[u32], own: &Lanes, rows: &[Lanes], width: usize, chunk: usize) -> Lanes {
    if terms.is_empty() {
        return *own;
    }
    let mut acc = own.map(|v| v * f32::from(SELF));
    let mut total = usize::from(SELF);
    for &t in terms {
        let leaf = (t & ((1 << LEAF_BITS) - 1)) as usize;
        let other = &rows[leaf * width + chunk];
        let kind = (t >> LEAF_BITS) as usize;
        total += usize::from(WEIGHT[kind]);
        let weight = WEIGHTS[kind];
        for i in 0..CHUNK {
            acc[i] += other[i] * weight;
        }
    }
    let reciprocal = RECIPROCAL[total & 63];
    acc.map(|v| v * reciprocal)
}
