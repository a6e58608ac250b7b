//! From differences of means to levels, and to a stream.

use super::decoder::Units;
use super::exact::Exact;
use super::plane::Plane;
use super::{Head, Options, Rows, lone, put_varint, strengths};
use crate::coeffs::lone::Bounds;
use crate::coeffs::{self, Levels, Mode, RowCoder, code_dc, places};
use crate::context::{CHUNK, chunk_sizes};
use crate::error::Result;
use crate::quant::{CentroidSums, Centroids, Step};
use crate::raht::{self, Gains, Lanes, Plan, Residual};
use crate::rdoq::Thresholds;
use crate::symbol_coder::SymbolEncoder;
use std::borrow::Cow;

/// A coded group.
pub(super) struct Coded {
    pub(super) bytes: Vec<u8>,
    /// What the decoder returns, if asked for.
    pub(super) rows: Rows,
    /// Every coefficient was quantised to zero.
    pub(super) all_zero: bool,
}

/// Rows of fewer chunks may be coded a second time.
const SMALL: usize = 1 << 12;
/// Up to so many values are coded with and without prediction, and the better is kept: where
/// neighbours resemble each other here and there only, prediction lowers the squared error of its
/// input and raises the rate all the same, by up to 2 %. More values would take too long, and so
/// would symbols, which are there for their speed.
const TRIED: usize = 3 << 17;
/// The multiplier of a trial where the caller's is 0, in 1/256 of `step^2` per bit.
const LAMBDA: u8 = 26;

/// Codes rows of values, one per leaf.
pub(super) fn encode_rows(
    plan: &Plan,
    steps: &[Step],
    o: &Options,
    mut rows: Vec<Lanes>,
) -> Result<Coded> {
    let measured = if o.prediction { plan.predicted_levels(o.fine_prediction) } else { 0 };
    let width = chunk_sizes(steps.len()).len();
    let bounds = match (o.mode, steps) {
        (Mode::Range, [step]) if o.by_means && !plan.is_empty() => {
            Some(Bounds::of(rows.len(), |i| rows[i][0], *step))
        }
        _ => None,
    };
    let gains = raht::forward(plan, width, &mut rows, measured);
    let mut heads: Vec<Head> = places(steps.len())
        .zip(steps)
        .map(|((chunk, i), &step)| {
            let strength = strength_of(plan, &gains, chunk, i);
            let centroids = if o.centres {
                Centroids::default()
            } else {
                let value = |k| rows[plan.split_leaf(k) * width + chunk][i];
                Centroids::typical(zeros_of(plan, step, value))
            };
            Head { step, centroids, strength }
        })
        .collect();
    let mut predicted = heads.iter().any(|h| !h.strength.is_empty());
    let lone = bounds.is_some();
    // Means are needed as long as something is predicted from them or coded by them, or if they
    // are wanted and no shift of theirs is left to be chosen.
    let levels = if lone || (o.reconstruction && (predicted || o.centres)) {
        usize::MAX
    } else if predicted {
        measured
    } else {
        0
    };
    let ranged = matches!(o.mode, Mode::Range | Mode::Symbols);
    let tried = (predicted || lone) && o.mode != Mode::Symbols && plan.len() * steps.len() <= TRIED;
    // Only what is so small can come out larger than raw values.
    let exact = (tried || rows.len() < SMALL).then(|| Exact::of(&rows, steps.len()));
    let pass = |heads: &[Head], levels: usize, rows: Vec<Lanes>| {
        Ok(match bounds {
            Some(bounds) => {
                let run = lone::run(plan, &heads[0], o, bounds, rows);
                Run { rows: if o.reconstruction { run.rows } else { Vec::new() }, ..run }
            }
            None => run(plan, heads, o, levels, rows, ranged)?,
        })
    };
    let mut run = pass(&heads, levels, rows)?;
    if let (true, Some(exact)) = (tried, &exact) {
        if predicted {
            let mut open = heads.clone();
            open.iter_mut().for_each(|h| h.strength.clear());
            let levels = if o.reconstruction && o.centres { usize::MAX } else { 0 };
            let other = pass(&open, levels, exact.rows())?;
            let lambda = f64::from(if o.lambda == 0 { LAMBDA } else { o.lambda }) / 256.0;
            // Shifts that fit save error in both; without prediction they cost nothing.
            let cost = |run: &Run| {
                let saved = run.sums.iter().map(CentroidSums::saved);
                run.error - if o.centres { 0.0 } else { saved.sum() }
                    + lambda * 8.0 * run.coefficients.len() as f64
            };
            if cost(&other) < cost(&run) {
                (run, heads, predicted) = (other, open, false);
            }
        }
        if (predicted || lone) && !o.centres {
            for (head, sums) in heads.iter_mut().zip(&run.sums) {
                head.centroids = sums.centroids();
            }
            run = pass(&heads, levels, exact.rows())?;
        }
    }
    let mut closed = predicted || lone;
    if let Some(exact) = exact
        && run.coefficients.len() > 1 + 4 * plan.len() * steps.len()
    {
        // Rare and small: the levels were not kept.
        run = self::run(plan, &heads, o, levels, exact.rows(), false)?;
        closed = predicted;
    }
    let Run { coefficients, rows, sums, all_zero, .. } = run;
    if !closed && !o.centres {
        // Nothing was predicted from reconstructed values, so the shifts can still be chosen.
        for (head, sums) in heads.iter_mut().zip(&sums) {
            head.centroids = sums.centroids();
        }
    }
    let mut bytes = Vec::new();
    put_varint(&mut bytes, steps.len() as u64);
    heads.iter().for_each(|h| h.write(&mut bytes));
    bytes.extend(coefficients);
    let mut decoded = Rows::default();
    if o.reconstruction && (closed || o.centres) {
        decoded = Rows::of(rows, plan.len(), steps.len());
    } else if o.reconstruction {
        super::decode_rows(plan, &bytes, steps.len(), &mut decoded)?;
    }
    Ok(Coded { bytes, rows: decoded, all_zero })
}

