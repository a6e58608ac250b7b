//! Which reconstructed means predict each child of each block, found once per plan.

use crate::hood::{Children, Hood, ONES, child_hood, rank};
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
    /// Index of the parent in `above`, and which child of it.
    parent: Vec<(u32, u8)>,
    above: Above,
}

/// What the children of a level's nodes need to find their neighbours.
#[derive(Default)]
struct Above {
    children: Vec<Children>,
    /// Neighbourhoods of the nodes with two leaves or more, in order.
    hood: Vec<Hood>,
    /// Index into `hood` of each such node.
    hood_of: Vec<u32>,
}

impl Above {
    fn child_hood(&self, (parent, c): (u32, u8)) -> Hood {
        let hood = &self.hood[self.hood_of[parent as usize] as usize];
        child_hood(hood, usize::from(c), &self.children)
    }
}

impl Pyramid {
    pub(super) fn new(plan: &Plan) -> Self {
        let (leaves, j_high): (&[Leaf], u8) = (&plan.leaves, plan.j_high);
        let n = leaves.len();
        let mut this = Self { levels: vec![0], ..Self::default() };
        let mut level = Level::default();
        if n > 0 {
            level.first.push(0);
            level.end.push(n as u32);
            level.node.push(0);
            this.push_node(inverse_root(plan.weight_of(0, n as u32)), 0);
        }
        for depth in 0..j_high {
            level = this.split(plan, leaves, depth, &level);
            this.levels.push(this.node.len() as u32);
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
    /// A node with one leaf that touches no node with more is not followed further: none of its
    /// cells can touch a block below.
    fn split(&mut self, plan: &Plan, leaves: &[Leaf], depth: u8, level: &Level) -> Level {
        let shift = 3 * (plan.j_high - depth - 1);
        let child_of = |i: u32| ((leaves[i as usize].morton >> shift) & 7) as u8;
        let nodes = level.first.len();
        let many = |at: usize| level.end[at] - level.first[at] > 1;
        let mut above = Above {
            children: vec![Children::default(); nodes],
            hood: Vec::new(),
            hood_of: vec![0; nodes],
        };
        let mut touched = vec![false; nodes];
        for at in (0..nodes).filter(|&at| many(at)) {
            let hood = match level.parent.get(at) {
                Some(&parent) => level.above.child_hood(parent),
                None => Hood::ROOT,
            };
            let mut rest = hood.present;
            while rest != 0 {
                touched[hood.index[rest.trailing_zeros() as usize] as usize] = true;
                rest &= rest - 1;
            }
            above.hood_of[at] = above.hood.len() as u32;
            above.hood.push(hood);
        }
        let mut next = Level::default();
        for at in 0..nodes {
            let (lo, hi) = (level.first[at], level.end[at]);
            above.children[at].first = next.first.len() as u32;
            if !many(at) {
                if !touched[at] || leaves[lo as usize].depth <= depth {
                    continue;
                }
                let c = child_of(lo);
                above.children[at].mask = 1 << c;
                next.first.push(lo);
                next.end.push(hi);
                next.node.push(level.node[at]);
                next.parent.push((at as u32, c));
                continue;
            }
            let mut start = lo;
            while start < hi {
                let c = child_of(start);
                let run = &leaves[start as usize..hi as usize];
                let same = |l: &Leaf| ((l.morton >> shift) & 7) as u8 == c;
                let len = if run.len() > 32 {
                    run.partition_point(same)
                } else {
                    run.iter().take_while(|l| same(l)).count()
                };
                above.children[at].mask |= 1 << c;
                next.first.push(start);
                start += len as u32;
                next.end.push(start);
                next.parent.push((at as u32, c));
            }
            if above.children[at].mask.is_power_of_two() {
                next.node.push(level.node[at]);
            } else {
                self.block(plan, level, &mut next, &above, at);
            }
        }
        next.above = above;
        next
    }

    /// Adds the block that splits node `at` and numbers its children.
    fn block(&mut self, plan: &Plan, level: &Level, next: &mut Level, above: &Above, at: usize) {
        let hood = &above.hood[above.hood_of[at] as usize];
        let mask = above.children[at].mask;
        self.node.push(level.node[at]);
        self.mask.push(mask);
        let base = above.children[at].first as usize;
        for i in base..base + usize::from(ONES[usize::from(mask)]) {
            let c = next.parent[i].1;
            let mut total = SELF;
            if !hood.alone() {
                for &(place, axes) in &TOUCHING[usize::from(c)] {
                    if hood.present >> place & 1 == 0 {
                        continue;
                    }
                    let other = hood.index[usize::from(place)] as usize;
                    let kind = usize::from(ONES[usize::from(axes)]);
                    let touching = u32::from(c ^ axes);
                    let (node, weight) =
                        if other < at && above.children[other].mask >> touching & 1 == 1 {
                            let j = above.children[other].first
                                + rank(above.children[other].mask, touching);
                            (next.node[j as usize], CHILD[kind])
                        } else {
                            (level.node[other], NODE[kind])
                        };
                    self.terms.push(Term { node, weight });
                    total += weight;
                }
            }
            next.node.push(self.inverse_root.len() as u32);
            let (a, b) = (next.first[i], next.end[i]);
            self.push_node(inverse_root(plan.weight_of(a, b)), total);
        }
    }
}
