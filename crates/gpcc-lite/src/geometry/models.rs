//! Contexts and counters of the decisions at a node.

use super::cells::Cells;
use super::lattice::Lattice;
use crate::hood::ONES;
use crate::mix::{Mixer, code_mixed};
use crate::model::{Bit, table};
use crate::morton;
use crate::range::BinaryCoder;

/// Memory of the counters.
const LIMIT: u32 = 255;
/// Inputs of the occupancy mixer without and with the lattice.
const PLAIN: usize = 4;
const WITH_LATTICE: usize = PLAIN + 3;

/// What is known of a node before its occupancy.
#[derive(Clone, Copy, Debug)]
pub(super) struct NodeContext {
    pub(super) depth: u8,
    pub(super) code: u64,
    /// Occupancy of the parent.
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
}

/// All adaptive state of a geometry stream.
pub(super) struct Models {
    /// Leaves end at different depths.
    mixed: bool,
    /// One counter per decision, nothing mixed.
    fast: bool,
    stop: Vec<Bit>,
    tail_stop: Vec<Bit>,
    /// Of a node having a single leaf.
    by_depth: Box<[Bit; 32 * 32]>,
    by_family: Box<[Bit; 256 * 8 * 4]>,
    single_mixer: [Mixer<2>; 32],
    /// Of a child being occupied.
    near: Box<[Bit; 1 << 16]>,
    shape: Box<[Bit; 256 * 32]>,
    density: Box<[Bit; 32 * 32 * 32]>,
    family: Box<[Bit; 256 * 64]>,
    mixers: [Mixer<PLAIN>; 8 * 4],
    lattice_mixers: [Mixer<WITH_LATTICE>; 8 * 4],
    pub(super) lattice: Option<Lattice>,
}

impl Models {
    pub(super) fn new(mixed: bool, lattice: bool, fast: bool) -> Self {
        Self {
            mixed,
            fast,
            stop: vec![Bit::default(); 32 * 32],
            tail_stop: vec![Bit::default(); 32],
            by_depth: table(),
            by_family: table(),
            single_mixer: [Mixer::new(72_000); 32],
            near: table(),
            shape: table(),
            density: table(),
            family: table(),
            mixers: [Mixer::new(80_000); 8 * 4],
            lattice_mixers: [Mixer::new(100_000); 8 * 4],
            lattice: lattice.then(Lattice::new),
        }
    }

    /// Whether leaves end at different depths.
    pub(super) fn mixed(&self) -> bool {
        self.mixed
    }

    /// Codes whether a node is a leaf.
    pub(super) fn stop<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        truth: bool,
    ) -> bool {
        if !self.mixed {
            return false;
        }
        let ctx = usize::from(node.depth) * 32
            + usize::from(node.around.min(3)) * 4
            + usize::from(ONES[usize::from(node.siblings)].min(4) - 1);
        self.stop[ctx].code(coder, truth, LIMIT)
    }

    /// Codes whether a single's path ends at `depth`.
    pub(super) fn tail_stop<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        depth: u8,
        truth: bool,
    ) -> bool {
        self.mixed && self.tail_stop[usize::from(depth)].code(coder, truth, LIMIT)
    }

    /// Codes whether there is exactly one leaf below a node.
    pub(super) fn single<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        truth: bool,
    ) -> bool {
        let around = usize::from(node.around.min(7));
        let a = usize::from(node.depth) * 32 + usize::from(node.chain) * 8 + around;
        let b = (usize::from(node.siblings) * 8 + (node.code & 7) as usize) * 4
            + usize::from(node.faces.min(3));
        if self.fast {
            return self.by_depth[a & 1023].code(coder, truth, LIMIT);
        }
        let bits = [&mut self.by_depth[a & 1023], &mut self.by_family[b & 0x1fff]];
        let mixer = &mut self.single_mixer[usize::from(node.depth) & 31];
        code_mixed(coder, mixer, bits, truth, 2, LIMIT)
    }

    /// Codes which children of a node are occupied.
    pub(super) fn occupancy<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        cells: Cells,
        truth: u8,
    ) -> u8 {
        let xyz = self.lattice.as_ref().map(|_| morton::decode(node.code));
        let outside: [usize; 8] = std::array::from_fn(|c| usize::from(cells.outside(c)) << 2);
        // Touching the counters of all eight at once overlaps their cache misses.
        let warm = outside.iter().fold(0, |sum, &o| sum + self.near[o & 0xffff].count());
        std::hint::black_box(warm);
        let density = (usize::from(node.depth & 31) * 32 + usize::from(node.around & 31)) * 32;
        if self.fast {
            return self.occupancy_fast(coder, node, &outside, density, truth);
        }
        let shape = (usize::from(node.chain) * 8 + usize::from(node.faces)) & 31;
        let family = (usize::from(node.siblings) * 8 + (node.code & 7) as usize) * 8;
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
            let near = &mut self.near[(outside[c] | so_far) & 0xffff];
            let shape = &mut self.shape[(at * 32 + shape) & 0x1fff];
            let density = &mut self.density[(density + 4 * c + so_far) & 0x7fff];
            let family = &mut self.family[(family + c) & 0x3fff];
            let bit = truth >> c & 1 == 1;
            let select = (c * 4 + so_far) & 31;
            let bit = match (&mut self.lattice, xyz) {
                (Some(lattice), Some(xyz)) => {
                    let child = [4, 2, 1].map(|b| u32::from(c & b != 0));
                    let at = std::array::from_fn(|k| xyz[k] << 1 | child[k]);
                    let [x, y, z] = lattice.counters(u32::from(node.depth) + 1, at);
                    let mixer = &mut self.lattice_mixers[select];
                    let bits = [near, shape, density, family, x, y, z];
                    code_mixed(coder, mixer, bits, bit, 4, LIMIT)
                }
                _ => {
                    let bits = [near, shape, density, family];
                    code_mixed(coder, &mut self.mixers[select], bits, bit, 4, LIMIT)
                }
            };
            occupancy |= u8::from(bit) << c;
            count += u8::from(bit);
        }
        occupancy
    }

    /// The same with one counter each: what touches the child, or if nothing does, the density.
    fn occupancy_fast<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        outside: &[usize; 8],
        density: usize,
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
            let so_far = usize::from(count.min(3));
            let bit = if outside[c] == 0 {
                &mut self.density[(density + 4 * c + so_far) & 0x7fff]
            } else {
                &mut self.near[(outside[c] | so_far) & 0xffff]
            };
            let bit = bit.code(coder, truth >> c & 1 == 1, LIMIT);
            occupancy |= u8::from(bit) << c;
            count += u8::from(bit);
        }
        occupancy
    }
}
