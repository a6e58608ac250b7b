//! Lossy attributes: weighted RAHT, quantisation and entropy coding of a group of channels.
//!
//! The channels of a group belong together (the planes of a colour, the entries of a covariance):
//! where one has large coefficients, so have the others, and the coder's contexts use that. Groups
//! are coded one after another and do not depend on each other.
//!
//! Invariant: [`encode`] leaves in its rows the values that [`decode`] returns, bit for bit.
//!
//! Normative description: `docs/format.md`, "Attributes".

use crate::coder::{Coder, Decoder, code_gamma};
pub use crate::coefficients::CLASSES;
use crate::coefficients::{
    ACTIVITIES, Level, RowCoder, class_of, expected_in_group, mean_of_class,
};
use crate::error::{Error, Result};
use crate::raht::{self, LANES, Lanes, Plan, Rows};

/// How an encoder quantises.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Lagrangian multiplier of the rate-distortion optimised quantiser, in `step^2` per bit; 0
    /// rounds to nearest.
    pub lambda: f32,
}

impl Default for Options {
    fn default() -> Self {
        Self { lambda: 0.1 }
    }
}

/// Codes the values in `rows` with a step for each channel, and replaces them by what a decoder
/// will return, bit for bit. Returns whether every level is zero.
///
/// The coder is an [`Encoder`](crate::coder::Encoder), or a [`Tally`](crate::coder::Tally) if only
/// the size and the values are wanted. A level saturates at `2^31 - 1` steps.
///
/// # Errors
/// If there is not one row per leaf and one positive step per channel.
pub fn encode<C: Coder>(
    coder: &mut C,
    plan: &Plan,
    steps: &[f32],
    options: &Options,
    rows: &mut Rows,
) -> Result<bool> {
    encode_priced(coder, plan, steps, options, rows, None)
}

/// As [`encode`]; `prices` become the derivatives of the number of bits by the values.
///
/// Levels are integers, so the derivatives are those of a smooth estimate: the bits that a
/// magnitude costs where the coder expects what it expects there, as a function of the value
/// before quantisation. Magnitudes far below a step have next to no price.
///
/// # Errors
/// As [`encode`].
pub fn encode_with_prices<C: Coder>(
    coder: &mut C,
    plan: &Plan,
    steps: &[f32],
    options: &Options,
    rows: &mut Rows,
    prices: &mut Rows,
) -> Result<bool> {
    prices.resize(plan.len(), steps.len());
    let all_zero = encode_priced(coder, plan, steps, options, rows, Some(prices))?;
    if plan.is_empty() || steps.is_empty() {
        return Ok(all_zero);
    }
    // The transform of the weighted values is orthonormal, so its inverse is its transpose.
    raht::inverse(plan, prices)?;
    for leaf in 0..plan.len() {
        let weight = plan.weight_of_leaf(leaf) as f32;
        prices.row_mut(leaf).iter_mut().for_each(|v| *v *= weight);
    }
    Ok(all_zero)
}

fn encode_priced<C: Coder>(
    coder: &mut C,
    plan: &Plan,
    steps: &[f32],
    options: &Options,
    rows: &mut Rows,
    mut prices: Option<&mut Rows>,
) -> Result<bool> {
    check_steps(steps, rows.channels())?;
    if plan.is_empty() || steps.is_empty() {
        return Ok(true);
    }
    raht::forward(plan, rows)?;
    let quantiser = Quantiser::new(steps, options);
    let mut all_zero = true;
    for (v, &step) in rows.row_mut(0).iter_mut().zip(steps) {
        let level = level_of_mean(plan, *v, step);
        code_signed(coder, level);
        *v = mean_of_level(plan, level, step);
        all_zero &= level == 0;
    }
    if let Some(prices) = &mut prices {
        prices.row_mut(0).fill(0.0);
    }
    let mut context = RowCoder::new(plan, steps.len());
    let mut level = Level::default();
    let mut row = Row::new(rows.width());
    for range in plan.levels().windows(2) {
        if range[0] == range[1] {
            continue;
        }
        level.start(range[0], range[1]);
        context.expect(plan, &level);
        for i in 0..level.count {
            let k = level.first + i;
            let to_high_pass = 1.0 / plan.scale_of(k);
            let large = quantiser.load(rows.lanes_of(plan.split_leaf(k)), to_high_pass, &mut row);
            let any = large && quantiser.quantise(&context, i, &mut row);
            if let Some(prices) = &mut prices {
                if !large {
                    quantiser.expect_of_zeros(&context, i, &mut row);
                }
                quantiser.price(&row, to_high_pass, prices.lanes_of_mut(plan.split_leaf(k)));
            }
            if any {
                level.active.push(i as u32);
                level.levels.extend_from_slice(&row.levels);
                all_zero = false;
            }
        }
        context.code(coder, plan, &mut level);
        reconstruct(plan, &level, steps, rows);
    }
    Ok(all_zero)
}

