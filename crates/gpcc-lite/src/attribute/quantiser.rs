//! [`Quantiser`]: from coefficients to levels, and the prices of both.

use super::Quantisation;
use crate::coefficients::{
    ACTIVITIES, CLASSES, RowCoder, class_of, expected_in_group, mean_of_class,
};
use crate::raht::{LANES, Lanes};

/// A row on its way through the quantiser, padded to whole lanes.
pub(super) struct Row {
    /// In steps.
    values: Vec<Lanes>,
    pub(super) levels: Vec<[i32; LANES]>,
    /// Magnitudes that the coder expects, in the middle of their class.
    means: Vec<Lanes>,
}

impl Row {
    pub(super) fn new(width: usize) -> Self {
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
pub(super) struct Quantiser {
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
    pub(super) fn new(quantisation: &Quantisation<'_>) -> Self {
        let &Quantisation { steps, lambda } = quantisation;
        let half = 0.5 * lambda;
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
    pub(super) fn load(&self, differences: &[Lanes], to_high_pass: f32, row: &mut Row) -> bool {
        // Loops over all lanes at once become vector instructions.
        let values = row.values.as_flattened_mut();
        let from = differences.as_flattened().iter().zip(self.per_step.as_flattened());
        values.iter_mut().zip(from).for_each(|(x, (d, per_step))| *x = d * per_step * to_high_pass);
        values.iter().fold(0, |large, x| large | u32::from(x.abs() >= 0.5)) != 0
    }

    /// Fills in the levels of row `number` of a level, and the means; false if all levels are zero.
    pub(super) fn quantise(&self, context: &RowCoder, number: usize, row: &mut Row) -> bool {
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
    pub(super) fn expect_of_zeros(&self, context: &RowCoder, number: usize, row: &mut Row) {
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
    pub(super) fn price(&self, row: &Row, to_high_pass: f32, out: &mut [Lanes]) {
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
