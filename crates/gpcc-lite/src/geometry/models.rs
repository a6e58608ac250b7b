//! Contexts and models of what the stream says at a node.
//!
//! `docs/format.md`, "Geometry", lists the contexts.

use super::node::{LIMIT, NodeContext};
use super::slabs::{FITS, Slabs};
use crate::coder::{Coder, code_gamma};
use crate::hood::{count, touching};
use crate::leaf::Leaf;
use crate::model::{Bit, table};
use crate::morton;
use crate::symbols::{SYMBOLS, Symbols};

/// Contexts of a child, for one fit to its slabs.
const CONTEXTS: usize = 8 * 8 * 4 * 4;
/// The symbol of a leaf that lies this many levels below its node, or more.
const DEEP: u32 = SYMBOLS as u32 - 1;

/// All adaptive state of a geometry stream.
pub(super) struct GeometryModels {
    /// Whether a node has a single leaf.
    single: Box<[Bit; 32]>,
    /// Levels from a node to its single leaf, by the node's depth.
    levels_below: Vec<Symbols>,
    /// Whether a child is occupied.
    occupied: Vec<Bit>,
    slabs: Option<Slabs>,
    tree_depth: u8,
}

impl GeometryModels {
    pub(super) fn new(slabs: bool, tree_depth: u8) -> Self {
        let fits = if slabs { FITS } else { 1 };
        Self {
            single: table(),
            levels_below: (0..32).map(|_| Symbols::geometric(512, 2)).collect(),
            occupied: vec![Bit::default(); fits * CONTEXTS],
            slabs: slabs.then(|| Slabs::new(tree_depth)),
            tree_depth,
        }
    }

    /// Codes whether there is exactly one leaf below a node.
    #[inline]
    pub(super) fn single<C: Coder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        value: bool,
    ) -> bool {
        self.single[usize::from(count(node.window)) & 31].code(coder, value, LIMIT)
    }

    /// Codes the single leaf below a node.
    #[inline]
    pub(super) fn leaf<C: Coder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        wanted: Option<Leaf>,
    ) -> Leaf {
        let most = u32::from(self.tree_depth - node.depth);
        let wanted = wanted.unwrap_or(Leaf { morton: 0, depth: node.depth });
        let levels = self.levels_below(coder, node, most, u32::from(wanted.depth - node.depth));
        let depth = node.depth + levels as u8;
        let below = 3 * (self.tree_depth - depth);
        let path = self.path(coder, node, levels, wanted.morton >> below);
        Leaf { morton: (node.code << (3 * levels) | path) << below, depth }
    }

    /// Codes how many levels below a node its single leaf is, at most `most`.
    fn levels_below<C: Coder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        most: u32,
        value: u32,
    ) -> u32 {
        let model = &mut self.levels_below[usize::from(node.depth) & 31];
        let symbol = coder.symbol(model, value.min(DEEP) as usize) as u32;
        let more = if symbol == DEEP { code_gamma(coder, value.saturating_sub(DEEP)) } else { 0 };
        symbol.saturating_add(more).min(most)
    }

    /// Codes the path from a node to its single leaf, `levels` child numbers of three bits.
    fn path<C: Coder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        levels: u32,
        value: u64,
    ) -> u64 {
        if let Some(slabs) = &mut self.slabs {
            return slabs.path(coder, node, levels, value);
        }
        let (mut left, mut path) = (3 * levels, 0);
        while left > 0 {
            let n = left.min(30);
            left -= n;
            path = path << n | u64::from(coder.bits((value >> left) as u32 & ((1 << n) - 1), n));
        }
        path
    }

    /// Codes which children of a node are occupied.
    #[inline(always)]
    pub(super) fn occupancy<C: Coder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        value: u8,
    ) -> u8 {
        let fits =
            self.slabs.as_ref().map_or([0; 8], |s| s.fits(node.depth, morton::decode(node.code)));
        let touching = touching(node.window);
        let mut occupancy = 0u8;
        let mut count = 0u8;
        for c in 0..8usize {
            // A child that must be occupied is not coded.
            if 8 - c as u8 == node.least.saturating_sub(count) {
                occupancy |= 1 << c;
                count += 1;
                continue;
            }
            let at = usize::from(fits[c]) * CONTEXTS + context(touching[c], c, occupancy, count);
            let bit = self.occupied[at].code(coder, value >> c & 1 == 1, LIMIT);
            occupancy |= u8::from(bit) << c;
            count += u8::from(bit);
        }
        if let Some(slabs) = &mut self.slabs {
            slabs.learn(node.depth, morton::decode(node.code), occupancy);
        }
        occupancy
    }
}

/// The model of a child, by the occupied cells around the node that touch it (0 to 7), its number, the children
/// before it that share a face with it (0 to 3), and the number of all children before it.
#[inline(always)]
fn context(touching: u8, c: usize, occupancy: u8, count: u8) -> usize {
    let before = usize::from(occupancy);
    let beside = (before >> (c ^ 1) & 1) + (before >> (c ^ 2) & 1) + (before >> (c ^ 4) & 1);
    ((usize::from(touching) * 8 + c) * 4 + beside) * 4 + usize::from(count.min(3))
}
