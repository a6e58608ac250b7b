//! Coding of the columns of one chunk, in both directions by one body.

use super::column::{CELLS, Cell, Map};
use super::layout::{KINDS, MEANS, kind};
use super::neighbours::{NEIGHBOURS, Neighbours};
use super::predictor::Predictor;
use super::residual::{Expect, Models, level};
use gpcc_lite::model::Bit;
use gpcc_lite::range::BinaryCoder;

/// Memory of flags, in observations.
const MEMORY: u32 = 255;

/// How one column is coded; the same in every chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Column {
    pub(super) map: Map,
    pub(super) predictor: Predictor,
    /// Mean level of the errors.
    pub(super) centre: u8,
    /// A value frequent enough to have a flag of its own.
    pub(super) common: Option<u32>,
    /// Some values are escapes.
    pub(super) escapes: bool,
}

/// Adaptive state and the columns coded so far of one chunk.
pub(super) struct Coded {
    /// Cell indices by column.
    pub(super) q: Vec<Vec<i32>>,
    /// Bit patterns by column.
    pub(super) bits: Vec<Vec<u32>>,
    models: Vec<Models>,
    /// Whether the last three columns held their common value, by column modulo 3.
    common: [Vec<bool>; 3],
    /// Slow and fast mean, over columns, of how far a Gaussian's error levels lie above those
    /// of the column; 1/16 levels.
    slow: Vec<i16>,
    fast: Vec<i16>,
    /// Signs of the errors of the last column, -1 to 1.
    signs: Vec<i8>,
    rest: Vec<i32>,
    levels: Vec<u8>,
}

impl Coded {
    pub(super) fn new(rows: usize) -> Self {
        Self {
            q: Vec::new(),
            bits: Vec::new(),
            models: vec![Models::default(); KINDS],
            common: std::array::from_fn(|_| vec![false; rows]),
            slow: vec![0; rows],
            fast: vec![0; rows],
            signs: vec![0; rows],
            rest: Vec::new(),
            levels: Vec::new(),
        }
    }

    /// Codes the next column. The encoder gives its values, the decoder an empty slice.
    /// Returns false if the stream ended early.
    pub(super) fn column<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        column: &Column,
        near: &Neighbours,
        given: &[u32],
    ) -> bool {
        let rows = near.len();
        let c = self.q.len();
        let mut own = Vec::new();
        column.predictor.own(&self.q, &mut own, rows);
        self.rest.clear();
        self.rest.resize(rows, 0);
        self.levels.clear();
        self.levels.resize(rows, column.centre);
        let mut q = vec![0i32; rows];
        let mut bits = vec![0u32; rows];
        let mut tail = Tail::default();
        let mut flags = [Bit::default(); 16];
        let centre = i32::from(column.centre);
        for i in 0..rows {
            if i % 256 == 0 && coder.exhausted() {
                return false;
            }
            let around = &near[i];
            let deviation = i32::from(self.slow[i]);
            if let Some(value) = column.common {
                let here = |row: u32| usize::from(self.common[c % 3][row as usize]);
                // The slot of this column still holds the column three before at this row.
                let context = here(i as u32)
                    | usize::from(self.common[(c + 2) % 3][i]) << 1
                    | here(around[0]) << 2
                    | here(around[1]) << 3;
                let is = flags[context].code(coder, C::ENCODING && given[i] == value, MEMORY);
                self.common[c % 3][i] = is;
                if is {
                    q[i] = stand_in(&column.map, value);
                    bits[i] = value;
                    self.rest[i] = q[i] - own[i];
                    self.levels[i] = (centre + (deviation >> 4)).clamp(0, 120) as u8;
                    self.signs[i] = 0;
                    continue;
                }
            } else {
                self.common[c % 3][i] = false;
            }
            let cell = if C::ENCODING { column.map.split(given[i]) } else { Cell::Escape { q: 0 } };
            if column.escapes {
                let escape = C::ENCODING && matches!(cell, Cell::Escape { .. });
                if tail.escape.code(coder, escape, MEMORY) {
                    bits[i] = coder.code_raw_wide(if C::ENCODING { given[i] } else { 0 }, 32);
                    q[i] = stand_in(&column.map, bits[i]);
                    self.rest[i] = q[i] - own[i];
                    self.levels[i] = (centre + (deviation >> 4)).clamp(0, 120) as u8;
                    self.signs[i] = 0;
                    continue;
                }
            }
            let limit = i64::from(CELLS);
            let predicted = (i64::from(own[i]) + column.predictor.near(&self.rest, around))
                .clamp(-limit, limit - 1) as i32;
            let mut sum = 0;
            for &row in &around[..4] {
                sum += i32::from(self.levels[row as usize]);
            }
            let sign = (self.signs[i] + 1) as usize;
            let expect = Expect {
                near: sum >> 2,
                own: (centre + (deviation >> 4)).max(0),
                last: (centre + (i32::from(self.fast[i]) >> 4)).max(0),
                sign,
            };
            let e = match cell {
                Cell::At { q, .. } | Cell::Tiny { q, .. } | Cell::Escape { q } => q - predicted,
            };
            let e = self.models[kind(c)].code(coder, expect, e);
            q[i] = (predicted + e).clamp(-CELLS, CELLS - 1);
            bits[i] = tail.code(coder, &column.map, q[i], cell);
            self.rest[i] = q[i] - own[i];
            let l = level(e.unsigned_abs());
            self.levels[i] = l as u8;
            self.signs[i] = e.signum() as i8;
            let off = (l - centre) << 4;
            self.slow[i] += ((off - deviation) >> 3) as i16;
            self.fast[i] += ((off - i32::from(self.fast[i])) >> 1) as i16;
        }
        self.q.push(q);
        self.bits.push(bits);
        !coder.exhausted()
    }
}

