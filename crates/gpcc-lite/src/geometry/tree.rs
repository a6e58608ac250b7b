//! One traversal of the tree for both directions.

use super::cells::Cells;
use super::models::{Models, NodeContext};
use crate::error::{Error, Result};
use crate::hood::{Children, Hood, ONES, child_hood};
use crate::leaf::Leaf;
use crate::range::BinaryCoder;

/// Where the tree comes from.
#[derive(Clone, Copy)]
pub(super) enum Source<'a> {
    /// The encoder's leaves.
    Leaves(&'a [Leaf]),
    /// The stream being decoded.
    Stream,
}

/// The nodes of one level that are still in the tree.
#[derive(Default)]
struct Nodes {
    code: Vec<u64>,
    /// Encoder only: range of leaves under each node.
    range: Vec<[u32; 2]>,
    /// Index of the parent in the level above.
    parent: Vec<u32>,
}

/// What a level leaves behind for the one below.
#[derive(Default)]
struct Above {
    children: Vec<Children>,
    hood: Vec<Hood>,
    /// Index into `hood` and `chain` of each node with children.
    hood_of: Vec<u32>,
    chain: Vec<u8>,
}

/// The tree as far as it is coded, and the singles that left it.
pub(super) struct Tree<'a> {
    source: Source<'a>,
    j_high: u8,
    nodes: Nodes,
    above: Above,
    /// Codes of the singles that left the tree, at the current level.
    tails: Vec<u64>,
    /// Encoder only: the leaf each tail leads to.
    tail_leaf: Vec<u32>,
    done: Vec<Leaf>,
}

impl<'a> Tree<'a> {
    pub(super) fn new(source: Source<'a>, j_high: u8) -> Self {
        let range = match source {
            Source::Leaves(l) => vec![[0, l.len() as u32]],
            Source::Stream => Vec::new(),
        };
        Self {
            source,
            j_high,
            nodes: Nodes { code: vec![0], range, parent: Vec::new() },
            above: Above::default(),
            tails: Vec::new(),
            tail_leaf: Vec::new(),
            done: Vec::new(),
        }
    }

    /// Codes the step from `depth` to `depth + 1`; `path` codes three raw bits of a single's path.
    pub(super) fn level<C: BinaryCoder>(
        &mut self,
        depth: u8,
        models: &mut Models,
        coder: &mut C,
        path: &mut impl FnMut(u32) -> u32,
        limit: usize,
    ) -> Result<()> {
        let shift = 3 * (self.j_high - depth - 1);
        let count = self.nodes.code.len();
        let old_tails = self.tails.len();
        let mut above = Above {
            children: vec![Children::default(); count],
            hood: Vec::with_capacity(count / 2),
            hood_of: vec![0; count],
            chain: Vec::with_capacity(count / 2),
        };
        let mut next = Nodes::default();
        for at in 0..count {
            let code = self.nodes.code[at];
            let (hood, siblings, chain) = match self.nodes.parent.get(at) {
                Some(&p) => {
                    let p = p as usize;
                    let of = self.above.hood_of[p] as usize;
                    let children = &self.above.children;
                    let hood = child_hood(&self.above.hood[of], (code & 7) as usize, children);
                    (hood, children[p].mask, self.above.chain[of])
                }
                None => (Hood::ROOT, 1, 0),
            };
            let mut truth = Truth::default();
            if let Source::Leaves(leaves) = self.source {
                truth = Truth::of(leaves, self.nodes.range[at], depth, shift);
            }
            let mut node = NodeContext::new(depth, code, siblings, chain, &hood);
            if models.stop(coder, &node, truth.stops) {
                self.done.push(Leaf { morton: code << (shift + 3), depth });
                continue;
            }
            if models.single(coder, &node, truth.single) {
                self.tails.push(code);
                if C::ENCODING {
                    self.tail_leaf.push(self.nodes.range[at][0]);
                }
                continue;
            }
            node.least = if depth + 1 == self.j_high { 2 } else { 1 };
            let cells = Cells::around(&hood, &above.children, at);
            let mask = models.occupancy(coder, &node, &cells, truth.mask);
            above.children[at] = Children { first: next.code.len() as u32, mask };
            above.hood_of[at] = above.hood.len() as u32;
            above.hood.push(hood);
            let only = ONES[usize::from(mask)] == 1;
            above.chain.push(if only { chain.saturating_add(1) } else { 0 });
            for c in 0..8 {
                if mask >> c & 1 == 1 {
                    next.code.push((code << 3) | c as u64);
                    next.parent.push(at as u32);
                    if C::ENCODING {
                        next.range.push([truth.bounds[c], truth.bounds[c + 1]]);
                    }
                }
            }
            if next.code.len() + self.tails.len() + self.done.len() > limit || coder.exhausted() {
                return Err(Error::Corrupt { what: "more cells than points", offset: 0 });
            }
        }
        self.nodes = next;
        self.above = above;
        self.step_tails(depth, old_tails, models, coder, path);
        Ok(())
    }