/// Of 256 differences `value(k)`, how many are small; one of eight is looked at.
fn zeros_of(plan: &Plan, step: Step, value: impl Fn(usize) -> f32) -> u32 {
    let per_unit = (1.0 / Step(step.0.max(1)).value()) as f32;
    let small = |k: &usize| (value(*k) * per_unit / plan.scale_of(*k)).abs() < Centroids::SMALL;
    let sample = (1..plan.len()).step_by(8);
    let looked_at = sample.len().max(1);
    (sample.filter(small).count() * 256 / looked_at) as u32
}

/// How much of each level its prediction explains, in 1/16 and at most 15; empty if none.
fn strength_of(plan: &Plan, gains: &[Gains], chunk: usize, i: usize) -> Vec<u8> {
    let mut strength = vec![0; plan.levels().len() - 1];
    for (out, g) in strength.iter_mut().zip(gains) {
        let [_, ep, pp] = g.sums[chunk][i];
        let ratio = if pp > 0.0 { 16.0 * ep / pp } else { 0.0 };
        *out = (ratio + 0.5).clamp(0.0, 15.0) as u8;
    }
    if strength.iter().all(|&s| s == 0) { Vec::new() } else { strength }
}

/// What one pass over the coefficients gives.
pub(super) struct Run {
    pub(super) coefficients: Vec<u8>,
    /// Means, as far as they were reconstructed.
    pub(super) rows: Vec<Lanes>,
    pub(super) sums: Vec<CentroidSums>,
    /// Sum of squared errors of the coefficients, in squares of their steps.
    pub(super) error: f64,
    pub(super) all_zero: bool,
}

/// Quantises and codes all coefficients.
fn run(
    plan: &Plan,
    heads: &[Head],
    o: &Options,
    levels: usize,
    rows: Vec<Lanes>,
    ranged: bool,
) -> Result<Run> {
    let (mut out, rows) = match o.mode {
        Mode::Symbols => quantise::<true>(plan, heads, o, levels, rows, ranged),
        _ => quantise::<false>(plan, heads, o, levels, rows, ranged),
    };
    // Nobody looks at them any more, and coding by channels takes memory too.
    let rows = if o.reconstruction { rows } else { Vec::new() };
    let coefficients = out.sink.finish(plan, o)?;
    let Outcome { sums, all_zero, error, .. } = out;
    Ok(Run { coefficients, rows, sums, error: error.unwrap_or_default(), all_zero })
}

