//! The 4x4x4 cells, of the size of a child, around and in a node.

use crate::hood::{CENTRE, Children, Hood};

/// Bit of cell `(x, y, z)`, each 0 to 3; the node is 1 and 2.
const fn cell(x: usize, y: usize, z: usize) -> u8 {
    (16 * x + 4 * y + z) as u8
}

/// For neighbour `n`: all its cells that touch the node, and which cell each child takes (64 for
/// children that do not touch).
const TOUCHING: [(u64, [u8; 8]); 27] = {
    let mut t = [(0u64, [64u8; 8]); 27];
    let mut n = 0;
    while n < 27 {
        let d = [n / 9, n / 3 % 3, n % 3];
        let mut c = 0;
        while c < 8 && n != CENTRE {
            let b = [c >> 2 & 1, c >> 1 & 1, c & 1];
            // Cells -2..3 along an axis; the node is 0 and 1; kept: -1..2.
            let x = 2 * d[0] + b[0];
            let y = 2 * d[1] + b[1];
            let z = 2 * d[2] + b[2];
            if x >= 1 && x <= 4 && y >= 1 && y <= 4 && z >= 1 && z <= 4 {
                let at = cell(x - 1, y - 1, z - 1);
                t[n].0 |= 1 << at;
                t[n].1[c] = at;
            }
            c += 1;
        }
        n += 1;
    }
    t
};

/// The seven cells outside the node that touch child `c` at its corner: faces, edges, corner.
const OUTSIDE: [[u8; 7]; 8] = {
    let mut t = [[0u8; 7]; 8];
    let mut c = 0;
    while c < 8 {
        let b = [c >> 2 & 1, c >> 1 & 1, c & 1];
        let order = [4, 2, 1, 6, 5, 3, 7];
        let mut i = 0;
        while i < 7 {
            let mut xyz = [0usize; 3];
            let mut k = 0;
            while k < 3 {
                let out = order[i] >> (2 - k) & 1;
                xyz[k] = if out == 0 {
                    b[k] + 1
                } else if b[k] == 1 {
                    3
                } else {
                    0
                };
                k += 1;
            }
            t[c][i] = cell(xyz[0], xyz[1], xyz[2]);
            i += 1;
        }
        c += 1;
    }
    t
};

/// States of the cells around a node in two bits: 0 outside any node, 1 in a node not yet coded,
/// 2 empty, 3 occupied.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cells {
    high: u64,
    low: u64,
}

impl Cells {
    /// `children` is known for the nodes before `at`.
    pub(super) fn around(hood: &Hood, children: &[Children], at: usize) -> Self {
        let mut cells = Self { high: 0, low: 0 };
        let mut rest = hood.present & !(1 << CENTRE);
        while rest != 0 {
            let n = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let i = hood.index[n] as usize;
            let (all, place) = &TOUCHING[n];
            if i > at {
                cells.low |= all;
                continue;
            }
            cells.high |= all;
            let mut occupied = children[i].mask;
            while occupied != 0 {
                let c = occupied.trailing_zeros() as usize;
                occupied &= occupied - 1;
                if place[c] < 64 {
                    cells.low |= 1 << place[c];
                }
            }
        }
        cells
    }

    /// States of the seven cells outside that touch child `c`, in 14 bits.
    #[inline]
    pub(super) fn outside(&self, c: usize) -> usize {
        let mut state = 0usize;
        if self.high | self.low != 0 {
            for &o in &OUTSIDE[c] {
                let two = (self.high >> o & 1) << 1 | (self.low >> o & 1);
                state = state << 2 | two as usize;
            }
        }
        state
    }
}
