//! Contexts and counters of the decisions at a node.

use super::cells::Cells;
use super::density::{Below, Classes, lean};
use super::lattice::Lattice;
use crate::mix::{Mixer, code_mixed};
use crate::model::{Bit, table};
use crate::morton;
use crate::range::BinaryCoder;

/// Memory of the counters.
const LIMIT: u32 = 255;
/// Axes where the neighbours on both sides differ by less have nothing to say.
const LEAN: u32 = 2;
/// Rate of the occupancy mixers.
const RATE: i32 = 8;
/// Inputs of the occupancy mixer without and with the lattice.
const PLAIN: usize = 5;
const WITH_LATTICE: usize = PLAIN + 3;

/// What is known of a node before its occupancy.
#[derive(Clone, Copy, Debug)]
pub(super) struct NodeContext {
    pub(super) depth: u8,
    pub(super) code: u64,
    /// Number of children of the parent.
    pub(super) siblings: u8,
    /// Number of ancestors in a row that had one child, saturating.
    pub(super) chain: u8,
    /// Occupied face neighbours, 0 to 6.
    pub(super) faces: u8,
    /// Occupied neighbours of all 26.
    pub(super) around: u8,
    /// Fewest children it can have.
    pub(super) least: u8,
}

impl NodeContext {
    pub(super) fn new(
        depth: u8,
        code: u64,
        siblings: u8,
        chain: u8,
        (around, faces): (u8, u8),
    ) -> Self {
        Self { depth, code, siblings, chain: chain.min(3), faces, around, least: 1 }
    }

    /// With one leaf or none below, its parent would have been a single.
    #[inline]
    pub(super) fn splits(&self) -> bool {
        self.siblings == 1 && self.depth > 0
    }
}

/// Whether paths end, at one depth.
#[derive(Clone, Copy, Debug, Default)]
struct Stop {
    /// By the last four decisions and what else is known.
    bits: [[Bit; 4]; 16],
    /// Those decisions, the last one lowest: leaves of a depth keep together.
    last: u8,
}

impl Stop {
    fn code<C: BinaryCoder>(&mut self, coder: &mut C, known: usize, truth: bool) -> bool {
        let last = usize::from(self.last & 15);
        let bit = self.bits[last][known & 3].code(coder, truth, LIMIT);
        self.last = self.last << 1 | u8::from(bit);
        bit
    }
}

/// All adaptive state of a geometry stream.
pub(super) struct Models {
    /// Leaves end at different depths.
    mixed: bool,
    /// One counter per decision, nothing mixed.
    fast: bool,
    stop: [Stop; 32],
    tail_stop: [Stop; 32],
    /// Of a node having a single leaf.
    by_around: Box<[Bit; 16 * 8 * 8]>,
    by_below: Box<[Bit; 64 * 4]>,
    single_mixer: [Mixer<2>; 32],
    /// Of the half of a single in which its leaf is.
    half: Box<[Bit; 16 * 32]>,
    /// Of a child being occupied.
    near: Box<[Bit; 1 << 16]>,
    shape: Box<[Bit; 256 * 32]>,
    own: Box<[Bit; 64 * 4]>,
    share: Box<[Bit; 32 * 8 * 8]>,
    both: Box<[Bit; 32 * 16 * 4]>,
    mixers: [Mixer<PLAIN>; 8 * 4],
    lattice_mixers: [Mixer<WITH_LATTICE>; 8 * 4],
    pub(super) lattice: Option<Lattice>,
}

impl Models {
    pub(super) fn new(mixed: bool, lattice: bool, fast: bool) -> Self {
        Self {
            mixed,
            fast,
            stop: [Stop::default(); 32],
            tail_stop: [Stop::default(); 32],
            by_around: table(),
            by_below: table(),
            single_mixer: [Mixer::new(72_000); 32],
            half: table(),
            near: table(),
            shape: table(),
            own: table(),
            share: table(),
            both: table(),
            mixers: [Mixer::new(75_000); 8 * 4],
            lattice_mixers: [Mixer::new(100_000); 8 * 4],
            lattice: lattice.then(Lattice::new),
        }
    }

    /// One counter per decision.
    pub(super) fn fast(&self) -> bool {
        self.fast
    }

    /// Whether leaves end at different depths.
    pub(super) fn mixed(&self) -> bool {
        self.mixed
    }