/// Quantises all coefficients; `levels` octree levels of means are reconstructed in `rows`, which
/// come with the exact differences.
fn quantise<const BY_SYMBOLS: bool>(
    plan: &Plan,
    heads: &[Head],
    o: &Options,
    levels: usize,
    mut rows: Vec<Lanes>,
    ranged: bool,
) -> (Outcome, Vec<Lanes>) {
    let mut q = Quantiser::<BY_SYMBOLS>::new(plan, heads, o, ranged);
    if plan.is_empty() {
        return (q.outcome(), rows);
    }
    let width = q.levels.len();
    for (head, (chunk, i)) in heads.iter().zip(places(heads.len())) {
        let level = head.level(plan, rows[chunk][i]);
        q.levels[chunk][i] = level;
        rows[chunk][i] = head.mean(plan, level);
    }
    q.put_dc();
    raht::reconstruct(plan, width, &mut rows, levels, &mut q);
    (q.outcome(), rows)
}

/// Where levels go.
enum Sink {
    Range(SymbolEncoder),
    Planar(Vec<Plane>),
}

impl Sink {
    fn finish(&mut self, plan: &Plan, o: &Options) -> Result<Vec<u8>> {
        match self {
            Self::Range(coder) => {
                let mut out = Vec::new();
                coeffs::finish(std::mem::take(coder), o.mode, o.period, &mut out);
                Ok(out)
            }
            Self::Planar(channels) => {
                if matches!(o.mode, Mode::Rlgr | Mode::RlgrMalvar) {
                    let levels = |c: usize| Cow::Owned(channels[c].levels());
                    return Ok(coeffs::encode_by_rlgr(plan.len(), channels.len(), o.mode, levels));
                }
                let levels: Vec<Vec<i32>> = channels.iter().map(Plane::levels).collect();
                let views: Vec<&[i32]> = levels.iter().map(Vec::as_slice).collect();
                coeffs::encode(plan, &views, o.mode)
            }
        }
    }
}

/// What a quantiser has made.
struct Outcome {
    sink: Sink,
    sums: Vec<CentroidSums>,
    all_zero: bool,
    error: Option<f64>,
}

/// Quantises differences as it goes.
struct Quantiser<'a, const BY_SYMBOLS: bool> {
    plan: &'a Plan,
    heads: &'a [Head],
    thresholds: Thresholds,
    /// Where each channel is.
    places: Vec<(usize, usize)>,
    /// Number of channels of each chunk.
    sizes: Vec<usize>,
    /// Reciprocals of the steps, chunk by chunk.
    per_unit: Vec<[f32; CHUNK]>,
    rows: RowCoder<BY_SYMBOLS>,
    sink: Sink,
    sums: Vec<CentroidSums>,
    levels: Vec<Levels>,
    units: Units,
    strength: Vec<Lanes>,
    /// Every level so far was zero.
    all_zero: bool,
    /// Squared errors so far without shifts, in squares of steps, if they are wanted.
    error: Option<f64>,
}

impl<'a, const BY_SYMBOLS: bool> Quantiser<'a, BY_SYMBOLS> {
    fn new(plan: &'a Plan, heads: &'a [Head], o: &Options, ranged: bool) -> Self {
        let channels = heads.len();
        let sizes = chunk_sizes(channels);
        let mut per_unit = vec![[0.0; CHUNK]; sizes.len()];
        for (head, (chunk, i)) in heads.iter().zip(places(channels)) {
            per_unit[chunk][i] = (1.0 / Step(head.step.0.max(1)).value()) as f32;
        }
        let sink = if ranged {
            Sink::Range(SymbolEncoder::default())
        } else {
            Sink::Planar((0..channels).map(|_| Plane::new(plan.len())).collect())
        };
        Self {
            plan,
            heads,
            places: places(channels).collect(),
            thresholds: Thresholds::new(o.lambda),
            per_unit,
            rows: RowCoder::new(plan.len(), channels, o.period),
            sink,
            sums: vec![CentroidSums::default(); channels],
            levels: vec![[0; CHUNK]; sizes.len()],
            units: Units::new(heads),
            strength: vec![[0.0; CHUNK]; sizes.len()],
            sizes,
            all_zero: true,
            error: (!BY_SYMBOLS && plan.len() * channels <= TRIED).then_some(0.0),
        }
    }

