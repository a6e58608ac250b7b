//! A channel on its own, coded while the means of its nodes are rebuilt.
//!
//! Most values lie between two bounds that are told beforehand. The mean of a node then says how
//! far apart its children can be: where it is near a bound hardly at all, and the farther child
//! is the smaller one. Opacities, many of which are equal to a bound, take up to 10 % fewer bits.

use super::models::{
    BUCKETS, CLASSES, LIMIT, PRIORS, RATE, Tail, UNARY, geometric, low_bits, mean_of_bucket, parts,
};
use crate::bytes::{Reader, put_varint};
use crate::context::{Magnitudes, Packed, Row};
use crate::error::Result;
use crate::mix::{Mixer, code_mixed};
use crate::model::Bit;
use crate::quant::{Centroids, Step};
use crate::range::BinaryCoder;
use crate::rdoq::{Thresholds, bits, bucket};

/// Unary decisions that are mixed.
const MIXED: usize = 3;
/// Counters that are mixed for each.
const INPUTS: usize = 5;
/// Pairs of half-octaves of expected magnitudes.
const PAIRS: usize = BUCKETS / 2;
/// Of so many values one lies below the lower bound, and one above the upper.
const BEYOND: usize = 64;
/// Values that bounds are found from, about.
const SAMPLE: usize = 1 << 14;

/// What most values lie between, in sixteenths of the power of two below the step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Bounds {
    low: i64,
    span: u64,
}

impl Bounds {
    /// In 1/65536.
    fn unit(step: Step) -> f64 {
        let log = step.0.max(1).ilog2().max(4) - 4;
        (1u64 << log) as f64
    }

    /// The bounds of values in any order.
    pub(crate) fn of(len: usize, value: impl Fn(usize) -> f32, step: Step) -> Self {
        let stride = (len / SAMPLE).max(1);
        let mut sample: Vec<f32> = (0..len).step_by(stride).map(value).collect();
        sample.sort_unstable_by(f32::total_cmp);
        let Some(last) = sample.len().checked_sub(1) else { return Self::default() };
        let beyond = sample.len() / BEYOND;
        // Saturates, and far from where it would overflow.
        let units = |v: f32| {
            let units = f64::from(v) * 65536.0 / Self::unit(step);
            ((units + 0.5).floor() as i64).clamp(-(1 << 48), 1 << 48)
        };
        let (low, high) = (units(sample[beyond]), units(sample[last - beyond]));
        Self { low, span: (high - low).max(0) as u64 }
    }

    pub(crate) fn write(self, out: &mut Vec<u8>) {
        put_signed(out, self.low);
        put_varint(out, self.span);
    }

    pub(crate) fn read(r: &mut Reader<'_>) -> Result<Self> {
        Ok(Self { low: signed(r.varint("lower bound")?), span: r.varint("span of values")? })
    }

    /// Lower and upper bound.
    fn values(self, step: Step) -> [f32; 2] {
        let unit = Self::unit(step) / 65536.0;
        let low = self.low as f64;
        [(low * unit) as f32, ((low + self.span as f64) * unit) as f32]
    }
}

/// Appends a signed number, the sign in the lowest bit.
pub(crate) fn put_signed(out: &mut Vec<u8>, v: i64) {
    put_varint(out, ((v << 1) ^ (v >> 63)) as u64);
}

/// What [`put_signed`] wrote as a varint.
pub(crate) fn signed(v: u64) -> i64 {
    (v >> 1) as i64 ^ -((v & 1) as i64)
}

/// A split: where a coefficient is.
#[derive(Clone, Copy)]
pub(crate) struct Split {
    pub(crate) parent: u32,
    pub(crate) axis: u8,
    /// Mean of the node.
    pub(crate) mean: f32,
    /// Share of the right child in it.
    pub(crate) share: f32,
    /// What takes a high-pass value to a difference of means.
    pub(crate) scale: f32,
}

/// The contexts of a coefficient.
pub(crate) struct Spot {
    row: Row,
    expected: u32,
    bucket: usize,
    /// Of the mixed decisions.
    at: [usize; INPUTS],
    /// Of the sign.
    sign: usize,
    /// The right child is the larger one.
    right: bool,
}

