//! What leaves in planes have in common: walls across an axis, and means that were rounded to a
//! lattice.
//!
//! The cells of one depth with the same index along an axis are a *slab*. Leaves in a plane across
//! that axis lie in the same half of every cell of their slab. So each slab counts how often its
//! low and its high half were occupied of late. The two counts are the context of what comes next.

use super::node::{LIMIT, NodeContext};
use crate::coder::Coder;
use crate::model::{Bit, table};
use crate::morton;

/// Slabs for each depth and axis. Greater indices are folded: few chunks reach so far.
const SLABS: usize = 1 << 12;
/// Greatest count.
const MOST: u8 = 7;
/// Number of different pairs of counts.
const STATES: usize = 64;
/// Number of different fits of a child.
pub(super) const FITS: usize = 16;
/// The children in the high half of each axis.
const HIGH: [u8; 3] = [0xf0, 0xcc, 0xaa];

/// How often the low and the high half of a slab were occupied.
#[derive(Clone, Copy, Default)]
struct Counts([u8; 2]);

impl Counts {
    /// Both counts in one number below [`STATES`].
    #[inline]
    fn state(self) -> usize {
        usize::from(self.0[0]) * 8 + usize::from(self.0[1])
    }

    /// Learns which halves are occupied.
    #[inline]
    fn learn(&mut self, occupied: [bool; 2]) {
        for (count, occupied) in self.0.iter_mut().zip(occupied) {
            *count = if occupied { (*count + 1).min(MOST) } else { *count - *count / 2 };
        }
    }
}

/// Where the counts of the slab of the cells at a depth with this index along an axis are.
#[inline]
fn place(depth: u8, axis: usize, index: u32) -> usize {
    (usize::from(depth) * 3 + axis) * SLABS + index as usize % SLABS
}

/// The counts of all slabs, and what is learned of them.
pub(super) struct Slabs {
    counts: Vec<Counts>,
    /// The half of a cell in which a single leaf is, by the counts of the slab.
    half: Box<[Bit; STATES]>,
}

impl Slabs {
    /// The slabs of the cells above the finest, none of them occupied.
    pub(super) fn new(tree_depth: u8) -> Self {
        let counts = vec![Counts::default(); usize::from(tree_depth) * 3 * SLABS];
        Self { counts, half: table() }
    }

    /// The slab of the cells at a depth with this index along an axis.
    #[inline]
    fn slab(&mut self, depth: u8, axis: usize, index: u32) -> &mut Counts {
        &mut self.counts[place(depth, axis, index)]
    }

    /// How well each child of a cell fits the cell's slabs: the number of axes along which only the
    /// other half was occupied, plus four times the number along which only its own was.
    #[inline]
    pub(super) fn fits(&self, depth: u8, cell: [u32; 3]) -> [u8; 8] {
        let mut fits = [0; 8];
        for (axis, high) in HIGH.into_iter().enumerate() {
            let Counts([below, above]) = self.counts[place(depth, axis, cell[axis])];
            for (c, fit) in fits.iter_mut().enumerate() {
                let (own, other) = if high >> c & 1 == 1 { (above, below) } else { (below, above) };
                *fit += u8::from(own == 0 && other > 0) + 4 * u8::from(own > 0 && other == 0);
            }
        }
        fits
    }

    /// Codes the path from a node to its single leaf: each half by what its slab has held.
    pub(super) fn path<C: Coder>(
        &mut self,
        coder: &mut C,
        node: &NodeContext,
        levels: u32,
        value: u64,
    ) -> u64 {
        let mut path = 0;
        let mut cell = morton::decode(node.code);
        for level in 0..levels {
            for (axis, index) in cell.iter_mut().enumerate() {
                let counts = &mut self.counts[place(node.depth + level as u8, axis, *index)];
                let high = value >> (3 * (levels - level) - 1 - axis as u32) & 1 == 1;
                let high = self.half[counts.state() % STATES].code(coder, high, LIMIT);
                counts.learn([!high, high]);
                *index = 2 * *index + u32::from(high);
                path = path << 1 | u64::from(high);
            }
        }
        path
    }

    /// Learns which children of a cell are occupied.
    #[inline]
    pub(super) fn learn(&mut self, depth: u8, cell: [u32; 3], children: u8) {
        for (axis, high) in HIGH.into_iter().enumerate() {
            let occupied = [children & !high != 0, children & high != 0];
            self.slab(depth, axis, cell[axis]).learn(occupied);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall across x, in the high half of its slab: children in that half fit, others do not.
    #[test]
    fn a_wall_is_expected_where_it_goes_on() {
        let mut slabs = Slabs::new(5);
        assert_eq!(slabs.fits(3, [6, 1, 1]), [0; 8]);
        for y in 0..4 {
            slabs.learn(3, [6, y, 2], 0b0101_0000);
        }
        let fits = slabs.fits(3, [6, 100, 100]);
        assert_eq!(fits, [1, 1, 1, 1, 4, 4, 4, 4]);
        assert_eq!(slabs.slab(3, 0, 6).state(), 4);
        // The slab of another depth or another index has learned nothing.
        assert_eq!((slabs.fits(2, [6, 9, 9]), slabs.fits(3, [7, 9, 9])), ([0; 8], [0; 8]));
        // A different node in the slab halves the expectation.
        slabs.learn(3, [6, 50, 50], 0b0000_0001);
        assert_eq!(slabs.slab(3, 0, 6).state(), 8 + 2);
    }

    #[test]
    fn counts_stay_in_range() {
        for occupied in [[true, true], [true, false], [false, true]] {
            let mut counts = Counts::default();
            for _ in 0..100 {
                counts.learn(occupied);
                assert!(counts.state() < STATES);
            }
        }
    }
}
