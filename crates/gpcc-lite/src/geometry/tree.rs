//! One traversal of the tree for both directions.

use super::cells::Cells;
use super::density::{Below, Classes, Densities, KERNEL, Kernel, LOW_FACES};
use super::models::{Models, NodeContext};
use super::truth::Truth;
use crate::error::{Error, Result};
use crate::hood::{Block, CENTRE, Children, Hoods, ONES, count};
use crate::leaf::Leaf;
use crate::range::BinaryCoder;

/// The nodes of one level that have children, in Morton order.
#[derive(Default)]
struct Parents {
    code: Vec<u64>,
    /// Children of every node of the list, those of nodes without any empty.
    children: Vec<Children>,
    hoods: Hoods,
    /// Number of ancestors in a row that had one child.
    chain: Vec<u8>,
}

/// The tree as far as it is coded, and the singles that left it.
pub(super) struct Tree<'a> {
    /// What the encoder codes; the decoder has none.
    truth: Option<Truth<'a>>,
    j_high: u8,
    above: Parents,
    /// Codes of the singles that left the tree, at the current level (decoder, or lattice).
    tails: Vec<u64>,
    done: Vec<Leaf>,
}

impl<'a> Tree<'a> {
    pub(super) fn new(leaves: Option<&'a [Leaf]>, j_high: u8) -> Self {
        let above = Parents {
            code: vec![0],
            children: vec![Children { first: 0, mask: 1 }],
            hoods: Hoods::above_root(),
            chain: vec![0],
        };
        let truth = leaves.map(|l| Truth::new(l, j_high));
        Self { truth, j_high, above, tails: Vec::new(), done: Vec::new() }
    }

    /// Codes the step from `depth` to `depth + 1`; `path` codes raw bits of a single's path.
    pub(super) fn level<C: BinaryCoder>(
        &mut self,
        depth: u8,
        models: &mut Models,
        coder: &mut C,
        path: &mut impl FnMut(u32, u32) -> u32,
        limit: usize,
    ) -> Result<()> {
        if models.fast() {
            self.code_level::<true, C>(depth, models, coder, path, limit)
        } else {
            self.code_level::<false, C>(depth, models, coder, path, limit)
        }
    }

