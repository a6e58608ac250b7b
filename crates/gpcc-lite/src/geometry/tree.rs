//! The traversal of the tree, level by level, written once for both directions.

use super::models::GeometryModels;
use super::node::NodeContext;
use super::source::LeafSource;
use crate::coder::Coder;
use crate::error::{Error, Result};
use crate::hood::{CellBlock, Children, Hoods, ONES};
use crate::leaf::Leaf;

/// The nodes of one level, as the level below needs them. Nodes without children (those with a
/// single leaf) have an entry in `children` only.
#[derive(Default)]
struct Nodes {
    /// Morton codes of the nodes that have children, in order.
    codes: Vec<u64>,
    /// Neighbourhoods of the nodes that have children.
    hoods: Hoods,
    /// Children of all nodes of the level.
    children: Vec<Children>,
}

/// The tree as far as it is coded, and the leaves found so far.
pub(super) struct CodedTree<'a> {
    /// What the encoder codes; a decoder has none.
    source: Option<LeafSource<'a>>,
    tree_depth: u8,
    /// The level above the one that is coded next.
    above: Nodes,
    /// The leaves that are the single leaf of a node.
    leaves: Vec<Leaf>,
    /// Greatest number of leaves.
    limit: usize,
}

impl<'a> CodedTree<'a> {
    /// The root alone. The encoder gives the leaves.
    pub(super) fn new(leaves: Option<&'a [Leaf]>, tree_depth: u8, limit: usize) -> Self {
        let above = Nodes {
            codes: vec![0],
            hoods: Hoods::above_root(),
            children: vec![Children { first: 0, mask: 1 }],
        };
        let source = leaves.map(|l| LeafSource::new(l, tree_depth));
        Self { source, tree_depth, above, leaves: Vec::new(), limit }
    }

    /// Codes the nodes at `depth`: their single leaves, or their children.
    #[inline(always)]
    pub(super) fn level<C: Coder>(
        &mut self,
        depth: u8,
        models: &mut GeometryModels,
        coder: &mut C,
    ) -> Result<()> {
        let least = if depth + 1 == self.tree_depth { 2 } else { 1 };
        let count_of = |c: &Children| usize::from(ONES[usize::from(c.mask)]);
        let nodes = self.above.children.iter().map(count_of).sum();
        let mut level = Nodes { children: vec![Children::default(); nodes], ..Nodes::default() };
        if let Some(source) = known::<C>(&mut self.source) {
            source.start_level(depth);
        }
        let mut block = CellBlock::new();
        let mut near = self.above.hoods.near.as_slice();
        let (mut index, mut children) = (0usize, 0usize);
        for (&parent, &present) in self.above.codes.iter().zip(&self.above.hoods.present) {
            near = &near[block.enter(present, near, &self.above.children)..];
            let mut rest = block.own().mask;
            let siblings = ONES[usize::from(rest)];
            while rest != 0 {
                let c = rest.trailing_zeros();
                rest &= rest - 1;
                let code = parent << 3 | u64::from(c);
                let window = block.window(c);
                let node = NodeContext { depth, code, siblings, window, least };
                let single = known::<C>(&mut self.source).is_some_and(LeafSource::next_is_single);
                if !node.splits() && models.single(coder, &node, single) {
                    let wanted = known::<C>(&mut self.source).map(|s| s.first_leaf());
                    let leaf = models.leaf(coder, &node, wanted);
                    self.leaves.push(leaf);
                    index += 1;
                    continue;
                }
                enter_neighbours(&mut level, &block, c, window);
                let wanted = known::<C>(&mut self.source).map_or(0, LeafSource::occupied_children);
                let mask = models.occupancy(coder, &node, wanted);
                level.codes.push(code);
                level.children[index] = Children { first: children as u32, mask };
                index += 1;
                children += usize::from(ONES[usize::from(mask)]);
                if children + self.leaves.len() > self.limit || coder.exhausted() {
                    return Err(Error::Corrupt { what: "more cells than points", offset: 0 });
                }
            }
        }
        self.above = level;
        if let Some(source) = known::<C>(&mut self.source) {
            source.end_level();
        }
        Ok(())
    }

    /// The leaves in Morton order, when all levels are coded.
    pub(super) fn finish(self) -> Vec<Leaf> {
        let mut leaves = self.leaves;
        let parents = self.above.children.iter().filter(|c| c.mask != 0);
        for (c, code) in parents.zip(&self.above.codes) {
            let mut rest = c.mask;
            while rest != 0 {
                let morton = code << 3 | u64::from(rest.trailing_zeros());
                leaves.push(Leaf { morton, depth: self.tree_depth });
                rest &= rest - 1;
            }
        }
        leaves.sort_unstable_by_key(|l| l.morton);
        leaves
    }
}

/// Records the neighbourhood of child `c` of the block's node.
#[inline(always)]
fn enter_neighbours(level: &mut Nodes, block: &CellBlock, c: u32, window: u64) {
    let mut rest = window;
    while rest != 0 {
        level.hoods.near.push(block.index(c, rest.trailing_zeros()));
        rest &= rest - 1;
    }
    level.hoods.present.push(window);
}

/// The encoder's source. It is a constant `None` in a decoder, so that the compiler drops what
/// follows.
#[inline]
fn known<'s, 'a, C: Coder>(
    source: &'s mut Option<LeafSource<'a>>,
) -> Option<&'s mut LeafSource<'a>> {
    if C::ENCODING { source.as_mut() } else { None }
}
