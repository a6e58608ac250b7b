//! From levels to differences of means.

use super::{Head, strengths};
use crate::coeffs::{Levels, RowCoder, code_dc, places};
use crate::context::{CHUNK, chunk_sizes};
use crate::raht::{Lanes, Plan, Residual};
use crate::range::BinaryCoder;
use crate::symbol_coder::SymbolDecoder;

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
    coder: SymbolDecoder<'a>,
    rows: RowCoder<BY_SYMBOLS>,
    channels: usize,
}

impl<'a, const BY_SYMBOLS: bool> Ranged<'a, BY_SYMBOLS> {
    pub(super) fn new(plan: &Plan, coder: SymbolDecoder<'a>, channels: usize, period: u8) -> Self {
        Self { coder, rows: RowCoder::new(plan.len(), channels, period), channels }
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
    /// The levels of [`TURNED`] coefficients from `first` on, coefficient by coefficient, and which
    /// of them are not all zero.
    turned: Vec<Levels>,
    some: [bool; TURNED],
    first: usize,
}

/// Coefficients whose levels are turned at a time: a line of cache of each channel. Channels one by
/// one for each coefficient would be more places in memory than a cache keeps apart.
const TURNED: usize = 16;

impl Planar {
    pub(super) fn new(channels: Vec<Vec<i32>>) -> Self {
        let places = places(channels.len()).collect();
        let turned = vec![[0; CHUNK]; TURNED * chunk_sizes(channels.len()).len()];
        let mut this = Self { channels, places, turned, some: [false; TURNED], first: 0 };
        this.turn(0);
        this
    }

    /// Turns the levels from coefficient `first` on.
    fn turn(&mut self, first: usize) {
        let width = self.turned.len() / TURNED;
        self.first = first;
        self.some = [false; TURNED];
        for (c, &(chunk, i)) in self.channels.iter().zip(&self.places) {
            let rows = self.turned.chunks_exact_mut(width).zip(&mut self.some);
            for ((row, some), &level) in rows.zip(c.get(first..).unwrap_or_default()) {
                row[chunk][i] = level;
                *some |= level != 0;
            }
        }
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
        // Coefficients come in order.
        if k - self.first >= TURNED {
            self.turn(k);
        }
        let at = k - self.first;
        if self.some[at] {
            levels.copy_from_slice(&self.turned[at * levels.len()..][..levels.len()]);
        }
        self.some[at]
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
pub(super) struct Units {
    units: Vec<[Unit; CHUNK]>,
    /// The steps once more, if there is no shift.
    steps: Option<Vec<Lanes>>,
}

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
        let plain = units.iter().flatten().all(|unit| unit.shift == [0.0; 4]);
        let steps = plain.then(|| units.iter().map(|u| u.map(|unit| unit.step)).collect());
        Self { units, steps }
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
        if let Some(steps) = &self.steps {
            // The same bits in a few instructions per chunk: no step is infinite.
            for ((levels, out), step) in levels.iter().zip(out).zip(steps) {
                for i in 0..CHUNK {
                    out[i] = (levels[i] as f32 * step[i]) * scale;
                }
            }
            return;
        }
        for ((levels, out), units) in levels.iter().zip(out).zip(&self.units) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quant::{Centroids, Step};

    #[test]
    fn without_shifts_the_short_way_has_the_same_bits() {
        let head =
            |step| Head { step: Step(step), centroids: Centroids::default(), strength: vec![] };
        let heads = [1, 77_777, 65_536, 1 << 40, u64::MAX].map(head);
        let short = Units::new(&heads);
        let long = Units { units: short.units.clone(), steps: None };
        assert!(short.steps.is_some());
        let some = [0, 1, -1, 7, -12_345, i32::MAX, i32::MIN, 16_777_217];
        for (k, scale) in [1.0f32, 0.1, 1.3, 3e-4, 1e-6].into_iter().enumerate() {
            let level = |i: usize| some[(i + k) % some.len()];
            let levels = [[level(0), level(1), level(2), 0], [level(3), level(4), 0, 0]];
            let [mut a, mut b] = [[[9.0; CHUNK]; 2]; 2];
            assert!(short.differences(true, &levels, scale, &[], &mut a));
            assert!(long.differences(true, &levels, scale, &[], &mut b));
            assert_eq!(a.map(|r| r.map(f32::to_bits)), b.map(|r| r.map(f32::to_bits)));
        }
    }
}
