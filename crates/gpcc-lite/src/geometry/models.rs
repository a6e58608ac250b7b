//! Contexts and counters of the decisions at a node.

use super::cells::Cells;
use super::lattice::Lattice;
use crate::hood::{Hood, ONES};
use crate::mix::{Mixer, stretch};
use crate::model::Bit;
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
    pub(super) fn new(depth: u8, code: u64, siblings: u8, chain: u8, hood: &Hood) -> Self {
        const FACES: u32 = 1 << 4 | 1 << 10 | 1 << 12 | 1 << 14 | 1 << 16 | 1 << 22;
        let ones = |m: u32| -> u8 { m.to_le_bytes().iter().map(|&b| ONES[usize::from(b)]).sum() };
        Self {
            depth,
            code,
            siblings,
            chain: chain.min(3),
            faces: ones(hood.present & FACES),
            around: ones(hood.present) - 1,
            least: 1,
        }
    }
}

/// All adaptive state of a geometry stream.
pub(super) struct Models {
    /// Leaves end at different depths.
    mixed: bool,
    stop: Vec<Bit>,
    tail_stop: Vec<Bit>,
    single: [Vec<Bit>; 2],
    single_mixer: Vec<Mixer<2>>,
    near: Vec<Bit>,
    shape: Vec<Bit>,
    density: Vec<Bit>,
    family: Vec<Bit>,
    mixers: Vec<Mixer<PLAIN>>,
    lattice_mixers: Vec<Mixer<WITH_LATTICE>>,
    pub(super) lattice: Option<Lattice>,
}

impl Models {
    pub(super) fn new(mixed: bool, lattice: bool) -> Self {
        let bits = |n: usize| vec![Bit::default(); n];
        Self {
            mixed,
            stop: bits(32 * 32),
            tail_stop: bits(32),
            single: [bits(32 * 32), bits(256 * 8 * 4)],
            single_mixer: vec![Mixer::new(72_000); 32],
            near: bits(1 << 16),
            shape: bits(256 * 32),
            density: bits(32 * 32 * 32),
            family: bits(256 * 64),
            mixers: vec![Mixer::new(80_000); 8 * 4],
            lattice_mixers: vec![Mixer::new(100_000); if lattice { 8 * 4 } else { 0 }],
            lattice: lattice.then(Lattice::new),
        }
    }

    /// Codes whether a node is a leaf.
    pub(super) fn stop<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        truth: bool,
    ) -> bool {
        let ctx = usize::from(node.depth) * 32
            + usize::from(node.around.min(3)) * 4
            + usize::from(ONES[usize::from(node.siblings)].min(4) - 1);
        self.mixed && self.stop[ctx].code(coder, truth, LIMIT)
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
        let [ta, tb] = &mut self.single;
        let (a, b) = (&mut ta[a], &mut tb[b]);
        let inputs = [stretch(a.p1()), stretch(b.p1())];
        let mixer = &mut self.single_mixer[usize::from(node.depth)];
        let p1 = mixer.mix(&inputs);
        let bit = coder.code(p1, truth);
        mixer.update(&inputs, p1, bit, 2);
        a.update(bit, LIMIT);
        b.update(bit, LIMIT);
        bit
    }

    /// Codes which children of a node are occupied.
    pub(super) fn occupancy<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        cells: &Cells,
        truth: u8,
    ) -> u8 {
        let xyz = self.lattice.as_ref().map(|_| morton::decode(node.code));
        let outside: [usize; 8] = std::array::from_fn(|c| cells.outside(c) << 2);
        // Touching the counters of all eight at once overlaps their cache misses.
        let warm = outside.iter().fold(0, |sum, &o| sum + self.near[o].count());
        std::hint::black_box(warm);
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
            let near = outside[c] | so_far;
            let shape = (1usize << c) | usize::from(occupancy);
            let shape = (shape * 4 + usize::from(node.chain)) * 8 + usize::from(node.faces);
            let density = usize::from(node.depth) * 32 + usize::from(node.around);
            let density = (density * 8 + c) * 4 + so_far;
            let family = (usize::from(node.siblings) * 8 + (node.code & 7) as usize) * 8 + c;
            let near = &mut self.near[near];
            let shape = &mut self.shape[shape];
            let density = &mut self.density[density];
            let family = &mut self.family[family];
            let plain = [
                stretch(near.p1()),
                stretch(shape.p1()),
                stretch(density.p1()),
                stretch(family.p1()),
            ];
            let bit = truth >> c & 1 == 1;
            let select = c * 4 + so_far;
            let bit = match (&mut self.lattice, xyz) {
                (Some(lattice), Some(xyz)) => {
                    let child = [4, 2, 1].map(|b| u32::from(c & b != 0));
                    let at = std::array::from_fn(|k| xyz[k] << 1 | child[k]);
                    let slots = Lattice::slots(u32::from(node.depth) + 1, at);
                    let mut inputs = [0; WITH_LATTICE];
                    inputs[..PLAIN].copy_from_slice(&plain);
                    for (input, &slot) in inputs[PLAIN..].iter_mut().zip(&slots) {
                        *input = stretch(lattice.counter(slot).p1());
                    }
                    let mixer = &mut self.lattice_mixers[select];
                    let p1 = mixer.mix(&inputs);
                    let bit = coder.code(p1, bit);
                    mixer.update(&inputs, p1, bit, 4);
                    slots.iter().for_each(|&s| lattice.counter(s).update(bit, LIMIT));
                    bit
                }
                _ => {
                    let mixer = &mut self.mixers[select];
                    let p1 = mixer.mix(&plain);
                    let bit = coder.code(p1, bit);
                    mixer.update(&plain, p1, bit, 4);
                    bit
                }
            };
            near.update(bit, LIMIT);
            shape.update(bit, LIMIT);
            density.update(bit, LIMIT);
            family.update(bit, LIMIT);
            if bit {
                occupancy |= 1 << c;
                count += 1;
            }
        }
        occupancy
    }
}