    fn outcome(self) -> Outcome {
        Outcome { sink: self.sink, sums: self.sums, all_zero: self.all_zero, error: self.error }
    }

    /// Codes the levels of coefficient 0.
    fn put_dc(&mut self) {
        self.all_zero &= self.levels.iter().all(|l| *l == [0; CHUNK]);
        let channels = self.heads.len();
        match &mut self.sink {
            Sink::Range(coder) => code_dc(coder, channels, &mut self.levels),
            Sink::Planar(planes) => {
                for (plane, (chunk, i)) in planes.iter_mut().zip(places(channels)) {
                    plane.set(0, self.levels[chunk][i]);
                }
            }
        }
    }
}

impl<const BY_SYMBOLS: bool> Residual for Quantiser<'_, BY_SYMBOLS> {
    const STORED: bool = true;
    const MEANS: bool = false;

    fn start_level(&mut self, depth: usize) -> Option<&[Lanes]> {
        self.rows.start_level(depth);
        strengths(self.heads, depth, &mut self.strength).then_some(&self.strength)
    }

    #[inline]
    fn differences(&mut self, k: usize, _: f32, predicted: &[Lanes], row: &mut [Lanes]) -> bool {
        let at = (self.plan.parents()[k - 1], self.plan.axes()[k - 1]);
        let scale = self.plan.scale_of(k);
        let per_scale = 1.0 / scale;
        for (row, p) in row.iter_mut().zip(predicted) {
            for i in 0..CHUNK {
                row[i] -= p[i];
            }
        }
        // In steps. Whatever is expected, less than half a step is zero.
        let mut large = false;
        for (row, per_unit) in row.iter_mut().zip(&self.per_unit) {
            for i in 0..CHUNK {
                row[i] *= per_unit[i] * per_scale;
                large |= row[i].abs() >= 0.5;
            }
        }
        let mut any = false;
        if large {
            let here = self.rows.context().at(at.0, at.1);
            let (mut first, mut coded) = (0, 0u32);
            for (chunk, &size) in self.sizes.iter().enumerate() {
                let here = self.rows.context().chunk(&here, chunk, first);
                let mut levels = [0; CHUNK];
                for i in 0..size {
                    let x = row[chunk][i];
                    if x.abs() < 0.5 {
                        continue;
                    }
                    let steps = f64::from(x.abs());
                    let magnitude = self.thresholds.quantise(steps, here.expected(i, coded));
                    coded = coded.saturating_add(magnitude);
                    if magnitude != 0 {
                        any = true;
                        self.sums[first + i].add(magnitude, steps);
                        levels[i] = if x < 0.0 { -(magnitude as i32) } else { magnitude as i32 };
                    }
                }
                self.levels[chunk] = levels;
                first += size;
            }
            self.all_zero &= !any;
        }
        if !any {
            self.levels.fill([0; CHUNK]);
        }
        if let Some(error) = &mut self.error {
            for (row, levels) in row.iter().zip(&self.levels) {
                for (x, q) in row.iter().zip(levels) {
                    let off = f64::from(x.abs() - q.unsigned_abs() as f32);
                    *error += off * off;
                }
            }
        }
        match &mut self.sink {
            Sink::Range(coder) => {
                self.rows.code(coder, k, at, &mut self.levels);
            }
            Sink::Planar(planes) => {
                let here = self.rows.context().at(at.0, at.1);
                self.rows.learn(k, &here, &self.levels);
                if any {
                    for (plane, &(chunk, i)) in planes.iter_mut().zip(&self.places) {
                        plane.set(k, self.levels[chunk][i]);
                    }
                }
            }
        }
        self.units.differences(any, &self.levels, scale, predicted, row)
    }
}
