//! Which reconstructed means predict each child of each block, found once per plan.

use crate::hood::{CENTRE, Hood, NONE, child_hood};
use crate::leaf::Leaf;
use crate::raht::{Plan, inverse_root};

/// Weight of the node itself in the prediction of its children.
pub(super) const SELF: u8 = 9;
/// Weight of a neighbour of the node, by axes it is off along (none, face, edge, corner).
const NODE: [u8; 4] = [0, 3, 1, 0];
/// The same for a neighbour's child that touches and is already reconstructed.
const CHILD: [u8; 4] = [0, 5, 2, 0];

/// One mean with its weight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Term {
    pub(super) node: u32,
    pub(super) weight: u8,
}

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
    pub(super) inverse_root: Vec<u32>,
    /// Per node: end of the terms that predict it.
    pub(super) terms_end: Vec<u32>,
    /// Per node: sum of their weights, [`SELF`] included.
    pub(super) total: Vec<u8>,
    /// Terms besides the block's own mean.
    pub(super) terms: Vec<Term>,
    /// Node of each leaf.
    pub(super) leaf_node: Vec<u32>,
}

/// The places around child `c` that touch it: place, axes it is off along, as child bits.
const TOUCHING: [[(u8, u8); 6]; 8] = {
    let mut t = [[(0u8, 0u8); 6]; 8];
    let mut c = 0;
    while c < 8 {
        let axes = [4usize, 2, 1, 6, 5, 3];
        let mut i = 0;
        while i < 6 {
            let mut place = 0;
            let mut k = 0;
            while k < 3 {
                let bit = 4 >> k;
                let d = if axes[i] & bit == 0 {
                    1
                } else if c & bit != 0 {
                    2
                } else {
                    0
                };
                place = 3 * place + d;
                k += 1;
            }
            t[c][i] = (place as u8, axes[i] as u8);
            i += 1;
        }
        c += 1;
    }
    t
};

/// The nodes of one depth that still matter, in Morton order.
#[derive(Default)]
struct Level {
    first: Vec<u32>,
    end: Vec<u32>,
    node: Vec<u32>,
    hood: Vec<Hood>,
}

impl Pyramid {
    pub(super) fn new(plan: &Plan) -> Self {
        let (leaves, j_high): (&[Leaf], u8) = (&plan.leaves, plan.j_high);
        let n = leaves.len();
        let mut this = Self { levels: vec![0], leaf_node: vec![0; n], ..Self::default() };
        let mut level = Level::default();
        if n > 0 {
            let mut root = [NONE; 27];
            root[CENTRE] = 0;
            level.first.push(0);
            level.end.push(n as u32);
            level.node.push(0);
            level.hood.push(root);
            this.push_node(inverse_root(plan.weight_of(0, n as u32)), 0);
        }
        for depth in 0..j_high {
            level = this.split(plan, leaves, depth, &level);
            this.levels.push(this.node.len() as u32);
        }
        for (&first, &node) in level.first.iter().zip(&level.node) {
            this.leaf_node[first as usize] = node;
        }
        this
    }

    fn push_node(&mut self, inverse_root: u32, total: u8) {
        self.inverse_root.push(inverse_root);
        self.terms_end.push(self.terms.len() as u32);
        self.total.push(total);
    }

    /// Adds the blocks of one depth; returns the nodes of the next.
    ///
    /// A node that holds one leaf and touches nobody is not followed further: nothing below it
    /// is predicted, and nobody is predicted from it.
    fn split(&mut self, plan: &Plan, leaves: &[Leaf], depth: u8, level: &Level) -> Level {
        let shift = 3 * (plan.j_high - depth - 1);
        let nodes = level.first.len();
        let mut mask = vec![0u8; nodes];
        let mut child = vec![0u32; nodes];
        let mut next = Level::default();
        for at in 0..nodes {
            let (lo, hi) = (level.first[at], level.end[at]);
            child[at] = next.first.len() as u32;
            if hi - lo == 1 {
                let alone = level.hood[at].iter().filter(|&&n| n != NONE).count() == 1;
                if alone || leaves[lo as usize].depth <= depth {
                    self.leaf_node[lo as usize] = level.node[at];
                } else {
                    mask[at] = 1 << ((leaves[lo as usize].morton >> shift) & 7);
                    next.first.push(lo);
                    next.end.push(hi);
                    next.node.push(level.node[at]);
                }
                continue;
            }
            let mut start = lo;
            while start < hi {
                let c = (leaves[start as usize].morton >> shift) & 7;
                let same = |l: &Leaf| (l.morton >> shift) & 7 == c;
                let run = &leaves[start as usize..hi as usize];
                let len = if run.len() > 32 {
                    run.partition_point(same)
                } else {
                    run.iter().take_while(|l| same(l)).count()
                };
                mask[at] |= 1 << c;
                next.first.push(start);
                start += len as u32;
                next.end.push(start);
            }
            if mask[at].count_ones() == 1 {
                next.node.push(level.node[at]);
                continue;
            }
            self.node.push(level.node[at]);
            self.mask.push(mask[at]);
            let base = child[at] as usize;
            let mut rank = 0;
            for c in 0..8 {
                if mask[at] >> c & 1 == 0 {
                    continue;
                }
                let mut total = SELF;
                for &(place, axes) in &TOUCHING[c] {
                    let other = level.hood[at][usize::from(place)];
                    if other == NONE {
                        continue;
                    }
                    let other = other as usize;
                    let kind = axes.count_ones() as usize;
                    let touching = c as u8 ^ axes;
                    let (node, weight) = if other < at && mask[other] >> touching & 1 == 1 {
                        let before = mask[other] & ((1u16 << touching) - 1) as u8;
                        let i = child[other] + before.count_ones();
                        (next.node[i as usize], CHILD[kind])
                    } else {
                        (level.node[other], NODE[kind])
                    };
                    self.terms.push(Term { node, weight });
                    total += weight;
                }
                next.node.push(self.inverse_root.len() as u32);
                let (a, b) = (next.first[base + rank], next.end[base + rank]);
                self.push_node(inverse_root(plan.weight_of(a, b)), total);
                rank += 1;
            }
        }
        next.hood.reserve(next.first.len());
        for at in 0..nodes {
            for c in 0..8 {
                if mask[at] >> c & 1 == 1 {
                    next.hood.push(child_hood(&level.hood[at], c, &mask, &child));
                }
            }
        }
        next
    }
}