/// Decodes what [`encode`] coded into `rows`, which have one channel per step.
///
/// # Errors
/// If there is not one row per leaf and one positive step per channel, or the stream is truncated.
pub fn decode(coder: &mut Decoder<'_>, plan: &Plan, steps: &[f32], rows: &mut Rows) -> Result<()> {
    check_steps(steps, rows.channels())?;
    if rows.leaves() != plan.len() {
        return Err(Error::ChannelLength { channel: 0, got: rows.leaves(), want: plan.len() });
    }
    if plan.is_empty() || steps.is_empty() {
        return Ok(());
    }
    let width = rows.width();
    rows.lanes[..width].fill([0.0; LANES]);
    for (v, &step) in rows.row_mut(0).iter_mut().zip(steps) {
        *v = mean_of_level(plan, code_signed(coder, 0), step);
    }
    let mut context = RowCoder::new(plan, steps.len());
    let mut level = Level::default();
    for range in plan.levels().windows(2) {
        if range[0] == range[1] {
            continue;
        }
        level.start(range[0], range[1]);
        context.expect(plan, &level);
        context.code(coder, plan, &mut level);
        if coder.exhausted() {
            return Err(Error::Truncated { offset: 0, what: "coefficients" });
        }
        reconstruct(plan, &level, steps, rows);
    }
    Ok(())
}

fn check_steps(steps: &[f32], channels: usize) -> Result<()> {
    if steps.len() != channels {
        return Err(Error::Count { what: "steps", got: steps.len(), want: channels });
    }
    match steps.iter().position(|s| !(s.is_normal() && *s > 0.0)) {
        Some(channel) => Err(Error::Step { channel, step: steps[channel] }),
        None => Ok(()),
    }
}

/// Codes a signed number in plain bits, the sign in the lowest bit.
fn code_signed<C: Coder>(coder: &mut C, v: i32) -> i32 {
    let folded = code_gamma(coder, (v << 1 ^ v >> 31) as u32);
    (folded >> 1) as i32 ^ -((folded & 1) as i32)
}

/// The level of coefficient 0, which is the mean of all leaves times the root of the sum of
/// weights.
fn level_of_mean(plan: &Plan, mean: f32, step: f32) -> i32 {
    let exact = f64::from(mean) * plan.root_of_weight() / f64::from(step);
    // Saturates: the sign takes one bit of 32.
    ((exact + 0.5f64.copysign(exact)) as i32).clamp(-(1 << 30), 1 << 30)
}

fn mean_of_level(plan: &Plan, level: i32, step: f32) -> f32 {
    (f64::from(level) * f64::from(step) / plan.root_of_weight()) as f32
}

/// Rebuilds the means of the children that the coefficients of a level split.
fn reconstruct(plan: &Plan, level: &Level, steps: &[f32], rows: &mut Rows) {
    // With a width known at compile time, copying a row is a few instructions instead of a call.
    match rows.width() {
        1 => reconstruct_rows::<1>(plan, level, steps, rows),
        2 => reconstruct_rows::<2>(plan, level, steps, rows),
        3 => reconstruct_rows::<3>(plan, level, steps, rows),
        4 => reconstruct_rows::<4>(plan, level, steps, rows),
        6 => reconstruct_rows::<6>(plan, level, steps, rows),
        width => {
            let mut all = vec![[0.0; LANES]; width];
            all.as_flattened_mut()[..steps.len()].copy_from_slice(steps);
            let mut active = level.active.iter().zip(level.levels.chunks_exact(width)).peekable();
            for i in 0..level.count {
                let k = level.first + i;
                let (left, right, share) = raht::split(plan, k - 1, &mut rows.lanes, width);
                match active.next_if(|(row, _)| **row == i as u32) {
                    Some((_, levels)) => {
                        undo_row(left, right, levels, &all, (plan.scale_of(k), share))
                    }
                    None => right.copy_from_slice(left),
                }
            }
        }
    }
}