/// Codes or decodes the coefficients of a channel one after another.
pub(crate) struct Lone {
    context: Magnitudes,
    depth: usize,
    bounds: [f32; 2],
    /// Classes of means per unit.
    classes: f32,
    /// Steps per unit.
    per_unit: f32,
    /// Of the first decisions: by expected magnitude, its parts, level and axis, class of the
    /// mean, and how far apart the children can be.
    first: [Vec<[Bit; MIXED]>; INPUTS],
    mixers: [Mixer<INPUTS>; MIXED],
    /// Of the others, by expected magnitude.
    rest: Vec<[Bit; UNARY]>,
    tail: Tail,
    sign: Vec<Bit>,
}

impl Lone {
    pub(crate) fn new(coefficients: usize, bounds: Bounds, step: Step) -> Self {
        let bounds = bounds.values(step);
        let span = bounds[1] - bounds[0];
        let table = |n: usize, bit: fn(usize) -> Bit| -> Vec<[Bit; MIXED]> {
            (0..n).map(|i| [bit(i); MIXED]).collect()
        };
        Self {
            context: Magnitudes::new(coefficients, 1),
            depth: 0,
            bounds,
            classes: if span > 0.0 { 8.0 / span } else { 0.0 },
            per_unit: (1.0 / Step(step.0.max(1)).value()) as f32,
            first: [
                table(BUCKETS, |i| PRIORS[i]),
                vec![[Bit::default(); MIXED]; 16 * CLASSES * CLASSES * 4],
                table(64 * BUCKETS, |i| PRIORS[i % BUCKETS]),
                table(16 * PAIRS, |i| PRIORS[2 * (i % PAIRS)]),
                table(16 * PAIRS, |i| {
                    geometric(within(mean_of_bucket(2 * (i % PAIRS)), i / PAIRS))
                }),
            ],
            mixers: [Mixer::new(68_000); MIXED],
            rest: PRIORS.iter().map(|&bit| [bit; UNARY]).collect(),
            tail: Tail::new(),
            sign: vec![Bit::with_prior(32768, 24); 3 * 16 * 3],
        }
    }

    /// A new octree level begins.
    pub(crate) fn start_level(&mut self, depth: usize) {
        self.context.start_level();
        self.depth = depth;
    }

    /// Goes to a coefficient. In single precision, each operation rounded to nearest, in the order
    /// written; what is no number is as good as infinite.
    #[inline]
    pub(crate) fn at(&self, split: &Split) -> Spot {
        let row = self.context.at(split.parent, split.axis);
        let here = self.context.chunk(&row, 0, 0);
        let expected = here.expected(0, 0);
        let bucket = bucket(expected);
        let previous = here.previous[0].get(0) + here.previous[1].get(0);
        let level = (3 * self.depth + usize::from(split.axis)) & 63;
        let mean = ((split.mean - self.bounds[0]) * self.classes + 2.0) as u32;
        let mean = mean.min(15) as usize;
        let right = split.share > 0.5;
        let smaller = if right { 1.0 - split.share } else { split.share };
        let sign = SIDES.iter().filter(|&&side| smaller > side).count() * 16 + mean;
        let pair = bucket / 2;
        let at = [
            bucket,
            parts(here.above[0], previous, 0, 0),
            level * BUCKETS + bucket,
            mean * PAIRS + pair,
            self.apart(split) * PAIRS + pair,
        ];
        Spot { row, expected, bucket, at, sign, right }
    }

    /// How far apart the children can be, in half-octaves of steps.
    #[inline]
    fn apart(&self, split: &Split) -> usize {
        let below = (split.mean - self.bounds[0]).max(0.0);
        let above = (self.bounds[1] - split.mean).max(0.0);
        let (right, left) = (split.share, 1.0 - split.share);
        // With the right child the greater one, and with the left.
        let up = (below * left).min(above * right);
        let down = (below * right).min(above * left);
        let steps = up.max(down) * self.per_unit / (left * right * split.scale);
        let v = steps * 2.5 + 1.25;
        if v < 256.0 { ((v.to_bits() >> 22) as usize).saturating_sub(254).min(15) } else { 15 }
    }

