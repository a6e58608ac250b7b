//! Contexts and models of what the stream says at a node.
//!
//! `docs/format.md`, "Geometry", lists the contexts.

use super::Layout;
use super::density::{Classes, lean};
use super::slabs::{FITS, STATES, Slabs};
use crate::coder::{Coder, code_gamma};
use crate::model::{Bit, table};
use crate::symbols::{SYMBOLS, Symbols};

/// Memory of the decisions' models, in observations.
const LIMIT: u32 = 255;
/// If the numbers of neighbours on both sides of an axis differ by less than this, the half is a
/// plain bit.
const LEAN: u32 = 2;
/// The symbol of a leaf that lies this many levels below its node, or more.
const DEEP: u32 = SYMBOLS as u32 - 1;

/// What is known of a node before its children are coded.
#[derive(Clone, Copy, Debug)]
pub(super) struct NodeContext {
    pub(super) depth: u8,
    /// Its indices along the axes; zero where no slabs are kept.
    pub(super) cell: [u32; 3],
    /// Number of children of the parent.
    pub(super) siblings: u8,
    /// Occupied face neighbours, 0 to 6.
    pub(super) faces: u8,
    /// Occupied neighbours of all 26.
    pub(super) around: u8,
    /// Least number of children that it can have: two at the last level, since it has two leaves or
    /// more.
    pub(super) least: u8,
}

impl NodeContext {
    /// Whether it is known that two leaves or more lie below: the only child of a parent with
    /// several.
    #[inline]
    pub(super) fn splits(&self) -> bool {
        self.siblings == 1 && self.depth > 0
    }
}

/// All adaptive state of a geometry stream.
pub(super) struct Models {
    layout: Layout,
    /// Whether a node has a single leaf.
    single: Box<[Bit; 16 * 8 * 8]>,
    /// Levels from a node to its single leaf, by those of the last two such nodes at the same
    /// depth, and by the number of neighbours.
    levels_below: Vec<Symbols>,
    /// For each depth of a node, the depths of the last two single leaves below such nodes.
    last_leaf_depths: [[u8; 2]; 32],
    /// The half of a node, along an axis, in which its single leaf is.
    half: Box<[Bit; 16 * 32]>,
    /// Whether a child is occupied.
    occupied: Vec<Bit>,
    /// With planes: the half of a cell in which a single leaf is, by the counts of the slab.
    slab_half: Box<[Bit; STATES]>,
    /// With planes: the slabs.
    slabs: Slabs,
}

impl Models {
    pub(super) fn new(layout: Layout, j_high: u8) -> Self {
        let fits = if layout.planes { FITS } else { 1 };
        Self {
            layout,
            single: table(),
            levels_below: (0..32 * 4).map(|i| Symbols::geometric(64 * (i / 4), 2)).collect(),
            last_leaf_depths: std::array::from_fn(|depth| [depth as u8; 2]),
            half: table(),
            occupied: vec![Bit::default(); fits * 32 * 16 * 4],
            slab_half: table(),
            slabs: Slabs::new(if layout.planes { j_high } else { 0 }),
        }
    }

    /// Whether slabs are kept.
    pub(super) fn planes(&self) -> bool {
        self.layout.planes
    }

