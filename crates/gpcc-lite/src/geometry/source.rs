//! The encoder's input: the leaves below each node of the tree, found without a search.
//!
//! Between consecutive leaves lies a boundary. It belongs to the octree level at which the two
//! leaves part, which follows from the highest bit in which their codes differ. The boundaries of a
//! level, in order, split exactly those nodes of the level that have two leaves or more below them.
//! So one pass over nodes and boundaries finds all children of a level.

use crate::leaf::Leaf;

/// Walks the tree of the leaves, level by level and node by node, as the coder does.
pub(super) struct LeafSource<'a> {
    leaves: &'a [Leaf],
    tree_depth: u8,
    /// Boundaries by level, in order; boundary `j` lies before leaf `j`.
    boundaries: Vec<u32>,
    /// First boundary of each level, then the number of boundaries.
    levels: Vec<usize>,
    depth: u8,
    /// The first boundary of the level that is not passed yet.
    next_boundary: usize,
    /// First leaf, and leaf after the last, of every node of the level.
    nodes: Vec<[u32; 2]>,
    /// The same of the children found so far.
    children: Vec<[u32; 2]>,
    /// Index of the next node.
    next_node: usize,
    /// First leaf, and leaf after the last, of the current node.
    range: [u32; 2],
}

impl<'a> LeafSource<'a> {
    /// Starts above the root. The leaves must be valid.
    pub(super) fn new(leaves: &'a [Leaf], tree_depth: u8) -> Self {
        let depth_of = |pair: &[Leaf]| {
            let bit = 63 - (pair[0].morton ^ pair[1].morton).leading_zeros();
            usize::from(tree_depth) - 1 - bit as usize / 3
        };
        let mut levels = vec![0usize; usize::from(tree_depth) + 1];
        for pair in leaves.windows(2) {
            levels[depth_of(pair) + 1] += 1;
        }
        for d in 1..levels.len() {
            levels[d] += levels[d - 1];
        }
        let mut slots = levels.clone();
        let mut boundaries = vec![0u32; leaves.len().saturating_sub(1)];
        for (i, pair) in leaves.windows(2).enumerate() {
            let slot = &mut slots[depth_of(pair)];
            boundaries[*slot] = i as u32 + 1;
            *slot += 1;
        }
        Self {
            leaves,
            tree_depth,
            boundaries,
            levels,
            depth: 0,
            next_boundary: 0,
            nodes: vec![[0, leaves.len() as u32]],
            children: Vec::new(),
            next_node: 0,
            range: [0; 2],
        }
    }

    /// Goes to the nodes of this depth.
    pub(super) fn start_level(&mut self, depth: u8) {
        self.depth = depth;
        self.next_boundary = self.levels[usize::from(depth)];
        self.next_node = 0;
    }

    /// Goes to the next node of the level. Returns whether a single leaf lies below it.
    #[inline]
    pub(super) fn next_is_single(&mut self) -> bool {
        self.range = self.nodes[self.next_node];
        self.next_node += 1;
        self.range[1] - self.range[0] == 1
    }

    /// The first leaf below the current node.
    #[inline]
    pub(super) fn first_leaf(&self) -> Leaf {
        self.leaves[self.range[0] as usize]
    }

    /// The occupied children of the current node, which join the nodes of the next level.
    #[inline]
    pub(super) fn occupied_children(&mut self) -> u8 {
        let shift = 3 * (self.tree_depth - self.depth - 1);
        let [mut first, end] = self.range;
        let level_end = self.levels[usize::from(self.depth) + 1];
        let mut mask = 0;
        loop {
            mask |= 1 << (self.leaves[first as usize].morton >> shift & 7);
            let next = match self.boundaries[self.next_boundary..level_end].first() {
                Some(&b) if b < end => b,
                _ => end,
            };
            self.children.push([first, next]);
            if next == end {
                return mask;
            }
            self.next_boundary += 1;
            first = next;
        }
    }

    /// Ends the level: its children become the nodes.
    pub(super) fn end_level(&mut self) {
        std::mem::swap(&mut self.nodes, &mut self.children);
        self.children.clear();
    }
}