    /// Probability that a magnitude is greater than `u`, which is no greater than [`MIXED`].
    #[inline]
    fn more(&self, spot: &Spot, u: usize) -> u32 {
        if u >= MIXED {
            return self.rest[spot.bucket][u].p1();
        }
        let mut inputs = [0; INPUTS];
        for ((x, table), &at) in inputs.iter_mut().zip(&self.first).zip(&spot.at) {
            *x = table[at][u].stretched();
        }
        self.mixers[u].mix(&inputs)
    }

    /// The magnitude that `x >= 0` steps become: what has the least of squared error and `lambda`
    /// (1/256 of `step^2` per bit) times the bits that it would take here.
    #[inline]
    pub(crate) fn quantise(
        &self,
        spot: &Spot,
        x: f64,
        centroids: Centroids,
        (thresholds, lambda): (&Thresholds, u8),
    ) -> u32 {
        if lambda == 0 || x >= MIXED as f64 || low_bits(spot.expected) != 0 {
            return thresholds.quantise(x, spot.expected);
        }
        let mut best = (f64::INFINITY, 0);
        let mut before = 0;
        for q in 0..=x as u32 + 1 {
            let more = self.more(spot, q as usize);
            let off = x - f64::from(q) + centroids.of(q) as f64 / 256.0;
            let sign = if q == 0 { 0 } else { 256 };
            let rate = f64::from(before + bits(65536 - more) + sign) / 65536.0;
            let cost = off * off + f64::from(lambda) * rate;
            if cost < best.0 {
                best = (cost, q);
            }
            before += bits(more);
        }
        best.1
    }

    /// Codes the level of coefficient `k`.
    #[inline]
    pub(crate) fn code<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        k: usize,
        spot: &Spot,
        level: i32,
    ) -> i32 {
        let m = self.magnitude(coder, spot, level.unsigned_abs());
        if m == 0 {
            self.context.learn_zeros(k, &spot.row);
            return 0;
        }
        let sign = &mut self.sign[spot.sign * 3 + m.min(3) as usize - 1];
        let negative = sign.code(coder, (level < 0) != spot.right, 1023) != spot.right;
        let mut magnitude = Packed::default();
        magnitude.set(0, m);
        self.context.learn(k, &spot.row, &[magnitude]);
        if negative { (m as i32).wrapping_neg() } else { m as i32 }
    }

    #[inline]
    fn magnitude<C: BinaryCoder>(&mut self, coder: &mut C, spot: &Spot, v: u32) -> u32 {
        let high = v >> low_bits(spot.expected);
        let [a, b, c, d, e] = &mut self.first;
        let [ia, ib, ic, id, ie] = spot.at;
        let (a, b, c, d, e) = (&mut a[ia], &mut b[ib], &mut c[ic], &mut d[id], &mut e[ie]);
        let rest = &mut self.rest[spot.bucket];
        let mut u = 0;
        while u < UNARY {
            let truth = high > u as u32;
            let more = if u < MIXED {
                let bits = [&mut a[u], &mut b[u], &mut c[u], &mut d[u], &mut e[u]];
                code_mixed(coder, &mut self.mixers[u], bits, truth, RATE, LIMIT)
            } else {
                rest[u].code(coder, truth, LIMIT)
            };
            if !more {
                break;
            }
            u += 1;
        }
        self.tail.code(coder, spot.expected, (u as u32, u == UNARY), v)
    }
}

/// Magnitudes, 8 fraction bits, that are half of what the classes of [`Lone::apart`] allow.
const HALF: [u64; 15] =
    [10, 41, 84, 146, 233, 356, 530, 776, 1124, 1616, 2312, 3295, 4687, 6656, 9440];

/// Where `mean` is expected of a magnitude and a class allows so much.
fn within(mean: u64, class: usize) -> u64 {
    let Some(half) = HALF.get(class).map(|h| h << 8) else { return mean };
    mean * half / (mean + half)
}

/// Shares of the smaller child between which signs have contexts of their own.
const SIDES: [f32; 2] = [0.265625, 0.453125];
