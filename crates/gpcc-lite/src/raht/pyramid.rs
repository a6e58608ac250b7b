//! Which reconstructed means predict each child of each block, found once per plan.

use std::hint::select_unpredictable;
use std::sync::{Mutex, OnceLock, PoisonError};

use super::blocks::{Block, MERGES};
use crate::hood::{self, CENTRE, Children, Hoods, rank};
use crate::morton::MAX_DEPTH;
use crate::raht::Plan;

/// Weight of the node itself in the prediction of its children.
pub(super) const SELF: u8 = 9;
/// Weight of a neighbour of the node, by axes it is off along (none, face, edge, corner).
const NODE: [u8; 4] = [0, 3, 1, 0];
/// The same for a neighbour's child that touches and is already reconstructed.
const CHILD: [u8; 4] = [0, 5, 2, 0];

/// Bits of a term that hold a leaf, the first of a node; the two above tell the weight.
pub(super) const LEAF_BITS: u32 = 30;
/// Weight of a term by its top bits: the child or the node itself, across a face or an edge.
pub(super) const WEIGHT: [u8; 4] = [CHILD[1], CHILD[2], NODE[1], NODE[2]];

/// The blocks (nodes with two children or more) of one octree level, in coefficient order.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Terms {
    /// Occupied children of each block.
    masks: Vec<u8>,
    /// Per child of each block: number of terms that predict it besides its block's own mean.
    counts: Vec<u8>,
    /// The terms, child after child: first leaf of a node, and above [`LEAF_BITS`] the weight.
    terms: Vec<u32>,
}

impl Terms {
    /// Number of blocks.
    pub(super) fn len(&self) -> usize {
        self.masks.len()
    }

    /// The blocks in order.
    pub(super) fn blocks(&self) -> impl Iterator<Item = Block<'_>> {
        let (mut counts, mut terms) = (&self.counts[..], &self.terms[..]);
        self.masks.iter().map(move |&mask| {
            let (merges, n) = &MERGES[usize::from(mask)];
            let n = usize::from(*n);
            let (own_counts, rest) = counts.split_at(n + 1);
            counts = rest;
            let (own_terms, rest) = terms.split_at(sum(own_counts));
            terms = rest;
            Block { merges: &merges[..n], counts: own_counts, terms: own_terms }
        })
    }

    /// The blocks from the last to the first.
    pub(super) fn blocks_backwards(&self) -> impl Iterator<Item = Block<'_>> {
        let (mut counts, mut terms) = (&self.counts[..], &self.terms[..]);
        self.masks.iter().rev().map(move |&mask| {
            let (merges, n) = &MERGES[usize::from(mask)];
            let n = usize::from(*n);
            let (rest, own_counts) = counts.split_at(counts.len() - n - 1);
            counts = rest;
            let (rest, own_terms) = terms.split_at(terms.len() - sum(own_counts));
            terms = rest;
            Block { merges: &merges[..n], counts: own_counts, terms: own_terms }
        })
    }
}

#[inline]
fn sum(counts: &[u8]) -> usize {
    counts.iter().map(|&n| usize::from(n)).sum()
}

/// The terms of the levels that were asked for, and of those above them.
#[derive(Debug, Default)]
pub(super) struct Pyramid {
    levels: [OnceLock<Terms>; MAX_DEPTH as usize],
    building: Mutex<()>,
}

/// Where building has got to.
#[derive(Debug)]
struct Builder {
    depth: u8,
    above: Level,
    level: Level,
}

impl Pyramid {
    /// The terms of the blocks that split nodes of `depth < plan.j_high`.
    pub(super) fn level(&self, plan: &Plan, depth: usize) -> &Terms {
        if let Some(found) = self.levels[depth].get() {
            return found;
        }
        // Nothing can be left half done: a level is stored whole or not at all. What building
        // needs beside the terms is as large as they are, and is not kept: whoever asks for a
        // level below those that are there has all of them built again.
        let building = self.building.lock().unwrap_or_else(PoisonError::into_inner);
        if self.levels[depth].get().is_none() {
            let mut state = Builder::new(plan);
            while usize::from(state.depth) <= depth {
                let at = usize::from(state.depth);
                let terms = state.next(plan);
                let _ = self.levels[at].set(terms);
            }
        }
        drop(building);
        self.levels[depth].get_or_init(Terms::default)
    }
}