    fn code_level<const FAST: bool, C: BinaryCoder>(
        &mut self,
        depth: u8,
        models: &mut Models,
        coder: &mut C,
        path: &mut impl FnMut(u32, u32) -> u32,
        limit: usize,
    ) -> Result<()> {
        let shift = 3 * (self.j_high - depth - 1);
        let old_tails = self.tails.len();
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
            let (siblings, chain) = (block.own().mask, self.above.chain[p]);
            let mut rest = siblings;
            while rest != 0 {
                let c = rest.trailing_zeros();
                rest &= rest - 1;
                let here = at;
                at += 1;
                let code = self.above.code[p] << 3 | u64::from(c);
                let window = block.window(c);
                let ones = ONES[usize::from(siblings)];
                let mut node = NodeContext::new(depth, code, ones, chain, count(window));
                let (stops, single) =
                    known::<C>(&mut self.truth).map_or((false, false), Truth::next);
                let mut has = Below::default();
                // Fast models do not ask.
                let mut low = if FAST { 0 } else { window & LOW_FACES };
                while low != 0 {
                    let i = block.index(c, low.trailing_zeros());
                    low &= low - 1;
                    has.add(below.children[i as usize].mask);
                }
                if !node.splits() && models.single(coder, &node, has, single) {
                    if models.stop(coder, &node, stops) {
                        self.done.push(Leaf { morton: code << (shift + 3), depth });
                        continue;
                    }
                    let mut code = code;
                    if models.lattice.is_none() {
                        let child = known::<C>(&mut self.truth).map_or(0, Truth::child);
                        let child = models.half(coder, path, node.around, window, child);
                        code = code << 3 | u64::from(child);
                    }
                    self.tails.push(code);
                    if let Some(truth) = known::<C>(&mut self.truth) {
                        truth.leave();
                    }
                    continue;
                }
                node.least = least;
                let mut cells = Cells::default();
                let mut densities = Densities::default();
                let mut around = window;
                while around != 0 {
                    let place = around.trailing_zeros();
                    around &= around - 1;
                    let i = block.index(c, place);
                    below.hoods.near.push(i);
                    if place == CENTRE {
                        continue;
                    }
                    let known = (i as usize) < here;
                    let mask = below.children[i as usize].mask;
                    if FAST {
                        kernel.add(&mut densities, place, known, mask);
                    } else if known {
                        kernel.add_coded(&mut densities, place, mask);
                        cells.add_coded(place as usize, mask);
                    } else {
                        kernel.add_later(&mut densities, place);
                        cells.add_later(place as usize);
                    }
                }
                below.hoods.present.push(window);
                let wanted = known::<C>(&mut self.truth).map_or(0, Truth::split);
                let classes = Classes::new(&densities);
                let mask = if FAST {
                    models.occupancy_fast(coder, &node, &classes, wanted)
                } else {
                    models.occupancy(coder, &node, cells, &classes, wanted)
                };
                below.children[here] = Children { first: next as u32, mask };
                let ones = usize::from(ONES[usize::from(mask)]);
                next += ones;
                below.code.push(code);
                below.chain.push(if ones == 1 { chain.saturating_add(1) } else { 0 });
                if next + self.tails.len() + self.done.len() > limit || coder.exhausted() {
                    return Err(Error::Corrupt { what: "more cells than points", offset: 0 });
                }
            }
        }
        self.above = below;
        if let Some(truth) = known::<C>(&mut self.truth) {
            truth.end_level();
        }
        self.step_tails(depth, old_tails, models, coder, path);
        Ok(())
    }

    fn step_tails<C: BinaryCoder>(
        &mut self,
        depth: u8,
        old_tails: usize,
        models: &mut Models,
        coder: &mut C,
        path: &mut impl FnMut(u32, u32) -> u32,
    ) {
        let shift = 3 * (self.j_high - depth - 1);
        let mixed = models.mixed();
        // Those that joined at this level have taken the step, unless there is a lattice.
        let all = self.tails.len();
        let end = if models.lattice.is_some() { all } else { old_tails };
        let mut kept = 0;
        for i in 0..end {
            let leaf = known::<C>(&mut self.truth).map(|t| *t.tail(i));
            let code = self.tails[i];
            // One that left the tree at this level has already been asked.
            if mixed && i < old_tails {
                let stops = leaf.is_some_and(|l| l.depth == depth);
                if models.tail_stop(coder, depth, stops) {
                    self.done.push(Leaf { morton: code << (shift + 3), depth });
                    continue;
                }
            }
            let truth = leaf.map_or(0, |l| (l.morton >> shift) as u32 & 7);
            let child = match &mut models.lattice {
                Some(lattice) => lattice.path(coder, u32::from(depth) + 1, code, truth),
                None => path(truth, 3),
            };
            self.tails[kept] = (code << 3) | u64::from(child);
            if let Some(t) = known::<C>(&mut self.truth) {
                t.keep_tail(i, kept);
            }
            kept += 1;
        }
        for i in end..all {
            self.tails[kept] = self.tails[i];
            if let Some(t) = known::<C>(&mut self.truth) {
                t.keep_tail(i, kept);
            }
            kept += 1;
        }
        self.tails.truncate(kept);
        if let Some(t) = known::<C>(&mut self.truth) {
            t.truncate_tails(kept);
        }
    }

    /// The leaves, cut at depth `target`, the level last coded.
    pub(super) fn finish(self, target: u8) -> Vec<Leaf> {
        let cut = 3 * (self.j_high - target);
        let mut leaves = self.done;
        for l in &mut leaves {
            l.morton >>= cut;
        }
        leaves.extend(self.tails.iter().map(|&morton| Leaf { morton, depth: target }));
        let parents = self.above.children.iter().filter(|c| c.mask != 0);
        for (c, code) in parents.zip(&self.above.code) {
            let mut rest = c.mask;
            while rest != 0 {
                let morton = code << 3 | u64::from(rest.trailing_zeros());
                leaves.push(Leaf { morton, depth: target });
                rest &= rest - 1;
            }
        }
        leaves.sort_unstable_by_key(|l| l.morton);
        leaves
    }
}

/// What an encoder knows; a constant `None` for decoders.
#[inline]
fn known<'t, 'a, C: BinaryCoder>(truth: &'t mut Option<Truth<'a>>) -> Option<&'t mut Truth<'a>> {
    if C::ENCODING { truth.as_mut() } else { None }
}
