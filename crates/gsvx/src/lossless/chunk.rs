//! Coding of the columns of one chunk, in both directions by one body.

use super::column::{CELLS, Cell, Map};
use super::layout::{KINDS, MEANS, kind};
use super::local::{self, Local};
use super::neighbours::{NEIGHBOURS, Neighbours};
use super::predictor::{NEIGHBOUR_BITS, Predictor};
use super::residual::{Expect, Models, level};
use gpcc_lite::coder::Coder;
use gpcc_lite::model::Bit;

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

/// What a decoded chunk is made of.
#[derive(Debug, Default)]
pub(super) struct Coded {
    /// Cell indices of the means, by column.
    pub(super) means: Vec<Vec<i32>>,
    /// Bit patterns, one row of all columns per Gaussian.
    pub(super) bits: Vec<u32>,
}

/// Codes all columns but the means of a chunk whose means are coded, row by row. The encoder
/// gives the rows, the decoder an empty slice. Returns false if the stream ended early.
pub(super) fn rows<C: Coder>(
    coder: &mut C,
    columns: &[Column],
    near: &Neighbours,
    given: &[u32],
    coded: &mut Coded,
) -> bool {
    let width = columns.len();
    let n = width - MEANS;
    let mut models = vec![Models::default(); KINDS];
    let mut tails = vec![Tail::default(); n];
    let mut flags = vec![[Bit::default(); 16]; n];
    let mut covariance = Local::new(n);
    let near_weights: Vec<i64> = (0..NEIGHBOURS)
        .flat_map(|k| columns[MEANS..].iter().map(move |c| i64::from(c.predictor.near[k])))
        .collect();
    // Per Gaussian and column: what the own part leaves, error level, common value or not.
    let mut rests = vec![0i32; near.len() * n];
    let mut levels = vec![0u8; near.len() * n];
    let mut commons = vec![false; near.len() * n];
    let mut q = vec![0i32; width];
    let mut nearby = vec![0i64; n];
    let mut near_levels = vec![0i32; n];
    let limit = i64::from(CELLS);
    for (i, around) in near.iter().enumerate() {
        if i % 64 == 0 && coder.exhausted() {
            return false;
        }
        if i == 0 {
            for (l, column) in levels[..n].iter_mut().zip(&columns[MEANS..]) {
                *l = column.centre;
            }
        }
        nearby.fill(0);
        near_levels.fill(0);
        for (k, &row) in around.iter().enumerate() {
            let at = row as usize * n;
            let row = &rests[at..at + n];
            let weights = &near_weights[k * n..(k + 1) * n];
            for ((sum, &rest), &weight) in nearby.iter_mut().zip(row).zip(weights) {
                *sum += weight * i64::from(rest);
            }
            if k < 4 {
                for (sum, &l) in near_levels.iter_mut().zip(&levels[at..at + n]) {
                    *sum += i32::from(l);
                }
            }
        }
        for a in 0..MEANS {
            q[a] = coded.means[a][i];
        }
        // How far the error levels of this Gaussian lie above those of the columns; 1/16 levels.
        let (mut slow, mut fast, mut sign) = (0i32, 0i32, 0i32);
        for c in 0..n {
            let column = &columns[MEANS + c];
            let at = i * n + c;
            let value = if C::ENCODING { given[i * width + MEANS + c] } else { 0 };
            let centre = i32::from(column.centre);
            let neutral = (centre + (slow >> 4)).clamp(0, 120);
            let own = column.predictor.own(&q);
            let expected = covariance.predict(c);
            if let Some(common) = column.common {
                let before = |k: usize| usize::from(c >= k && commons[at - k]);
                let beside = |k: usize| usize::from(commons[around[k] as usize * n + c]);
                let context = before(3) | before(1) << 1 | beside(0) << 2 | beside(1) << 3;
                let is = flags[c][context].code(coder, C::ENCODING && value == common, MEMORY);
                commons[at] = is;
                if is {
                    q[MEANS + c] = column.map.stand_in(common);
                    coded.bits[i * width + MEANS + c] = common;
                    rests[at] = q[MEANS + c] - own;
                    levels[at] = neutral as u8;
                    covariance.set(c, 0, expected, None);
                    sign = 0;
                    continue;
                }
            }
            let cell = if C::ENCODING { column.map.split(value) } else { Cell::Escape { q: 0 } };
            if column.escapes {
                let escape = C::ENCODING && matches!(cell, Cell::Escape { .. });
                if tails[c].escape.code(coder, escape, MEMORY) {
                    let bits = coder.bits(value, 32);
                    coded.bits[i * width + MEANS + c] = bits;
                    q[MEANS + c] = column.map.stand_in(bits);
                    rests[at] = q[MEANS + c] - own;
                    levels[at] = neutral as u8;
                    covariance.set(c, 0, expected, None);
                    sign = 0;
                    continue;
                }
            }
            let scale = u32::from(column.centre >> 2).saturating_sub(1);
            let global = i64::from(own) + (nearby[c] >> NEIGHBOUR_BITS);
            let predicted =
                (global + local::unscale(expected, scale)).clamp(-limit, limit - 1) as i32;
            let expect = Expect {
                near: near_levels[c] >> 2,
                own: (centre + (slow >> 4)).max(0),
                last: (centre + (fast >> 4)).max(0),
                sign: (sign + 1) as usize,
            };
            let e = match cell {
                Cell::At { q, .. } | Cell::Tiny { q, .. } | Cell::Escape { q } => q - predicted,
            };
            let e = models[kind(MEANS + c)].code(coder, expect, e);
            let here = (predicted + e).clamp(-CELLS, CELLS - 1);
            q[MEANS + c] = here;
            coded.bits[i * width + MEANS + c] = tails[c].code(coder, &column.map, here, cell);
            rests[at] = here - own;
            covariance.set(c, scale, expected, Some(i64::from(here) - global));
            let l = level(e.unsigned_abs());
            levels[at] = l as u8;
            sign = e.signum();
            let off = (l - centre) << 4;
            slow += (off - slow) >> 3;
            fast += (off - fast) >> 1;
        }
        covariance.end_row();
    }
    !coder.exhausted()
}

