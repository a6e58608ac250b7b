//! Groups of one channel by the range coder: means are rebuilt while coding, and coded by.

use super::decoder::{Source, Units};
use super::encoder::Run;
use super::{Head, Options, strengths};
use crate::bytes::Reader;
use crate::coeffs::lone::{Bounds, Lone, Split, put_signed, signed};
use crate::coeffs::{self, Levels};
use crate::context::CHUNK;
use crate::error::{Error, Result};
use crate::quant::{CentroidSums, Step};
use crate::raht::{self, Lanes, Plan, Residual};
use crate::range::{BinaryCoder, RangeDecoder, RangeEncoder};
use crate::rdoq::Thresholds;

/// Where coefficient `k` is.
#[inline]
fn split(plan: &Plan, k: usize, mean: f32) -> Split {
    Split {
        parent: plan.parents()[k - 1],
        axis: plan.axes()[k - 1],
        mean,
        share: plan.share_of(k),
        scale: plan.scale_of(k),
    }
}

/// Quantises and codes the coefficients of a channel; `rows` come with the exact differences and
/// become the values.
pub(super) fn run(
    plan: &Plan,
    head: &Head,
    o: &Options,
    bounds: Bounds,
    mut rows: Vec<Lanes>,
) -> Run {
    let level = head.level(plan, rows[0][0]);
    rows[0][0] = head.mean(plan, level);
    let mut coefficients = vec![coeffs::LONE];
    put_signed(&mut coefficients, i64::from(level));
    bounds.write(&mut coefficients);
    let mut q = Quantiser {
        plan,
        head,
        lambda: o.lambda,
        thresholds: Thresholds::new(o.lambda),
        per_unit: (1.0 / Step(head.step.0.max(1)).value()) as f32,
        lone: Lone::new(plan.len(), bounds, head.step),
        coder: RangeEncoder::new(),
        units: Units::new(std::slice::from_ref(head)),
        strength: [[0.0; CHUNK]],
        sums: CentroidSums::default(),
        error: 0.0,
        all_zero: level == 0,
    };
    raht::reconstruct(plan, 1, &mut rows, usize::MAX, &mut q);
    coefficients.extend(q.coder.finish());
    Run { coefficients, rows, sums: vec![q.sums], error: q.error, all_zero: q.all_zero }
}

struct Quantiser<'a> {
    plan: &'a Plan,
    head: &'a Head,
    lambda: u8,
    thresholds: Thresholds,
    per_unit: f32,
    lone: Lone,
    coder: RangeEncoder,
    units: Units,
    strength: [Lanes; 1],
    sums: CentroidSums,
    error: f64,
    all_zero: bool,
}

impl Residual for Quantiser<'_> {
    const STORED: bool = true;
    const MEANS: bool = true;

    fn start_level(&mut self, depth: usize) -> Option<&[Lanes]> {
        self.lone.start_level(depth);
        let any = strengths(std::slice::from_ref(self.head), depth, &mut self.strength);
        any.then_some(self.strength.as_slice())
    }

    #[inline]
    fn differences(&mut self, k: usize, mean: f32, predicted: &[Lanes], row: &mut [Lanes]) -> bool {
        let split = split(self.plan, k, mean);
        let spot = self.lone.at(&split);
        let difference = row[0][0] - predicted.first().map_or(0.0, |p| p[0]);
        let x = difference * (self.per_unit * (1.0 / split.scale));
        let steps = f64::from(x.abs());
        let mut level = 0;
        // Whatever is expected, less than half a step is zero.
        if steps >= 0.5 {
            let by = (&self.thresholds, self.lambda);
            let magnitude = self.lone.quantise(&spot, steps, self.head.centroids, by);
            if magnitude != 0 {
                self.all_zero = false;
                self.sums.add(magnitude, steps);
                level = if x < 0.0 { -(magnitude as i32) } else { magnitude as i32 };
            }
        }
        let off = steps - f64::from(level.unsigned_abs());
        self.error += off * off;
        self.lone.code(&mut self.coder, k, &spot, level);
        let levels = [[level, 0, 0, 0]];
        self.units.differences(level != 0, &levels, split.scale, predicted, row)
    }
}

/// Levels out of the stream, as they are needed.
pub(super) struct Ranged<'a> {
    coder: RangeDecoder<'a>,
    lone: Lone,
}

impl<'a> Ranged<'a> {
    /// Also gives the level of coefficient 0.
    pub(super) fn new(plan: &Plan, heads: &[Head], bytes: &'a [u8]) -> Result<(Self, i32)> {
        let mut r = Reader::new(bytes);
        let [head] = heads else { return Err(r.corrupt("coefficient mode")) };
        let level = i32::try_from(signed(r.varint("mean")?)).map_err(|_| r.corrupt("mean"))?;
        let lone = Lone::new(plan.len(), Bounds::read(&mut r)?, head.step);
        Ok((Self { coder: RangeDecoder::new(&bytes[r.pos()..]), lone }, level))
    }

    /// An error if the stream has ended too early.
    pub(super) fn check(&self, offset: usize) -> Result<()> {
        if self.coder.exhausted() {
            return Err(Error::Truncated { offset, what: "coefficients" });
        }
        Ok(())
    }
}

impl Source for Ranged<'_> {
    const MEANS: bool = true;

    fn start_level(&mut self, depth: usize) {
        self.lone.start_level(depth);
    }

    #[inline]
    fn levels(&mut self, plan: &Plan, k: usize, mean: f32, levels: &mut [Levels]) -> bool {
        if self.coder.exhausted() {
            return false;
        }
        let spot = self.lone.at(&split(plan, k, mean));
        let level = self.lone.code(&mut self.coder, k, &spot, 0);
        levels[0][0] = level;
        level != 0
    }
}
