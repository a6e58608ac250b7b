//! Coding of the means of one part, in both directions by one body.

use super::column::{CELLS, Cell};
use super::layout::MEANS;
use super::tail::{MEMORY, Tail};
use super::{Column, PartBits};
use gpcc_lite::coder::Coder;
use gpcc_lite::model::Bit;

/// Codes the means of one part: Morton codes in ascending order as differences, then what is
/// left of each coordinate.
pub(super) struct Means<'a> {
    /// The grid all three share.
    pub(super) column: &'a Column,
    /// Least cell index per axis.
    pub(super) least: [i32; 3],
    /// Bits of a coordinate below the Morton code's 21.
    pub(super) below: u32,
}

impl Means<'_> {
    /// The Morton code of a mean's cells.
    pub(super) fn key(&self, q: [i32; 3]) -> u64 {
        let g = std::array::from_fn(|a| {
            (q[a].saturating_sub(self.least[a]).max(0) as u32 >> self.below).min((1 << 21) - 1)
        });
        gpcc_lite::morton::encode(g)
    }

    /// Codes all rows into `coded`. The encoder gives rows of all columns, the decoder an empty slice.
    /// Returns false if the stream ended early.
    pub(super) fn code<C: Coder>(
        &self,
        coder: &mut C,
        coded: &mut PartBits,
        rows: usize,
        width: usize,
        given: &[u32],
    ) -> bool {
        let map = &self.column.map;
        let mut q = vec![vec![0i32; rows]; MEANS];
        let mut tails: [Tail; 3] = Default::default();
        let mut codes = Codes::default();
        for i in 0..rows {
            if i % 256 == 0 && coder.exhausted() {
                return false;
            }
            let cells: [Cell; 3] = std::array::from_fn(|a| match given.get(i * width + a) {
                Some(&v) => map.split(v),
                None => Cell::Escape { q: 0 },
            });
            let at = cells.map(Cell::q);
            let grid = gpcc_lite::morton::decode(codes.next(coder, self.key(at)));
            for a in 0..MEANS {
                let offset = (at[a].wrapping_sub(self.least[a])) as u32 & ((1 << self.below) - 1);
                let offset = coder.bits(offset, self.below);
                let cell = i64::from(self.least[a]) + i64::from(grid[a] << self.below | offset);
                q[a][i] = cell.clamp(i64::from(-CELLS), i64::from(CELLS) - 1) as i32;
                let escape = C::ENCODING && matches!(cells[a], Cell::Escape { .. });
                coded.bits[i * width + a] =
                    if self.column.escapes && tails[a].escape.code(coder, escape, MEMORY) {
                        coder.bits(given.get(i * width + a).copied().unwrap_or(0), 32)
                    } else {
                        tails[a].code(coder, map, q[a][i], cells[a])
                    };
            }
        }
        coded.means = q;
        !coder.exhausted()
    }
}

/// The coder of ascending Morton codes.
struct Codes {
    /// Models of the octave of a difference, most significant bit first.
    octaves: Vec<Bit>,
    /// Models of the bits behind the leading one.
    leading: Vec<Bit>,
    /// The last code.
    last: u64,
    /// A fading mean of the octaves, in quarters.
    context: u32,
}

impl Default for Codes {
    fn default() -> Self {
        let (octaves, leading) = (vec![Bit::default(); 64 * 64], vec![Bit::default(); 64 * 8]);
        Self { octaves, leading, last: 0, context: 0 }
    }
}

impl Codes {
    /// Codes the next code; a decoder gives any `key`.
    fn next<C: Coder>(&mut self, coder: &mut C, key: u64) -> u64 {
        let delta = key.wrapping_sub(self.last);
        let n = 64 - delta.leading_zeros();
        let mut node = 1usize;
        for k in (0..6).rev() {
            let slot = &mut self.octaves[(self.context as usize >> 2) * 64 + node];
            node = 2 * node + usize::from(slot.code(coder, n.min(63) >> k & 1 == 1, MEMORY));
        }
        let n = node as u32 - 64;
        let mut value = u64::from(n > 0);
        let mut left = n.saturating_sub(1);
        let mut node = 1;
        while left > 0 && node < 8 {
            left -= 1;
            let slot = &mut self.leading[n as usize * 8 + node];
            let bit = slot.code(coder, delta >> left & 1 == 1, MEMORY);
            value = value << 1 | u64::from(bit);
            node = 2 * node + usize::from(bit);
        }
        while left > 0 {
            let step = left.min(16);
            left -= step;
            let raw = coder.bits((delta >> left) as u32 & ((1 << step) - 1), step);
            value = value << step | u64::from(raw);
        }
        self.context = ((3 * self.context + 4 * n.min(63) + 2) >> 2).min(255);
        self.last = self.last.wrapping_add(value) & ((1 << 63) - 1);
        self.last
    }
}
