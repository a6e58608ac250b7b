//! Coding of all columns but the means of one part, row by row, in both directions by one body.

use super::column::{CELLS, Cell};
use super::layout::{KINDS, MEANS, kind};
use super::local::{self, Local};
use super::neighbours::{NEIGHBOURS, NearRows};
use super::predictor::NEIGHBOUR_BITS;
use super::residual::{Expect, Models, level};
use super::tail::{MEMORY, Tail};
use super::{Column, PartBits};
use gpcc_lite::coder::Coder;
use gpcc_lite::model::Bit;

/// Neighbours whose error levels are looked at.
const LEVEL_NEIGHBOURS: usize = 4;

/// Codes all columns but the means of a part whose means are coded. The encoder gives the rows, the
/// decoder an empty slice. Returns false if the stream ended early.
pub(super) fn code<C: Coder>(
    coder: &mut C,
    columns: &[Column],
    near: &NearRows,
    given: &[u32],
    coded: &mut PartBits,
) -> bool {
    let width = columns.len();
    let mut rows = Rows::new(columns, near, given);
    for i in 0..near.len() {
        if i % 64 == 0 && coder.exhausted() {
            return false;
        }
        rows.look_around(i);
        for a in 0..MEANS {
            rows.q[a] = coded.means[a][i];
        }
        let mut trend = Trend::default();
        for c in 0..width - MEANS {
            coded.bits[i * width + MEANS + c] = rows.value(coder, i, c, &mut trend);
        }
        rows.covariance.end_row();
    }
    !coder.exhausted()
}

/// How far the error levels of a Gaussian lie above those of the columns, in 1/16 levels.
#[derive(Default)]
struct Trend {
    /// Over all columns so far.
    slow: i32,
    /// Over the last columns.
    fast: i32,
    /// Sign of the last error.
    sign: i32,
}

/// The state of the coder. Column 0 is the first that is not a mean.
struct Rows<'a> {
    columns: &'a [Column],
    near: &'a NearRows,
    given: &'a [u32],
    models: Vec<Models>,
    tails: Vec<Tail>,
    flags: Vec<[Bit; 16]>,
    covariance: Local,
    near_weights: Vec<i64>,
    /// Per Gaussian and column: what the prediction from its own earlier columns leaves.
    rests: Vec<i32>,
    /// Per Gaussian and column: the error level.
    levels: Vec<u8>,
    /// Per Gaussian and column: the column's common value or not.
    commons: Vec<bool>,
    /// Cell indices of the current Gaussian, means included.
    q: Vec<i32>,
    /// Weighted sums of the neighbours' `rests`, by column.
    near_rests: Vec<i64>,
    /// Sums of the neighbours' `levels`, by column.
    near_levels: Vec<i32>,
}

/// A value that is about to be coded: column `c` of Gaussian `i`, what the columns before it predict, and what the
/// neighbours say of that prediction.
#[derive(Clone, Copy)]
struct Place {
    i: usize,
    c: usize,
    own: i32,
    expected: i32,
}

impl<'a> Rows<'a> {
    fn new(columns: &'a [Column], near: &'a NearRows, given: &'a [u32]) -> Self {
        let n = columns.len() - MEANS;
        let weights = (0..NEIGHBOURS)
            .flat_map(|k| columns[MEANS..].iter().map(move |c| i64::from(c.predictor.near[k])));
        let mut levels = vec![0u8; near.len() * n];
        // Row 0 is its own neighbour.
        for (level, column) in levels.iter_mut().zip(&columns[MEANS..]) {
            *level = column.centre;
        }
        Self {
            columns,
            near,
            given,
            models: vec![Models::default(); KINDS],
            tails: vec![Tail::default(); n],
            flags: vec![[Bit::default(); 16]; n],
            covariance: Local::new(n),
            near_weights: weights.collect(),
            rests: vec![0; near.len() * n],
            levels,
            commons: vec![false; near.len() * n],
            q: vec![0; columns.len()],
            near_rests: vec![0; n],
            near_levels: vec![0; n],
        }
    }

    /// Columns that are not means.
    #[inline]
    fn width(&self) -> usize {
        self.columns.len() - MEANS
    }