/// State of what follows a cell index.
#[derive(Clone, Debug, Default)]
pub(super) struct Tail {
    pub(super) escape: Bit,
    tiny: [Bit; 25],
}

impl Tail {
    /// Codes the position inside cell `q`; returns the bit pattern.
    #[inline]
    pub(super) fn code<C: Coder>(&mut self, coder: &mut C, map: &Map, q: i32, cell: Cell) -> u32 {
        match map.low_bits(q) {
            Some(0) => map.join(q, 0),
            Some(n) => {
                let low = match cell {
                    Cell::At { low, .. } => low,
                    _ => 0,
                };
                map.join(q, coder.bits(low, n))
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
                let exponent = if k == 24 { coder.bits(exponent, 8).min(top) } else { top - k };
                map.join(q, 0) | exponent << 23 | coder.bits(mantissa, 23)
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
    pub(super) fn code<C: Coder>(
        &self,
        coder: &mut C,
        coded: &mut Coded,
        rows: usize,
        width: usize,
        given: &[u32],
    ) -> bool {
        let map = &self.column.map;
        let mut q = vec![vec![0i32; rows]; MEANS];
        let mut octaves = vec![Bit::default(); 64 * 64];
        let mut leading = vec![Bit::default(); 64 * 8];
        let mut tails: [Tail; 3] = Default::default();
        let mut last = 0u64;
        let mut context = 0u32;
        for i in 0..rows {
            if i % 256 == 0 && coder.exhausted() {
                return false;
            }
            let cells: [Cell; 3] = std::array::from_fn(|a| match given.get(i * width + a) {
                Some(&v) => map.split(v),
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
                let raw = coder.bits((delta >> left) as u32 & ((1 << step) - 1), step);
                value = value << step | u64::from(raw);
            }
            context = (3 * context + 4 * n.min(63) + 2) >> 2;
            context = context.min(255);
            last = last.wrapping_add(value) & ((1 << 63) - 1);
            let grid = gpcc_lite::morton::decode(last);
            for a in 0..MEANS {
                let offset = (at[a].wrapping_sub(self.least[a])) as u32 & ((1 << self.below) - 1);
                let offset = coder.bits(offset, self.below);
                let cell = i64::from(self.least[a]) + i64::from(grid[a] << self.below | offset);
                q[a][i] = cell.clamp(i64::from(-CELLS), i64::from(CELLS) - 1) as i32;
                let escape = C::ENCODING && matches!(cells[a], Cell::Escape { .. });
                coded.bits[i * width + a] =
                    if self.column.escapes && tails[a].escape.code(coder, escape, 255) {
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
