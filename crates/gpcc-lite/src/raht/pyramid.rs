//! Which reconstructed means predict each child of each block, found once per plan.

use super::blocks::MERGES;
use crate::hood::{Block, CENTRE, Children, Hoods, ONES, rank};
use crate::raht::{Plan, inverse_root};

/// Weight of the node itself in the prediction of its children.
pub(super) const SELF: u8 = 9;
/// Weight of a neighbour of the node, by axes it is off along (none, face, edge, corner).
const NODE: [u8; 4] = [0, 3, 1, 0];
/// The same for a neighbour's child that touches and is already reconstructed.
const CHILD: [u8; 4] = [0, 5, 2, 0];

/// Bits of a term that hold the node; the two above tell the weight.
pub(super) const NODE_BITS: u32 = 30;
/// Weight of a term by its top bits: the child or the node itself, across a face or an edge.
pub(super) const WEIGHT: [u8; 4] = [CHILD[1], CHILD[2], NODE[1], NODE[2]];

/// Blocks (nodes with two children or more) in coefficient order.
///
/// Nodes are numbered as blocks create them: 0 is the root, then the children of each block. A
/// node with one child has that child's number, for it has the same points and the same mean.
#[derive(Clone, Debug, Default)]
pub(super) struct Pyramid {
    /// Number of the node that each block splits.
    pub(super) node: Vec<u32>,
    /// Occupied children of each block.
    pub(super) mask: Vec<u8>,
    /// First block of each depth, then their number.
    pub(super) levels: Vec<u32>,
    /// `1 / sqrt(weight)` per node.
    pub(super) inverse_root: Vec<f32>,
    /// Per node: number of terms that predict it besides its block's own mean.
    pub(super) count: Vec<u8>,
    /// The terms, node after node: number of the node, and above [`NODE_BITS`] the weight.
    pub(super) terms: Vec<u32>,
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
#[derive(Default)]
struct Level {
    /// First leaf of each and the one after its last.
    range: Vec<[u32; 2]>,
    /// Number of each.
    node: Vec<u32>,
    /// Their children, once known.
    children: Vec<Children>,
    /// Neighbourhoods of those with two leaves or more.
    hoods: Hoods,
}

impl Level {
    fn push(&mut self, range: [u32; 2], node: u32) {
        self.range.push(range);
        self.node.push(node);
    }

    /// Finds the neighbourhoods of the nodes with two leaves or more from those above; returns
    /// which nodes are in one.
    fn find_hoods(&mut self, above: &Level) -> Vec<bool> {
        let mut touched = vec![false; self.range.len()];
        let mut block = Block::new();
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

impl Pyramid {
    pub(super) fn new(plan: &Plan) -> Self {
        let n = plan.points;
        let mut this = Self { levels: vec![0], ..Self::default() };
        this.inverse_root.reserve(n + n / 2);
        this.count.reserve(n + n / 2);
        this.terms.reserve(3 * n);
        // Most nodes have few leaves.
        let roots: Vec<f32> = (0..256).map(inverse_root).collect();
        let mut level = Level::default();
        let mut above = Level {
            children: vec![Children { first: 0, mask: 1 }],
            hoods: Hoods::above_root(),
            ..Level::default()
        };
        if n > 0 {
            level.push([0, n as u32], 0);
            this.push_node(inverse_root(plan.weight_of(0, n as u32)), 0);
        } else {
            above.hoods.present.clear();
        }
        for depth in 0..plan.j_high {
            let touched = level.find_hoods(&above);
            let below = this.split(plan, depth, &mut level, &touched, &roots);
            above = level;
            level = below;
            this.levels.push(this.node.len() as u32);
        }
        this
    }

    fn push_node(&mut self, inverse_root: f32, count: u8) {
        self.inverse_root.push(inverse_root);
        self.count.push(count);
    }

    /// Adds the blocks of one depth; returns the nodes of the next.
    ///
    /// A node with one leaf that touches no node with more is not followed further: none of its
    /// cells can touch a block below.
    fn split(
        &mut self,
        plan: &Plan,
        depth: u8,
        level: &mut Level,
        touched: &[bool],
        roots: &[f32],
    ) -> Level {
        let leaves = plan.leaves.as_slice();
        let shift = 3 * (plan.j_high - depth - 1);
        let child_of = |i: u32| (leaves[i as usize].morton >> shift) as u8 & 7;
        let coefficients = plan.levels[usize::from(depth)] as usize - 1
            ..plan.levels[usize::from(depth) + 1] as usize - 1;
        let mut next = Level::default();
        next.range.reserve(level.range.len() + coefficients.len());
        next.node.reserve(level.range.len() + coefficients.len());
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
                    next.push([lo, hi], level.node[at]);
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
                next.push([lo, hi], level.node[at]);
                continue;
            }
            self.node.push(level.node[at]);
            self.mask.push(mask);
            let base = self.inverse_root.len() as u32;
            for i in 0..=count {
                let end = if i == count { hi } else { starts[i + 1] };
                next.push([starts[i], end], base + i as u32);
                let w = plan.weight_of(starts[i], end);
                let root = roots.get(w as usize).copied().unwrap_or_else(|| inverse_root(w));
                self.push_node(root, 0);
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
        let mut child = self.count.len() - usize::from(ONES[usize::from(mask)]);
        while mask != 0 {
            let c = mask.trailing_zeros() as usize & 7;
            mask &= mask - 1;
            let before = self.terms.len();
            let mut touching = window & TOUCHING[c];
            while touching != 0 {
                let place = touching.trailing_zeros() as usize & 63;
                touching &= touching - 1;
                let axes = AXES[place];
                let other = place_of[place] as usize;
                let edge = u32::from(!axes.is_power_of_two());
                let twin = (c as u8 ^ axes) & 7;
                let of = level.children[other];
                let term = if other < at && of.mask >> twin & 1 == 1 {
                    let j = of.first + rank(of.mask, u32::from(twin));
                    next.node[j as usize] | edge << NODE_BITS
                } else {
                    level.node[other] | (2 + edge) << NODE_BITS
                };
                self.terms.push(term);
            }
            self.count[child] = (self.terms.len() - before) as u8;
            child += 1;
        }
    }
}