    /// Sums what is known of the neighbours of Gaussian `i`.
    #[inline]
    fn look_around(&mut self, i: usize) {
        let n = self.width();
        self.near_rests.fill(0);
        self.near_levels.fill(0);
        for (k, &row) in self.near[i].iter().enumerate() {
            let at = row as usize * n;
            let row = &self.rests[at..at + n];
            let weights = &self.near_weights[k * n..(k + 1) * n];
            for ((sum, &rest), &weight) in self.near_rests.iter_mut().zip(row).zip(weights) {
                *sum += weight * i64::from(rest);
            }
            if k < LEVEL_NEIGHBOURS {
                for (sum, &l) in self.near_levels.iter_mut().zip(&self.levels[at..at + n]) {
                    *sum += i32::from(l);
                }
            }
        }
    }

    /// Codes column `c` of Gaussian `i`; returns the bit pattern.
    #[inline]
    fn value<C: Coder>(&mut self, coder: &mut C, i: usize, c: usize, trend: &mut Trend) -> u32 {
        let column = &self.columns[MEANS + c];
        let value = if C::ENCODING { self.given[i * self.columns.len() + MEANS + c] } else { 0 };
        let own = column.predictor.own(&self.q);
        let place = Place { i, c, own, expected: self.covariance.predict(c) };
        if let Some(common) = column.common {
            let context = self.common_context(i, c);
            let is = self.flags[c][context].code(coder, C::ENCODING && value == common, MEMORY);
            let at = i * self.width() + c;
            self.commons[at] = is;
            if is {
                self.set_without_prediction(place, common, trend);
                return common;
            }
        }
        let cell = if C::ENCODING { column.map.split(value) } else { Cell::Escape { q: 0 } };
        if column.escapes {
            let escape = C::ENCODING && matches!(cell, Cell::Escape { .. });
            if self.tails[c].escape.code(coder, escape, MEMORY) {
                let bits = coder.bits(value, 32);
                self.set_without_prediction(place, bits, trend);
                return bits;
            }
        }
        let q = self.predicted_cell(coder, place, cell, trend);
        self.tails[c].code(coder, &column.map, q, cell)
    }

    /// Which of the columns before and of the neighbours have their common value.
    #[inline]
    fn common_context(&self, i: usize, c: usize) -> usize {
        let n = self.width();
        let before = |k: usize| usize::from(c >= k && self.commons[i * n + c - k]);
        let beside = |k: usize| usize::from(self.commons[self.near[i][k] as usize * n + c]);
        before(3) | before(1) << 1 | beside(0) << 2 | beside(1) << 3
    }

    /// Takes note of a value that is coded without prediction.
    #[inline]
    fn set_without_prediction(&mut self, place: Place, bits: u32, trend: &mut Trend) {
        let Place { i, c, own, expected } = place;
        let at = i * self.width() + c;
        let column = &self.columns[MEANS + c];
        self.q[MEANS + c] = column.map.stand_in(bits);
        self.rests[at] = self.q[MEANS + c] - own;
        let neutral = (i32::from(column.centre) + (trend.slow >> 4)).clamp(0, 120);
        self.levels[at] = neutral as u8;
        self.covariance.set(c, 0, expected, None);
        trend.sign = 0;
    }

    /// Codes a cell index as its difference from the prediction.
    #[inline]
    fn predicted_cell<C: Coder>(
        &mut self,
        coder: &mut C,
        place: Place,
        cell: Cell,
        trend: &mut Trend,
    ) -> i32 {
        let Place { i, c, own, expected } = place;
        let at = i * self.width() + c;
        let column = &self.columns[MEANS + c];
        let centre = i32::from(column.centre);
        let limit = i64::from(CELLS);
        let scale = u32::from(column.centre >> 2).saturating_sub(1);
        let global = i64::from(own) + (self.near_rests[c] >> NEIGHBOUR_BITS);
        let predicted = (global + local::unscale(expected, scale)).clamp(-limit, limit - 1) as i32;
        let expect = Expect {
            near: self.near_levels[c] >> 2,
            own: (centre + (trend.slow >> 4)).max(0),
            last: (centre + (trend.fast >> 4)).max(0),
            sign: (trend.sign + 1) as usize,
        };
        let e = self.models[kind(MEANS + c)].code(coder, expect, cell.q() - predicted);
        let q = (predicted + e).clamp(-CELLS, CELLS - 1);
        self.q[MEANS + c] = q;
        self.rests[at] = q - own;
        self.covariance.set(c, scale, expected, Some(i64::from(q) - global));
        let l = level(e.unsigned_abs());
        self.levels[at] = l as u8;
        trend.sign = e.signum();
        let off = (l - centre) << 4;
        trend.slow += (off - trend.slow) >> 3;
        trend.fast += (off - trend.fast) >> 1;
        q
    }
}