    /// Codes whether there is exactly one leaf below a node.
    pub(super) fn single<C: Coder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        value: bool,
    ) -> bool {
        let siblings = usize::from(node.siblings.clamp(1, 8) - 1);
        let at = (usize::from(node.around.min(15)) * 8 + usize::from(node.faces)) * 8 + siblings;
        self.single[at & 1023].code(coder, value, LIMIT)
    }

    /// Codes how many levels below a node its single leaf is: `most`, if all leaves are at the
    /// finest depth.
    pub(super) fn levels_below<C: Coder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        most: u32,
        value: u32,
    ) -> u32 {
        if !self.layout.mixed_depths {
            return most;
        }
        let depth = node.depth;
        let last = &mut self.last_leaf_depths[usize::from(depth) & 31];
        let expected = (last[0] - depth + last[1] - depth).min(31);
        let model =
            &mut self.levels_below[usize::from(expected) * 4 + usize::from(node.around.min(3))];
        let symbol = coder.symbol(model, value.min(DEEP) as usize) as u32;
        let more = if symbol == DEEP { code_gamma(coder, value.saturating_sub(DEEP)) } else { 0 };
        let levels = symbol.saturating_add(more).min(most);
        *last = [depth + levels as u8, last[0]];
        levels
    }

    /// Codes the path from a node to its single leaf, `levels` child numbers of three bits.
    pub(super) fn path<C: Coder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        window: u64,
        levels: u32,
        value: u64,
    ) -> u64 {
        if levels == 0 {
            return 0;
        }
        if self.layout.planes {
            return self.path_in_slabs(coder, node, levels, value);
        }
        let mut left = 3 * (levels - 1);
        let first = (value >> left) as u32 & 7;
        let mut path = u64::from(self.first_step(coder, node.around, window, first));
        // The rest of the path is as good as random for an isolated point: plain bits.
        while left > 0 {
            let n = left.min(30);
            left -= n;
            path = path << n | u64::from(coder.bits((value >> left) as u32 & ((1 << n) - 1), n));
        }
        path
    }

    /// Codes the child in which the single leaf of a node is: towards the node's neighbours rather
    /// than away, or in plain bits along axes where these are balanced.
    #[inline]
    fn first_step<C: Coder>(&mut self, coder: &mut C, around: u8, window: u64, value: u32) -> u32 {
        let mut child = 0;
        for axis in 0..3 {
            let value = value >> (2 - axis) & 1;
            let lean = lean(window, axis);
            let bit = if lean.unsigned_abs() < LEAN {
                coder.bits(value, 1)
            } else {
                let at = (lean.unsigned_abs() as usize) * 32 + usize::from(around);
                let low = lean < 0;
                u32::from(self.half[at & 511].code(coder, (value == 1) != low, LIMIT) != low)
            };
            child = child << 1 | bit;
        }
        child
    }

    /// Codes a path where leaves lie in planes: each half by what its slab has held.
    fn path_in_slabs<C: Coder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        levels: u32,
        value: u64,
    ) -> u64 {
        let mut path = 0;
        let mut cell = node.cell;
        for level in 0..levels {
            for (axis, index) in cell.iter_mut().enumerate() {
                let counts = self.slabs.slab(node.depth + level as u8, axis, *index);
                let high = value >> (3 * (levels - level) - 1 - axis as u32) & 1 == 1;
                let model = &mut self.slab_half[counts.state() % STATES];
                let high = model.code(coder, high, LIMIT);
                counts.learn([!high, high]);
                *index = 2 * *index + u32::from(high);
                path = path << 1 | u64::from(high);
            }
        }
        path
    }

    /// Codes which children of a node are occupied.
    pub(super) fn occupancy<C: Coder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        classes: &Classes,
        value: u8,
    ) -> u8 {
        let planes = self.layout.planes;
        let fits = if planes { self.slabs.fits(node.depth, node.cell) } else { [0; 8] };
        let mut occupancy = 0u8;
        let mut count = 0u8;
        for c in 0..8usize {
            // A child that must be occupied is not coded.
            if 8 - c as u8 == node.least.saturating_sub(count) {
                occupancy |= 1 << c;
                count += 1;
                continue;
            }
            let at = ((usize::from(fits[c]) * 32 + usize::from(classes.share[c])) * 16
                + classes.total)
                * 4
                + usize::from(count.min(3));
            let bit = self.occupied[at].code(coder, value >> c & 1 == 1, LIMIT);
            occupancy |= u8::from(bit) << c;
            count += u8::from(bit);
        }
        if planes {
            self.slabs.learn(node.depth, node.cell, occupancy);
        }
        occupancy
    }
}
