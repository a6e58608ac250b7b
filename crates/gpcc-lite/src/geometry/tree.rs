//! One traversal of the tree for both directions.

use super::density::{Classes, Densities, KERNEL, Kernel};
use super::models::{Models, NodeContext};
use super::truth::Truth;
use crate::coder::Coder;
use crate::error::{Error, Result};
use crate::hood::{Block, CENTRE, Children, Hoods, ONES, count};
use crate::leaf::Leaf;

/// The nodes of one depth that have children, in Morton order.
#[derive(Default)]
struct Parents {
    code: Vec<u64>,
    /// Children of every node of the list, those of nodes without any empty.
    children: Vec<Children>,
    hoods: Hoods,
}

/// The tree as far as it is coded, and the leaves found so far.
pub(super) struct Tree<'a> {
    /// What the encoder codes; the decoder has none.
    truth: Option<Truth<'a>>,
    j_high: u8,
    above: Parents,
    done: Vec<Leaf>,
    /// Greatest number of leaves.
    limit: usize,
}

impl<'a> Tree<'a> {
    pub(super) fn new(leaves: Option<&'a [Leaf]>, j_high: u8, limit: usize) -> Self {
        let above = Parents {
            code: vec![0],
            children: vec![Children { first: 0, mask: 1 }],
            hoods: Hoods::above_root(),
        };
        let truth = leaves.map(|l| Truth::new(l, j_high));
        Self { truth, j_high, above, done: Vec::new(), limit }
    }

    /// Codes the children of the nodes at `depth`.
    pub(super) fn level<C: Coder>(
        &mut self,
        depth: u8,
        models: &mut Models,
        coder: &mut C,
    ) -> Result<()> {
        let least = if depth + 1 == self.j_high { 2 } else { 1 };
        let nodes =
            self.above.children.iter().map(|c| usize::from(ONES[usize::from(c.mask)])).sum();
        let mut below =
            Parents { children: vec![Children::default(); nodes], ..Parents::default() };
        if let Some(truth) = known::<C>(&mut self.truth) {
            truth.start_level(depth);
        }
        let kernel: &Kernel = &KERNEL;
        let mut block = Block::new();
        let mut near = self.above.hoods.near.as_slice();
        let (mut at, mut next) = (0usize, 0usize);
        for (p, &present) in self.above.hoods.present.iter().enumerate() {
            let used = block.enter(present, near, &self.above.children);
            near = &near[used..];
            let mut rest = block.own().mask;
            let siblings = ONES[usize::from(rest)];
            while rest != 0 {
                let c = rest.trailing_zeros();
                rest &= rest - 1;
                let here = at;
                at += 1;
                let code = self.above.code[p] << 3 | u64::from(c);
                let window = block.window(c);
                let (around, faces) = count(window);
                let node = NodeContext { depth, siblings, faces, around, least };
                let single = known::<C>(&mut self.truth).is_some_and(Truth::next);
                if !node.splits() && models.single(coder, &node, single) {
                    let truth = known::<C>(&mut self.truth).map(|t| t.leaf());
                    let leaf = code_path(self.j_high, models, coder, &node, (code, window), truth);
                    self.done.push(leaf);
                    continue;
                }
                let mut densities = Densities::default();
                let mut around = window;
                while around != 0 {
                    let place = around.trailing_zeros();
                    around &= around - 1;
                    let i = block.index(c, place);
                    below.hoods.near.push(i);
                    if place != CENTRE {
                        let known = (i as usize) < here;
                        kernel.add(&mut densities, place, known, below.children[i as usize].mask);
                    }
                }
                below.hoods.present.push(window);
                let wanted = known::<C>(&mut self.truth).map_or(0, Truth::split);
                let mask = models.occupancy(coder, &node, &Classes::new(&densities), wanted);
                below.children[here] = Children { first: next as u32, mask };
                next += usize::from(ONES[usize::from(mask)]);
                below.code.push(code);
                if next + self.done.len() > self.limit || coder.exhausted() {
                    return Err(Error::Corrupt { what: "more cells than points", offset: 0 });
                }
            }
        }
        self.above = below;
        if let Some(truth) = known::<C>(&mut self.truth) {
            truth.end_level();
        }
        Ok(())
    }

    /// The leaves in Morton order, when all levels are coded.
    pub(super) fn finish(self) -> Vec<Leaf> {
        let mut leaves = self.done;
        let parents = self.above.children.iter().filter(|c| c.mask != 0);
        for (c, code) in parents.zip(&self.above.code) {
            let mut rest = c.mask;
            while rest != 0 {
                let morton = code << 3 | u64::from(rest.trailing_zeros());
                leaves.push(Leaf { morton, depth: self.j_high });
                rest &= rest - 1;
            }
        }
        leaves.sort_unstable_by_key(|l| l.morton);
        leaves
    }
}

/// Codes the path from a node to its single leaf.
fn code_path<C: Coder>(
    j_high: u8,
    models: &mut Models,
    coder: &mut C,
    node: &NodeContext,
    (code, window): (u64, u64),
    truth: Option<Leaf>,
) -> Leaf {
    let most = u32::from(j_high - node.depth);
    let truth = truth.unwrap_or(Leaf { morton: 0, depth: node.depth });
    let levels = models.levels_below(coder, node, most, u32::from(truth.depth - node.depth));
    let depth = node.depth + levels as u8;
    let wanted = truth.morton >> (3 * (j_high - depth));
    let mut path = code;
    if levels > 0 {
        let left = 3 * (levels - 1);
        path = path << 3
            | u64::from(models.half(coder, node.around, window, (wanted >> left) as u32 & 7));
        // The rest of the path is plain: a known floor for isolated points.
        let mut left = left;
        while left > 0 {
            let n = left.min(30);
            left -= n;
            path = path << n | u64::from(coder.bits((wanted >> left) as u32 & ((1 << n) - 1), n));
        }
    }
    Leaf { morton: path << (3 * (j_high - depth)), depth }
}

/// What an encoder knows; a constant `None` for decoders.
#[inline]
fn known<'t, 'a, C: Coder>(truth: &'t mut Option<Truth<'a>>) -> Option<&'t mut Truth<'a>> {
    if C::ENCODING { truth.as_mut() } else { None }
}