/// The cell index that stands for a value in predictions.
fn stand_in(map: &Map, bits: u32) -> i32 {
    match map.split(bits) {
        Cell::At { q, .. } | Cell::Tiny { q, .. } | Cell::Escape { q } => q,
    }
}

/// State of what follows a cell index.
#[derive(Clone, Debug)]
pub(super) struct Tail {
    pub(super) escape: Bit,
    tiny: [Bit; 25],
}

impl Default for Tail {
    fn default() -> Self {
        Self { escape: Bit::default(), tiny: [Bit::default(); 25] }
    }
}

impl Tail {
    /// Codes the position inside cell `q`; returns the bit pattern.
    #[inline]
    pub(super) fn code<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        map: &Map,
        q: i32,
        cell: Cell,
    ) -> u32 {
        match map.low_bits(q) {
            Some(0) => map.join(q, 0),
            Some(n) => {
                let low = match cell {
                    Cell::At { low, .. } => low,
                    _ => 0,
                };
                map.join(q, coder.code_raw_wide(low, n))
            }
            None => {
                let (exponent, mantissa) = match cell {
                    Cell::Tiny { exponent, mantissa, .. } => (exponent, mantissa),
                    _ => (0, 0),
                };
                let top = map.tiny_exponent();
                let down = top.saturating_sub(exponent);
                let mut k = 0;
                while k < 24 && k < top && self.tiny[k as usize].code(coder, down > k, MEMORY) {
                    k += 1;
                }
                let exponent = if k == 24 { coder.code_raw(exponent, 8).min(top) } else { top - k };
                map.join(q, 0) | exponent << 23 | coder.code_raw_wide(mantissa, 23)
            }
        }
    }
}

/// Codes the means of one chunk: Morton codes in ascending order as differences, then what is
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

    /// Codes all rows into `coded`. The encoder gives three columns of values.
    pub(super) fn code<C: BinaryCoder>(
        &self,
        coder: &mut C,
        coded: &mut Coded,
        rows: usize,
        given: &[Vec<u32>],
    ) -> bool {
        let map = &self.column.map;
        let mut q = vec![vec![0i32; rows]; MEANS];
        let mut bits = vec![vec![0u32; rows]; MEANS];
        let mut octaves = vec![Bit::default(); 64 * 64];
        let mut leading = vec![Bit::default(); 64 * 8];
        let mut tails: [Tail; 3] = Default::default();
        let mut last = 0u64;
        let mut context = 0u32;
        for i in 0..rows {
            if i % 256 == 0 && coder.exhausted() {
                return false;
            }
            let cells: [Cell; 3] = std::array::from_fn(|a| match given.get(a) {
                Some(column) => map.split(column[i]),
                None => Cell::Escape { q: 0 },
            });
            let at = cells.map(|cell| match cell {
                Cell::At { q, .. } | Cell::Tiny { q, .. } | Cell::Escape { q } => q,
            });
            let key = self.key(at);
            let delta = key.wrapping_sub(last);
            let n = 64 - delta.leading_zeros();
            // The octave of the difference, most significant bit first.
            let mut node = 1usize;
            for k in (0..6).rev() {
                let slot = &mut octaves[(context as usize >> 2) * 64 + node];
                node = 2 * node + usize::from(slot.code(coder, n.min(63) >> k & 1 == 1, 255));
            }
            let n = node as u32 - 64;
            let mut value = u64::from(n > 0);
            let mut left = n.saturating_sub(1);
            let mut node = 1;
            while left > 0 && node < 8 {
                left -= 1;
                let bit = leading[n as usize * 8 + node].code(coder, delta >> left & 1 == 1, 255);
                value = value << 1 | u64::from(bit);
                node = 2 * node + usize::from(bit);
            }
            while left > 0 {
                let step = left.min(16);
                left -= step;
                let raw = coder.code_raw((delta >> left) as u32 & ((1 << step) - 1), step);
                value = value << step | u64::from(raw);
            }
            context = (3 * context + 4 * n.min(63) + 2) >> 2;
            context = context.min(255);
            last = last.wrapping_add(value) & ((1 << 63) - 1);
            let grid = gpcc_lite::morton::decode(last);
            for a in 0..MEANS {
                let offset = (at[a].wrapping_sub(self.least[a])) as u32 & ((1 << self.below) - 1);
                let offset = coder.code_raw(offset, self.below);
                let cell = i64::from(self.least[a]) + i64::from(grid[a] << self.below | offset);
                q[a][i] = cell.clamp(i64::from(-CELLS), i64::from(CELLS) - 1) as i32;
                let escape = C::ENCODING && matches!(cells[a], Cell::Escape { .. });
                bits[a][i] = if self.column.escapes && tails[a].escape.code(coder, escape, 255) {
                    coder.code_raw_wide(given.get(a).map_or(0, |column| column[i]), 32)
                } else {
                    tails[a].code(coder, map, q[a][i], cells[a])
                };
            }
        }
        coded.q.extend(q);
        coded.bits.extend(bits);
        !coder.exhausted()
    }
}

/// Neighbours that count when there are fewer rows than neighbours.
const _: () = assert!(NEIGHBOURS >= 4);