    fn step_tails<C: BinaryCoder>(
        &mut self,
        depth: u8,
        old_tails: usize,
        models: &mut Models,
        coder: &mut C,
        path: &mut impl FnMut(u32) -> u32,
    ) {
        let shift = 3 * (self.j_high - depth - 1);
        let mut kept = 0;
        for i in 0..self.tails.len() {
            let mut truth = 0;
            let mut stops = false;
            if let Source::Leaves(leaves) = self.source {
                let leaf = leaves[self.tail_leaf[i] as usize];
                truth = (leaf.morton >> shift) as u32 & 7;
                stops = leaf.depth == depth;
            }
            let code = self.tails[i];
            // One that left the tree at this level has already been asked.
            if i < old_tails && models.tail_stop(coder, depth, stops) {
                self.done.push(Leaf { morton: code << (shift + 3), depth });
                continue;
            }
            let child = match &mut models.lattice {
                Some(lattice) => lattice.path(coder, u32::from(depth) + 1, code, truth),
                None => path(truth),
            };
            self.tails[kept] = (code << 3) | u64::from(child);
            if C::ENCODING {
                self.tail_leaf[kept] = self.tail_leaf[i];
            }
            kept += 1;
        }
        self.tails.truncate(kept);
        if C::ENCODING {
            self.tail_leaf.truncate(kept);
        }
    }

    /// The leaves, cut at depth `target`, the level last coded.
    pub(super) fn finish(self, target: u8) -> Vec<Leaf> {
        let cut = 3 * (self.j_high - target);
        let mut leaves = self.done;
        for l in &mut leaves {
            l.morton >>= cut;
        }
        let deepest = self.nodes.code.iter().chain(&self.tails);
        leaves.extend(deepest.map(|&morton| Leaf { morton, depth: target }));
        leaves.sort();
        leaves
    }
}

/// What the encoder knows of a node.
#[derive(Default)]
struct Truth {
    stops: bool,
    single: bool,
    mask: u8,
    /// Boundaries of the eight children among the leaves.
    bounds: [u32; 9],
}

impl Truth {
    fn of(leaves: &[Leaf], [lo, hi]: [u32; 2], depth: u8, shift: u8) -> Self {
        let child = |l: &Leaf| (l.morton >> shift) as u8 & 7;
        let leaf = leaves[lo as usize];
        let mut truth = Self { single: hi - lo == 1, ..Self::default() };
        if truth.single {
            truth.stops = leaf.depth == depth;
            return truth;
        }
        let mut at = lo;
        truth.bounds[0] = lo;
        for c in 0..8u8 {
            let rest = &leaves[at as usize..hi as usize];
            let len = if rest.len() > 32 {
                rest.partition_point(|l| child(l) <= c)
            } else {
                rest.iter().take_while(|l| child(l) == c).count()
            };
            if len > 0 {
                truth.mask |= 1 << c;
            }
            at += len as u32;
            truth.bounds[usize::from(c) + 1] = at;
        }
        truth
    }
}