/// The places that touch child `c` across a face or an edge, as bits of a window.
const TOUCHING: [u64; 8] = {
    let mut t = [0u64; 8];
    let mut c = 0;
    while c < 8 {
        let mut axes = 1;
        while axes < 7 {
            let mut place = 0;
            let mut k = 0;
            while k < 3 {
                let bit = 4 >> k;
                let d = if axes & bit == 0 {
                    1
                } else if c & bit != 0 {
                    2
                } else {
                    0
                };
                place = 4 * place + d;
                k += 1;
            }
            t[c] |= 1 << place;
            axes += 1;
        }
        c += 1;
    }
    t
};

/// A node, and all places that share a face or an edge with it. Those of its children lie in
/// these, so nothing else needs to be followed.
const NEAR: u64 = {
    let mut t = 1 << CENTRE;
    let mut c = 0;
    while c < 8 {
        t |= TOUCHING[c];
        c += 1;
    }
    t
};

/// The axes along which the place at each bit of a window is off, as child bits.
const AXES: [u8; 64] = {
    let mut t = [0u8; 64];
    let mut place = 0;
    while place < 64 {
        t[place] = ((place / 16 != 1) as u8) << 2
            | ((place / 4 % 4 != 1) as u8) << 1
            | (place % 4 != 1) as u8;
        place += 1;
    }
    t
};

/// The nodes of one depth that still matter, in Morton order.
#[derive(Debug, Default)]
struct Level {
    /// First leaf of each and the one after its last.
    range: Vec<[u32; 2]>,
    /// Their children, once known.
    children: Vec<Children>,
    /// Neighbourhoods of those with two leaves or more.
    hoods: Hoods,
}

impl Level {
    /// Finds the neighbourhoods of the nodes with two leaves or more from those above; returns
    /// which nodes are in one.
    fn find_hoods(&mut self, above: &Level) -> Vec<bool> {
        let mut touched = vec![false; self.range.len()];
        let mut block = hood::Block::new();
        let mut near = above.hoods.near.as_slice();
        for &present in &above.hoods.present {
            let used = block.enter(present, near, &above.children);
            near = &near[used..];
            let Children { first, mask } = block.own();
            let mut rest = mask;
            let mut at = first as usize;
            while rest != 0 {
                let c = rest.trailing_zeros();
                rest &= rest - 1;
                let [lo, hi] = self.range[at];
                at += 1;
                if hi - lo == 1 {
                    continue;
                }
                let window = block.window(c) & NEAR;
                self.hoods.present.push(window);
                let mut around = window;
                while around != 0 {
                    let i = block.index(c, around.trailing_zeros());
                    around &= around - 1;
                    self.hoods.near.push(i);
                    touched[i as usize] = true;
                }
            }
        }
        touched
    }
}

impl Builder {
    fn new(plan: &Plan) -> Self {
        let mut above = Level {
            children: vec![Children { first: 0, mask: 1 }],
            hoods: Hoods::above_root(),
            ..Level::default()
        };
        let mut level = Level::default();
        if plan.points > 0 {
            level.range.push([0, plan.points as u32]);
        } else {
            above.hoods.present.clear();
        }
        Self { depth: 0, above, level }
    }

    /// The terms of the next level.
    fn next(&mut self, plan: &Plan) -> Terms {
        let mut level = std::mem::take(&mut self.level);
        let touched = level.find_hoods(&self.above);
        let mut terms = Terms::default();
        self.level = terms.split(plan, self.depth, &mut level, &touched);
        self.above = level;
        self.depth += 1;
        terms
    }
}

