//! The encoder's knowledge: the leaves under each node, found without a search.
//!
//! Between consecutive leaves lies a boundary; the octree level at which they part is that of the
//! highest bit in which their codes differ. The boundaries of a level, in order, split exactly its
//! nodes with two leaves or more, so the tree is walked by merging lists.

use crate::leaf::Leaf;

pub(super) struct Truth<'a> {
    leaves: &'a [Leaf],
    j_high: u8,
    /// Boundaries by level; a boundary is the index of the leaf after it.
    boundaries: Vec<u32>,
    /// Where each level's begin, then their number.
    levels: Vec<usize>,
    depth: u8,
    /// Boundaries of the level not passed yet: from here to the level's end.
    ahead: usize,
    /// Leaves under each node of the list.
    nodes: Vec<[u32; 2]>,
    below: Vec<[u32; 2]>,
    at: usize,
    /// Leaves under the current node.
    range: [u32; 2],
}

impl<'a> Truth<'a> {
    pub(super) fn new(leaves: &'a [Leaf], j_high: u8) -> Self {
        let depth_of = |pair: &[Leaf]| {
            let bit = 63 - (pair[0].morton ^ pair[1].morton).leading_zeros();
            usize::from(j_high) - 1 - bit as usize / 3
        };
        let mut levels = vec![0usize; usize::from(j_high) + 1];
        for pair in leaves.windows(2) {
            levels[depth_of(pair) + 1] += 1;
        }
        for d in 1..levels.len() {
            levels[d] += levels[d - 1];
        }
        let mut slot = levels.clone();
        let mut boundaries = vec![0u32; leaves.len().saturating_sub(1)];
        for (i, pair) in leaves.windows(2).enumerate() {
            let s = &mut slot[depth_of(pair)];
            boundaries[*s] = i as u32 + 1;
            *s += 1;
        }
        Self {
            leaves,
            j_high,
            boundaries,
            levels,
            depth: 0,
            ahead: 0,
            nodes: vec![[0, leaves.len() as u32]],
            below: Vec::new(),
            at: 0,
            range: [0; 2],
        }
    }

    pub(super) fn start_level(&mut self, depth: u8) {
        self.depth = depth;
        self.ahead = self.levels[usize::from(depth)];
        self.at = 0;
    }

    /// Goes to the next node of the list: whether it has only one leaf.
    #[inline]
    pub(super) fn next(&mut self) -> bool {
        self.range = self.nodes[self.at];
        self.at += 1;
        self.range[1] - self.range[0] == 1
    }

    /// The first leaf of the node.
    #[inline]
    pub(super) fn leaf(&self) -> Leaf {
        self.leaves[self.range[0] as usize]
    }

    /// Its children.
    #[inline]
    pub(super) fn split(&mut self) -> u8 {
        let shift = 3 * (self.j_high - self.depth - 1);
        let [mut lo, hi] = self.range;
        let end = self.levels[usize::from(self.depth) + 1];
        let mut mask = 0;
        loop {
            mask |= 1 << (self.leaves[lo as usize].morton >> shift & 7);
            let next = match self.boundaries[self.ahead..end].first() {
                Some(&b) if b < hi => b,
                _ => hi,
            };
            self.below.push([lo, next]);
            if next == hi {
                return mask;
            }
            self.ahead += 1;
            lo = next;
        }
    }

    pub(super) fn end_level(&mut self) {
        std::mem::swap(&mut self.nodes, &mut self.below);
        self.below.clear();
    }
}