fn reconstruct_rows<const W: usize>(plan: &Plan, level: &Level, steps: &[f32], rows: &mut Rows) {
    let mut all = [[0.0; LANES]; W];
    all.as_flattened_mut()[..steps.len()].copy_from_slice(steps);
    let (levels, _) = level.levels.as_chunks::<W>();
    let mut active = level.active.iter().zip(levels).peekable();
    for i in 0..level.count {
        let k = level.first + i;
        let (left, right, share) = raht::split(plan, k - 1, &mut rows.lanes, W);
        let (Some(left), Some(right)) = (left.first_chunk_mut::<W>(), right.first_chunk_mut::<W>())
        else {
            return;
        };
        match active.next_if(|(row, _)| **row == i as u32) {
            Some((_, levels)) => undo_row(left, right, levels, &all, (plan.scale_of(k), share)),
            None => *right = *left,
        }
    }
}

/// The means of both children of a coefficient, from the node's and the levels.
#[inline(always)]
fn undo_row(
    left: &mut [Lanes],
    right: &mut [Lanes],
    levels: &[[i32; LANES]],
    steps: &[Lanes],
    (scale, share): (f32, f32),
) {
    for (((left, right), levels), step) in left.iter_mut().zip(right).zip(levels).zip(steps) {
        for i in 0..LANES {
            right[i] = levels[i] as f32 * step[i] * scale;
        }
        raht::undo(left, right, share);
    }
}

/// A row on its way through the quantiser, padded to whole lanes.
struct Row {
    /// In steps.
    values: Vec<Lanes>,
    levels: Vec<[i32; LANES]>,
    /// Magnitudes that the coder expects, in the middle of their class.
    means: Vec<Lanes>,
}

impl Row {
    fn new(width: usize) -> Self {
        let values = vec![[0.0; LANES]; width];
        Self { values, levels: vec![[0; LANES]; width], means: vec![[1.0; LANES]; width] }
    }
}

/// Rate-distortion optimised quantisation: a dead zone whose width depends on the expected magnitude.
///
/// Where small magnitudes are expected, one that is not zero costs many bits. If magnitudes are
/// geometric with mean `m`, each unit costs `log2(1 + 1/m)` bits, and a magnitude other than zero
/// costs one more bit for the sign. A value of `x` steps becomes `q` rather than `q - 1` if that
/// lowers `error + lambda bits`, hence if `x - (q - 1) > 1/2 + lambda bits / 2`.
struct Quantiser {
    channels: usize,
    /// One over the step of each channel; 0 behind the last.
    per_step: Vec<Lanes>,
    /// Least values, by class, that do not become zero.
    zero: [f32; CLASSES],
    /// Fractions, by class, from which larger values are rounded up.
    rest: [f32; CLASSES],
    /// Expected magnitudes by class.
    means: [f32; CLASSES],
}

impl Quantiser {
    fn new(steps: &[f32], options: &Options) -> Self {
        let half = 0.5 * options.lambda;
        let means = std::array::from_fn(|class| mean_of_class(class).max(1.0 / 512.0));
        let bits = |class: usize| log2(1.0 + 1.0 / means[class]);
        let mut per_step = vec![[0.0; LANES]; steps.len().div_ceil(LANES)];
        per_step.as_flattened_mut().iter_mut().zip(steps).for_each(|(p, s)| *p = 1.0 / s);
        Self {
            channels: steps.len(),
            per_step,
            zero: std::array::from_fn(|c| (0.5 + half * (bits(c) + 1.0)).min(1.45)),
            rest: std::array::from_fn(|c| (0.5 + half * bits(c)).min(0.95)),
            means,
        }
    }

    /// Fills in the values. False if all are less than half a step, which is zero whatever is expected.
    #[inline]
    fn load(&self, differences: &[Lanes], to_high_pass: f32, row: &mut Row) -> bool {
        // Loops over all lanes at once become vector instructions.
        let values = row.values.as_flattened_mut();
        let from = differences.as_flattened().iter().zip(self.per_step.as_flattened());
        values.iter_mut().zip(from).for_each(|(x, (d, per_step))| *x = d * per_step * to_high_pass);
        values.iter().fold(0, |large, x| large | u32::from(x.abs() >= 0.5)) != 0
    }

