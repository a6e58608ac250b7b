//! From levels to differences of means.

use super::{Head, strengths};
use crate::coeffs::{Levels, RowCoder, code_dc, places};
use crate::context::{CHUNK, chunk_sizes};
use crate::raht::{Lanes, Plan, Residual};
use crate::range::{BinaryCoder, RangeDecoder};

/// Where levels come from.
pub(super) trait Source {
    /// Whether means are wanted, as in [`Residual`].
    const MEANS: bool = false;

    fn start_level(&mut self, depth: usize);

    /// Fills in the levels of coefficient `k`; false if all are zero, and then `levels` may be
    /// anything.
    fn levels(&mut self, plan: &Plan, k: usize, mean: f32, levels: &mut [Levels]) -> bool;
}

/// Levels out of a range-coded stream, as they are needed.
pub(super) struct Ranged<'a, const BY_SYMBOLS: bool> {
    coder: RangeDecoder<'a>,
    rows: RowCoder<BY_SYMBOLS>,
    channels: usize,
}

impl<'a, const BY_SYMBOLS: bool> Ranged<'a, BY_SYMBOLS> {
    pub(super) fn new(plan: &Plan, coder: RangeDecoder<'a>, channels: usize) -> Self {
        Self { coder, rows: RowCoder::new(plan.len(), channels), channels }
    }

    /// The levels of coefficient 0, which come first.
    pub(super) fn dc(&mut self, points: usize) -> Vec<Levels> {
        let mut levels = vec![[0; CHUNK]; chunk_sizes(self.channels).len()];
        if points > 0 {
            code_dc(&mut self.coder, self.channels, &mut levels);
        }
        levels
    }

    pub(super) fn exhausted(&self) -> bool {
        self.coder.exhausted()
    }
}

impl<const BY_SYMBOLS: bool> Source for Ranged<'_, BY_SYMBOLS> {
    fn start_level(&mut self, depth: usize) {
        self.rows.start_level(depth);
    }

    #[inline]
    fn levels(&mut self, plan: &Plan, k: usize, _: f32, levels: &mut [Levels]) -> bool {
        let at = (plan.parents()[k - 1], plan.axes()[k - 1]);
        !self.coder.exhausted() && self.rows.code(&mut self.coder, k, at, levels)
    }
}

/// Levels that are all there, channel by channel.
pub(super) struct Planar {
    channels: Vec<Vec<i32>>,
    places: Vec<(usize, usize)>,
}

impl Planar {
    pub(super) fn new(channels: Vec<Vec<i32>>) -> Self {
        let places = places(channels.len()).collect();
        Self { channels, places }
    }

    /// The levels of coefficient 0.
    pub(super) fn dc(&self) -> Vec<Levels> {
        let mut levels = vec![[0; CHUNK]; chunk_sizes(self.channels.len()).len()];
        for (c, (chunk, i)) in self.channels.iter().zip(places(self.channels.len())) {
            levels[chunk][i] = c.first().copied().unwrap_or(0);
        }
        levels
    }
}

impl Source for Planar {
    fn start_level(&mut self, _: usize) {}

    #[inline]
    fn levels(&mut self, _: &Plan, k: usize, _: f32, levels: &mut [Levels]) -> bool {
        let mut any = 0;
        for (c, &(chunk, i)) in self.channels.iter().zip(&self.places) {
            levels[chunk][i] = c[k];
            any |= c[k];
        }
        any != 0
    }
}

/// Turns levels into differences.
pub(super) struct Dequantiser<'a, S> {
    plan: &'a Plan,
    heads: &'a [Head],
    pub(super) inner: S,
    levels: Vec<Levels>,
    units: Units,
    strength: Vec<Lanes>,
}

/// Steps and centroid shifts of all channels, chunk by chunk.
pub(super) struct Units(Vec<[Unit; CHUNK]>);

#[derive(Clone, Copy, Default)]
struct Unit {
    step: f32,
    /// Of magnitudes 0, 1, 2 and above, in steps.
    shift: [f32; 4],
}

impl Units {
    pub(super) fn new(heads: &[Head]) -> Self {
        let mut units = vec![[Unit::default(); CHUNK]; chunk_sizes(heads.len()).len()];
        for (head, (chunk, i)) in heads.iter().zip(places(heads.len())) {
            let shift = [0, 1, 2, 3].map(|m| head.centroids.of(m) as f32 / 256.0);
            units[chunk][i] = Unit { step: head.step.value() as f32, shift };
        }
        Self(units)
    }

    /// The differences of one coefficient, on every bit of which encoder and decoder must agree:
    /// `row` becomes the differences of `levels` (where `some` is not zero) on top of `predicted`,
    /// which is empty or has one entry per chunk; false if all are zero, and `row` is as it was.
    #[inline]
    pub(super) fn differences(
        &self,
        some: bool,
        levels: &[Levels],
        scale: f32,
        predicted: &[Lanes],
        row: &mut [Lanes],
    ) -> bool {
        if some {
            self.dequantise(levels, scale, row);
            for (row, p) in row.iter_mut().zip(predicted) {
                for i in 0..CHUNK {
                    row[i] += p[i];
                }
            }
        } else if !predicted.is_empty() {
            row.copy_from_slice(predicted);
        }
        some || !predicted.is_empty()
    }

    /// The differences of levels, in units of a merge of the given scale.
    #[inline]
    fn dequantise(&self, levels: &[Levels], scale: f32, out: &mut [Lanes]) {
        for ((levels, out), units) in levels.iter().zip(out).zip(&self.0) {
            *out = [0.0; CHUNK];
            if *levels == [0; CHUNK] {
                continue;
            }
            for i in 0..CHUNK {
                let (q, unit) = (levels[i], &units[i]);
                let magnitude = q.unsigned_abs();
                let steps = magnitude as f32 - unit.shift[magnitude.min(3) as usize];
                let d = (steps * unit.step) * scale;
                out[i] = if q < 0 { -d } else { d };
            }
        }
    }
}

impl<'a, S: Source> Dequantiser<'a, S> {
    pub(super) fn new(plan: &'a Plan, heads: &'a [Head], inner: S) -> Self {
        let width = chunk_sizes(heads.len()).len();
        Self {
            plan,
            heads,
            inner,
            levels: vec![[0; CHUNK]; width],
            units: Units::new(heads),
            strength: vec![[0.0; CHUNK]; width],
        }
    }
}

impl<S: Source> Residual for Dequantiser<'_, S> {
    const STORED: bool = false;
    const MEANS: bool = S::MEANS;

    fn start_level(&mut self, depth: usize) -> Option<&[Lanes]> {
        self.inner.start_level(depth);
        strengths(self.heads, depth, &mut self.strength).then_some(&self.strength)
    }

    #[inline]
    fn differences(&mut self, k: usize, mean: f32, predicted: &[Lanes], row: &mut [Lanes]) -> bool {
        let some = self.inner.levels(self.plan, k, mean, &mut self.levels);
        self.units.differences(some, &self.levels, self.plan.scale_of(k), predicted, row)
    }
}