    /// Codes whether a single is the leaf itself.
    pub(super) fn stop<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        truth: bool,
    ) -> bool {
        let around = usize::from(node.around.min(3));
        self.mixed && self.stop[usize::from(node.depth) & 31].code(coder, around, truth)
    }

    /// Codes whether a single's path ends at `depth`.
    pub(super) fn tail_stop<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        depth: u8,
        truth: bool,
    ) -> bool {
        self.mixed && self.tail_stop[usize::from(depth) & 31].code(coder, 0, truth)
    }

    /// Codes whether there is exactly one leaf below a node.
    pub(super) fn single<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        below: Below,
        truth: bool,
    ) -> bool {
        let siblings = usize::from(node.siblings.clamp(1, 8) - 1);
        let a = (usize::from(node.around.min(15)) * 8 + usize::from(node.faces)) * 8 + siblings;
        let around = &mut self.by_around[a & 1023];
        if self.fast {
            return around.code(coder, truth, LIMIT);
        }
        let below = &mut self.by_below[(below.class() * 4 + siblings.min(3)) & 255];
        let mixer = &mut self.single_mixer[usize::from(node.depth) & 31];
        code_mixed(coder, mixer, [around, below], truth, 2, LIMIT)
    }

    /// Codes the child of a single: towards its neighbours rather than away, or in raw bits along
    /// axes where these are balanced.
    #[inline]
    pub(super) fn half<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        raw: &mut impl FnMut(u32, u32) -> u32,
        around: u8,
        window: u64,
        truth: u32,
    ) -> u32 {
        let mut child = 0;
        for axis in 0..3 {
            let truth = truth >> (2 - axis) & 1;
            let lean = lean(window, axis);
            let bit = if lean.unsigned_abs() < LEAN {
                raw(truth, 1)
            } else {
                let at = (lean.unsigned_abs() as usize) * 32 + usize::from(around);
                let low = lean < 0;
                u32::from(self.half[at & 511].code(coder, (truth == 1) != low, LIMIT) != low)
            };
            child = child << 1 | bit;
        }
        child
    }

    /// Codes which children of a node are occupied.
    pub(super) fn occupancy<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        cells: Cells,
        classes: &Classes,
        truth: u8,
    ) -> u8 {
        let xyz = self.lattice.as_ref().map(|_| morton::decode(node.code));
        let outside: [usize; 8] = std::array::from_fn(|c| usize::from(cells.outside(c)) << 2);
        // Touching the counters of all eight at once overlaps their cache misses.
        let warm = outside.iter().fold(0, |sum, &o| sum + self.near[o & 0xffff].count());
        std::hint::black_box(warm);
        let shape = (usize::from(node.chain) * 8 + usize::from(node.faces)) & 31;
        let mut occupancy = 0u8;
        let mut count = 0u8;
        for c in 0..8usize {
            // What must be there is not coded.
            if 8 - c as u8 == node.least.saturating_sub(count) {
                occupancy |= 1 << c;
                count += 1;
                continue;
            }
            let so_far = usize::from(count.min(3));
            let at = (1usize << c) | usize::from(occupancy);
            let share = usize::from(classes.share[c]);
            let near = &mut self.near[(outside[c] | so_far) & 0xffff];
            let shape = &mut self.shape[(at * 32 + shape) & 0x1fff];
            let own = &mut self.own[(usize::from(classes.own[c]) * 4 + so_far) & 255];
            let by_share = &mut self.share[((share * 8 + c) * 8 + usize::from(count)) & 2047];
            let both = &mut self.both[((share * 16 + classes.total) * 4 + so_far) & 2047];
            let bit = truth >> c & 1 == 1;
            let select = (c * 4 + so_far) & 31;
            let bit = match (&mut self.lattice, xyz) {
                (Some(lattice), Some(xyz)) => {
                    let child = [4, 2, 1].map(|b| u32::from(c & b != 0));
                    let at = std::array::from_fn(|k| xyz[k] << 1 | child[k]);
                    let [x, y, z] = lattice.counters(u32::from(node.depth) + 1, at);
                    let mixer = &mut self.lattice_mixers[select];
                    let bits = [near, shape, own, by_share, both, x, y, z];
                    code_mixed(coder, mixer, bits, bit, RATE, LIMIT)
                }
                _ => {
                    let bits = [near, shape, own, by_share, both];
                    code_mixed(coder, &mut self.mixers[select], bits, bit, RATE, LIMIT)
                }
            };
            occupancy |= u8::from(bit) << c;
            count += u8::from(bit);
        }
        occupancy
    }

    /// The same by fast models: one counter each.
    pub(super) fn occupancy_fast<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        classes: &Classes,
        truth: u8,
    ) -> u8 {
        let mut occupancy = 0u8;
        let mut count = 0u8;
        for c in 0..8usize {
            if 8 - c as u8 == node.least.saturating_sub(count) {
                occupancy |= 1 << c;
                count += 1;
                continue;
            }
            let at = (usize::from(classes.share[c]) * 16 + classes.total) * 4
                + usize::from(count.min(3));
            let bit = self.both[at & 2047].code(coder, truth >> c & 1 == 1, LIMIT);
            occupancy |= u8::from(bit) << c;
            count += u8::from(bit);
        }
        occupancy
    }
}
