//! What is known of the cells, of the size of a child, around a node.

use crate::hood::{all_cells_of, cells_of};

/// For child `c` and the eight cells at its corner, `4 x + 2 y + z` of the corner: which of the
/// seven outside the node are set, in the order z, y, yz, x, xz, xy, xyz of the axes along which
/// they are outside.
const MIRROR: [[u8; 256]; 8] = {
    let mut t = [[0u8; 256]; 8];
    let mut c = 0;
    while c < 8 {
        let mut cells = 0;
        while cells < 256 {
            let mut outside = 1;
            while outside < 8 {
                // At the low side of an axis outside is cell 0 of the corner, else cell 1.
                let at = outside ^ (7 - c);
                if cells >> at & 1 == 1 {
                    t[c][cells] |= 1 << (outside - 1);
                }
                outside += 1;
            }
            cells += 1;
        }
        c += 1;
    }
    t
};

/// States of the cells of a block in two bits: 0 outside any node, 1 in a node not yet coded,
/// 2 empty, 3 occupied.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cells {
    high: u64,
    low: u64,
}

impl Cells {
    /// Adds the neighbour at bit `place` of the window, whose children are known.
    #[inline]
    pub(super) fn add_coded(&mut self, place: usize, mask: u8) {
        self.high |= all_cells_of(place);
        self.low |= cells_of(place, mask);
    }

    /// Adds a neighbour that is not coded yet.
    #[inline]
    pub(super) fn add_later(&mut self, place: usize) {
        self.low |= all_cells_of(place);
    }

    /// States of the seven cells outside that touch child `c`, in 14 bits: the high bits of all
    /// seven, then the low bits.
    #[inline]
    pub(super) fn outside(self, c: usize) -> u16 {
        let corner = |cells: u64| -> u16 {
            // The corner's eight cells are at bits 0, 1, 4, 5, 16, 17, 20, 21.
            let w = cells >> (32 * (c >> 2 & 1) + 8 * (c >> 1 & 1) + 2 * (c & 1));
            let w = w as u32;
            let w = (w & 0x0003_0003) | ((w & 0x0030_0030) >> 2);
            u16::from(MIRROR[c & 7][(w | w >> 12) as usize & 255])
        };
        corner(self.high) << 7 | corner(self.low)
    }
}