    /// Fills in the levels of row `number` of a level, and the means; false if all levels are zero.
    fn quantise(&self, context: &RowCoder, number: usize, row: &mut Row) -> bool {
        let (size, expected) = (context.group_size(), context.expected(number));
        let mut any = false;
        let Row { values, levels, means } = row;
        let values = values.as_flattened()[..self.channels].chunks(size);
        let levels = levels.as_flattened_mut().chunks_mut(size);
        let means = means.as_flattened_mut().chunks_mut(size);
        for ((values, levels), means) in values.zip(levels).zip(means) {
            let mut sum = 0u32;
            for (i, ((&x, level), mean)) in values.iter().zip(levels).zip(means).enumerate() {
                let class = class_of(expected_in_group(expected[i % ACTIVITIES], sum, i));
                let magnitude = self.magnitude(x.abs(), class);
                *level = if x < 0.0 { -magnitude } else { magnitude };
                *mean = self.means[class];
                any |= magnitude != 0;
                sum = sum.saturating_add(magnitude as u32);
            }
        }
        any
    }

    /// Fills in the means of a row of zeros, in which all groups are alike.
    fn expect_of_zeros(&self, context: &RowCoder, number: usize, row: &mut Row) {
        let (size, expected) = (context.group_size(), context.expected(number));
        let mean = |i: usize| {
            let expected = expected_in_group(expected[i % ACTIVITIES], 0, i);
            self.means[class_of(expected)]
        };
        if size == 3 {
            // Most rows: a few vector instructions.
            let [a, b, c] = [mean(0), mean(1), mean(2)];
            let pattern = [[a, b, c, a], [b, c, a, b], [c, a, b, c]];
            let lanes = row.means.iter_mut().zip(pattern.iter().cycle());
            lanes.for_each(|(lanes, pattern)| *lanes = *pattern);
            return;
        }
        let means = row.means.as_flattened_mut()[..self.channels].iter_mut();
        means.enumerate().for_each(|(i, out)| *out = mean(i));
    }

    /// The derivatives of the bits of a row by its coefficients, as the inverse transform takes them:
    /// those of the differences of means, given by the derivatives of high-pass values.
    ///
    /// A magnitude of `x` steps costs about `x log2(1 + 1/m)` bits where `m` is expected, and a sign
    /// where it is not zero. What a large magnitude adds to later expectations makes it cheaper, so
    /// the mean is half way to it: `m + x/2`. Around zero the price fades out, since a value that
    /// stays zero costs nothing more.
    fn price(&self, row: &Row, to_high_pass: f32, out: &mut [Lanes]) {
        let values = row.values.as_flattened().iter().zip(row.means.as_flattened());
        let out = out.as_flattened_mut().iter_mut().zip(self.per_step.as_flattened());
        for ((out, per_step), (&x, mean)) in out.zip(values) {
            let magnitude = x.abs();
            let sign = if magnitude < 1.0 { 1.0 } else { 0.0 };
            let bits = log2(1.0 + 1.0 / (mean + 0.5 * magnitude)) + sign;
            let faded = bits * (x * FADE).clamp(-1.0, 1.0);
            *out = faded * per_step / to_high_pass;
        }
    }

    /// The magnitude of `x >= 0` steps.
    #[inline]
    fn magnitude(&self, x: f32, class: usize) -> i32 {
        if x < self.zero[class] {
            return 0;
        }
        // Saturates: a quantised value is an i32.
        let q = x.min((i32::MAX - 128) as f32) as i32;
        (q + i32::from(x - q as f32 >= self.rest[class])).max(1)
    }
}

/// One over the magnitude, in steps, below which the price of a value fades out.
const FADE: f32 = 4.0;

/// Binary logarithm of `x >= 1`, linear between powers of two: what a price needs, and the same on
/// every machine.
fn log2(x: f32) -> f32 {
    let bits = x.to_bits();
    let exponent = (bits >> 23) as f32 - 127.0;
    exponent + (f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000) - 1.0)
}