impl Terms {
    /// Adds the blocks of one depth; returns the nodes of the next.
    ///
    /// A node with one leaf that touches no node with more is not followed further: none of its
    /// cells can touch a block below.
    fn split(&mut self, plan: &Plan, depth: u8, level: &mut Level, touched: &[bool]) -> Level {
        let leaves = plan.leaves.as_slice();
        let shift = 3 * (plan.j_high - depth - 1);
        let child_of = |i: u32| (leaves[i as usize].morton >> shift) as u8 & 7;
        let coefficients = plan.levels[usize::from(depth)] as usize - 1
            ..plan.levels[usize::from(depth) + 1] as usize - 1;
        let mut next = Level::default();
        next.range.reserve(level.range.len() + coefficients.len());
        let mut boundaries = &plan.right[coefficients];
        let mut present = level.hoods.present.iter();
        let mut near = level.hoods.near.as_slice();
        level.children = vec![Children::default(); level.range.len()];
        for at in 0..level.range.len() {
            let [lo, hi] = level.range[at];
            let first = next.range.len() as u32;
            if hi - lo == 1 {
                if touched[at] && leaves[lo as usize].depth > depth {
                    level.children[at] = Children { first, mask: 1 << child_of(lo) };
                    next.range.push([lo, hi]);
                }
                continue;
            }
            let Some(&window) = present.next() else { continue };
            let (own, rest) = near.split_at((window.count_ones() as usize).min(near.len()));
            near = rest;
            // The block's merges are stored top down; their boundaries in order split the node.
            let count = boundaries.iter().take(7).take_while(|&&b| b < hi).count();
            let mut starts = [lo; 8];
            let (own_boundaries, rest) = boundaries.split_at(count);
            boundaries = rest;
            let mask = own_boundaries.iter().fold(1 << child_of(lo), |m, &s| m | 1 << child_of(s));
            for (&(_, r), &b) in MERGES[usize::from(mask)].0.iter().zip(own_boundaries) {
                starts[usize::from(r) & 7] = b;
            }
            level.children[at] = Children { first, mask };
            if count == 0 {
                next.range.push([lo, hi]);
                continue;
            }
            self.masks.push(mask);
            for i in 0..=count {
                let end = if i == count { hi } else { starts[i + 1] };
                next.range.push([starts[i], end]);
                self.counts.push(0);
            }
            if window != 1 << CENTRE {
                self.add_terms(level, &next, at, window, own);
            }
        }
        next
    }

    /// Finds the terms of the children of the block just added, which splits node `at`.
    fn add_terms(&mut self, level: &Level, next: &Level, at: usize, window: u64, own: &[u32]) {
        let mut place_of = [0u32; 64];
        let mut around = window;
        for &i in own {
            place_of[around.trailing_zeros() as usize & 63] = i;
            around &= around - 1;
        }
        let mut mask = level.children[at].mask;
        let mut child = self.counts.len() - usize::from(hood::ONES[usize::from(mask)]);
        while mask != 0 {
            let c = mask.trailing_zeros() as usize & 7;
            mask &= mask - 1;
            // Three faces and three edges at most.
            let mut found = [0u32; 8];
            let mut count = 0;
            let mut touching = window & TOUCHING[c];
            while touching != 0 {
                let place = touching.trailing_zeros() as usize & 63;
                touching &= touching - 1;
                let axes = AXES[place];
                let other = place_of[place] as usize;
                let edge = u32::from(!axes.is_power_of_two());
                let twin = (c as u8 ^ axes) & 7;
                let of = level.children[other];
                // Either is about as likely, whatever came before.
                let known = (other < at) & (of.mask >> twin & 1 == 1);
                let j = (of.first + rank(of.mask, u32::from(twin))) as usize;
                let list = select_unpredictable(known, &next.range[..], &level.range[..]);
                let first = list[select_unpredictable(known, j, other)][0];
                let kind = select_unpredictable(known, edge, 2 + edge);
                found[count & 7] = first | kind << LEAF_BITS;
                count += 1;
            }
            // A copy of known length, and back.
            let end = self.terms.len() + count;
            self.terms.extend_from_slice(&found);
            self.terms.truncate(end);
            self.counts[child] = count as u8;
            child += 1;
        }
    }
}
