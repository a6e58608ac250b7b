//! Entropy coding of quantised RAHT coefficients, one level of merges after another.
//!
//! A *row* holds the quantised values of one coefficient in all channels. Rows of more than 6
//! channels are divided into *groups* of 3 channels; the last group may be smaller.
//!
//! What magnitude is expected in a row follows from the rows above it alone. Every row passes on an
//! *activity*: half of the activity of the row above, and half of its own mean magnitude. There are
//! three activities, each for every third channel. So the rows of a level do not depend on each
//! other, and a level is coded in passes over its rows:
//!
//! 1. For each row, a flag that says whether the row has a value other than zero. The passes below
//!    skip the other rows. A single channel has no flags.
//! 2. For each group: if there is more than one, a flag for each row that says whether the group
//!    has a value other than zero in it. Then, channel by channel, the values of the rows with that
//!    flag: a symbol for the magnitude, its low bits, and its sign. Low bits and signs are plain
//!    bits.
//!
//! Weights make coefficients differ in size even where the values vary alike. The factor follows
//! from the weights ([`RahtPlan::noise_gain`]): a row divides what it passes on by its own, and
//! multiplies what it expects by its own.
//!
//! Normative description: `docs/format.md`, "Attributes".

use crate::coder::{Coder, ESCAPE};
use crate::model::Bit;
use crate::raht::{LANES, RahtPlan};
use crate::symbols::{SCALE_BITS, Symbols};
use multiversion::multiversion;
use std::ops::Range;

/// Activities of a row: activity `a` is that of the channels `a`, `a + 3`, `a + 6` and so on.
pub(crate) const ACTIVITIES: usize = 3;
/// Channels of a group in a row of more than [`UNGROUPED`] channels: the planes of an SH
/// coefficient.
const GROUP: usize = 3;
const UNGROUPED: usize = 6;
/// Factor of an activity from one row to the row below. The row's own mean magnitude has the rest.
const KEPT: f32 = 0.5;
/// Weight of the expectation from above against one magnitude in the same group.
const ABOVE: f32 = 3.0;
/// Classes of expected magnitudes, in half-octaves.
pub const CLASSES: usize = 16;
/// Memory of the flags' models, in observations.
const LIMIT: u32 = 1023;
/// Observations that the magnitudes' models begin with.
const PRIOR: u32 = 8;
/// `1 / (ABOVE + i)`: it turns `ABOVE` times the expectation from above plus the sum of `i` magnitudes
/// into their mean.
const MEAN_OF: [f32; UNGROUPED] =
    [1.0 / 3.0, 1.0 / 4.0, 1.0 / 5.0, 1.0 / 6.0, 1.0 / 7.0, 1.0 / 8.0];

/// The class of an expected magnitude.
#[inline(always)]
pub(crate) fn class_of(expected: f32) -> usize {
    let class = ((expected + 0.0625).to_bits() >> 22) - (0.0625f32.to_bits() >> 22);
    (class as usize).min(CLASSES - 1)
}

/// A magnitude in the middle of a class.
pub(crate) fn mean_of_class(class: usize) -> f32 {
    let low = (class as u32) + (0.0625f32.to_bits() >> 22);
    f32::from_bits(low << 22 | 1 << 21) - 0.0625
}

/// Low bits of a magnitude that are plain where this much is expected: those below the leading
/// three.
#[inline(always)]
pub(crate) fn plain_bits(expected: f32) -> u32 {
    (expected.to_bits() >> 23).saturating_sub(127 + 2).min(30)
}

/// The magnitude expected of channel `i` of a group: `above` by the rows above, `sum` that of the
/// group's `i` channels before.
#[inline(always)]
pub(crate) fn expected_in_group(above: f32, sum: u32, i: usize) -> f32 {
    if i == 0 { above } else { (ABOVE * above + sum as f32) * MEAN_OF[i] }
}

/// Codes or decodes the rows of one group of channels.
pub(crate) struct RowCoder {
    channels: usize,
    /// By activity: what the sum of a row's magnitudes adds to it, for a noise gain of 1.
    factors: [f32; LANES],
    /// The three activities of each coefficient; those of coefficient 0 are zero. The last lane is
    /// not used.
    activity: Vec<[f32; LANES]>,
    /// Models of the flags of rows, by class.
    rows: Vec<Bit>,
    /// Models of the flags of groups, by what the groups before hold, and class.
    groups: Vec<Bit>,
    /// Models of magnitudes, by channel of the group (0 if there is one group only), whether an earlier
    /// channel of the group is not zero, and class.
    magnitudes: Vec<Symbols>,
    /// For each row of the level: the magnitudes expected by the three activities, and twice their
    /// sum.
    expected: Vec<[f32; LANES]>,
    /// Whether each row, or the current group of each active row, is not all zero.
    flags: Vec<bool>,
    /// For each active row: the class of the fourth of these, and the sum of the magnitudes of the groups so far.
    classes: Vec<u8>,
    before: Vec<u32>,
    /// The active rows in which the current group is not all zero, as indices into
    /// [`LevelRows::active`].
    chosen: Vec<u32>,
    /// For each of these the magnitudes expected by the three activities, and the sum of the magnitudes of the
    /// group's channels so far.
    above: [Vec<f32>; ACTIVITIES],
    sums: Vec<u32>,
    /// Of one channel of the chosen rows: context, number of plain bits, symbol, and level.
    contexts: Vec<u8>,
    shifts: Vec<u8>,
    symbols: Vec<u8>,
    values: Vec<i32>,
}

/// The rows of one level of merges that are not all zero.
#[derive(Debug, Default)]
pub(crate) struct LevelRows {
    /// First coefficient, and number of coefficients.
    pub(crate) first: usize,
    pub(crate) count: usize,
    /// Numbers of the active rows, ascending.
    pub(crate) active: Vec<u32>,
    /// The levels of the active rows, each filled up to whole lanes.
    pub(crate) levels: Vec<[i32; LANES]>,
}

impl RowCoder {
    pub(crate) fn new(plan: &RahtPlan, channels: usize) -> Self {
        let model = |i: usize| {
            let (class, group_is_zero) = (i % CLASSES, (i / CLASSES).is_multiple_of(2));
            let mean = mean_of_class(class);
            let mean = mean / (1u32 << plain_bits(mean)) as f32;
            let more = if group_is_zero && channels > 1 { 0.25 } else { 0.0 };
            Symbols::geometric(((mean + more) * 256.0) as u32, PRIOR)
        };
        let members = |a: usize| (a..channels).step_by(ACTIVITIES).count();
        let factor =
            |a: usize| if a < ACTIVITIES { (1.0 - KEPT) / members(a).max(1) as f32 } else { 0.0 };
        Self {
            channels,
            factors: std::array::from_fn(factor),
            activity: vec![[0.0; LANES]; plan.len()],
            rows: vec![Bit::default(); CLASSES],
            groups: vec![Bit::default(); 4 * CLASSES],
            magnitudes: (0..2 * GROUP * CLASSES).map(model).collect(),
            expected: Vec::new(),
            flags: Vec::new(),
            classes: Vec::new(),
            before: Vec::new(),
            chosen: Vec::new(),
            above: Default::default(),
            sums: Vec::new(),
            contexts: Vec::new(),
            shifts: Vec::new(),
            symbols: Vec::new(),
            values: Vec::new(),
        }
    }

    /// Channels of each group; the last may have fewer.
    pub(crate) fn group_size(&self) -> usize {
        if self.channels > UNGROUPED { GROUP } else { self.channels }
    }

    /// Goes on to the level of the coefficients `first..end`, without any active row. It takes note of the activities
    /// of the level before, and finds the magnitudes expected in each row by the activities of the rows above.
    pub(crate) fn next_level(
        &mut self,
        plan: &RahtPlan,
        level: &mut LevelRows,
        first: u32,
        end: u32,
    ) {
        self.learn(plan, level);
        (level.first, level.count) = (first as usize, (end - first) as usize);
        level.active.clear();
        level.levels.clear();
        self.expected.clear();
        let range = level.first - 1..level.first - 1 + level.count;
        let above = plan.parents()[range.clone()].iter().zip(&plan.noise_gains()[range]);
        self.expected.extend(above.map(|(&parent, &gain)| {
            let [a, b, c, _] = self.activity[parent as usize];
            let [a, b, c] = [a * gain, b * gain, c * gain];
            [a, b, c, 2.0 * (a + b + c)]
        }));
    }

    /// What [`RowCoder::next_level`] found for a row.
    #[inline]
    pub(crate) fn expected(&self, row: usize) -> &[f32; LANES] {
        &self.expected[row]
    }

    /// Codes the rows of a level. A decoder fills in what is active.
    pub(crate) fn code<C: Coder>(&mut self, coder: &mut C, level: &mut LevelRows) {
        if !C::HEARD {
            return;
        }
        self.code_row_flags(coder, level);
        let size = self.group_size();
        let groups = self.channels.div_ceil(size);
        self.before.clear();
        self.before.resize(level.active.len(), 0);
        for group in 0..groups {
            let channels = group * size..self.channels.min((group + 1) * size);
            self.chosen.clear();
            if groups == 1 {
                self.chosen.extend(0..level.active.len() as u32);
            } else {
                self.code_group_flags(coder, level, channels.clone(), group + 1 == groups);
            }
            self.code_group(coder, level, channels);
        }
    }

    /// Codes which rows are not all zero. A single channel has no flags.
    fn code_row_flags<C: Coder>(&mut self, coder: &mut C, level: &mut LevelRows) {
        let width = self.channels.div_ceil(LANES);
        if self.channels == 1 {
            if C::ENCODING {
                let mut all = vec![[0; LANES]; level.count];
                for (&row, levels) in level.active.iter().zip(&level.levels) {
                    all[row as usize] = *levels;
                }
                level.levels = all;
            } else {
                level.levels.resize(level.count, [0; LANES]);
            }
            level.active.clear();
            level.active.extend(0..level.count as u32);
            return;
        }
        let Self { rows, expected, classes, flags, .. } = self;
        classes.clear();
        classes.extend(expected.iter().map(|expected| class_of(expected[3]) as u8));
        flags.clear();
        flags.resize(level.count, false);
        if C::ENCODING {
            level.active.iter().for_each(|&row| flags[row as usize] = true);
        }
        coder.decisions(rows, classes, LIMIT, flags);
        let found = keep(&mut level.active, flags);
        for (at, &row) in level.active.iter().enumerate() {
            classes[at] = classes[row as usize];
        }
        classes.truncate(found);
        if !C::ENCODING {
            level.levels.resize(found * width, [0; LANES]);
        }
    }

    /// Codes in which of the active rows a group is not all zero.
    fn code_group_flags<C: Coder>(
        &mut self,
        coder: &mut C,
        level: &LevelRows,
        channels: Range<usize>,
        last: bool,
    ) {
        let Self { groups, classes, before, contexts, flags, chosen, .. } = self;
        // Half of the channels is compared, because twice the sum may not fit 32 bits.
        let half = (channels.start / 2) as u32;
        let untouched = if last { 3 } else { 0 };
        contexts.clear();
        contexts.extend(before.iter().zip(&*classes).map(|(&before, &class)| {
            let state = if before == 0 { untouched } else { 1 + u8::from(before > half) };
            state * CLASSES as u8 + class
        }));
        flags.resize(contexts.len(), false);
        if C::ENCODING {
            let width = self.channels.div_ceil(LANES);
            for (flag, levels) in flags.iter_mut().zip(level.levels.chunks_exact(width)) {
                *flag = levels.as_flattened()[channels.clone()].iter().any(|&v| v != 0);
            }
        }
        coder.decisions(groups, contexts, LIMIT, flags);
        keep(chosen, flags);
    }

    /// Codes a group of channels of the chosen rows, channel by channel: first the symbols of all rows, then their
    /// plain bits.
    fn code_group<C: Coder>(
        &mut self,
        coder: &mut C,
        level: &mut LevelRows,
        channels: Range<usize>,
    ) {
        let stride = self.channels.div_ceil(LANES) * LANES;
        let Self {
            magnitudes,
            expected,
            chosen,
            above,
            sums,
            values,
            contexts,
            shifts,
            symbols,
            ..
        } = self;
        let levels = level.levels.as_flattened_mut();
        above.iter_mut().for_each(|above| above.resize(chosen.len(), 0.0));
        let [a, b, c] = &mut *above;
        for (((&at, a), b), c) in chosen.iter().zip(a).zip(b).zip(c) {
            [*a, *b, *c, _] = expected[level.active[at as usize] as usize];
        }
        sums.clear();
        sums.resize(chosen.len(), 0);
        for (i, channel) in channels.enumerate() {
            let position = if self.channels > UNGROUPED { i } else { 0 };
            find_contexts(&above[channel % ACTIVITIES], sums, i, position, contexts, shifts);
            symbols.resize(chosen.len(), 0);
            values.resize(chosen.len(), 0);
            if C::ENCODING {
                for (value, &at) in values.iter_mut().zip(&*chosen) {
                    *value = levels[at as usize * stride + channel];
                }
                for ((symbol, value), &shift) in symbols.iter_mut().zip(&*values).zip(&*shifts) {
                    *symbol = (value.unsigned_abs() >> shift).min(ESCAPE) as u8;
                }
            }
            coder.symbols(magnitudes, contexts, symbols);
            coder.rests(symbols, shifts, values);
            for (sum, value) in sums.iter_mut().zip(&*values) {
                *sum = sum.saturating_add(value.unsigned_abs());
            }
            if !C::ENCODING {
                for (&at, &value) in chosen.iter().zip(&*values) {
                    levels[at as usize * stride + channel] = value;
                }
            }
        }
        for (&at, &sum) in chosen.iter().zip(&*sums) {
            let before = &mut self.before[at as usize];
            *before = before.saturating_add(sum);
        }
    }

    /// Computes the activities of the level's rows.
    fn learn(&mut self, plan: &RahtPlan, level: &LevelRows) {
        if level.count == 0 {
            return;
        }
        let range = level.first - 1..level.first - 1 + level.count;
        for (row, &parent) in plan.parents()[range].iter().enumerate() {
            self.activity[level.first + row] = self.activity[parent as usize].map(|a| a * KEPT);
        }
        let width = self.channels.div_ceil(LANES);
        for (&row, levels) in level.active.iter().zip(level.levels.chunks_exact(width)) {
            let k = level.first + row as usize;
            let levels = &levels.as_flattened()[..self.channels];
            let (triples, rest) = levels.as_chunks::<ACTIVITIES>();
            let mut sums = [0u64; LANES];
            for triple in triples {
                for a in 0..ACTIVITIES {
                    sums[a] += u64::from(triple[a].unsigned_abs());
                }
            }
            rest.iter().zip(&mut sums).for_each(|(v, sum)| *sum += u64::from(v.unsigned_abs()));
            let sums = sums.map(|sum| sum.min(u64::from(u32::MAX)) as u32);
            let per_gain = 1.0 / plan.noise_gain(k);
            let activity = &mut self.activity[k];
            for a in 0..LANES {
                activity[a] += sums[a] as f32 * (self.factors[a] * per_gain);
            }
        }
    }
}

/// Fills `kept` with the numbers of the flags that are set, and returns how many they are.
fn keep(kept: &mut Vec<u32>, flags: &[bool]) -> usize {
    // A branch on what is decoded could not be predicted: every number is entered, and kept if its flag is set.
    kept.resize(flags.len(), 0);
    let mut found = 0;
    for (number, &flag) in flags.iter().enumerate() {
        kept[found] = number as u32;
        found += usize::from(flag);
    }
    kept.truncate(found);
    found
}

/// Finds the contexts and the numbers of plain bits of channel `i` of a group. `position` is `i`, 0 if there is one
/// group only.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt"))]
fn find_contexts(
    above: &[f32],
    sums: &[u32],
    i: usize,
    position: usize,
    contexts: &mut Vec<u8>,
    shifts: &mut Vec<u8>,
) {
    contexts.resize(above.len(), 0);
    shifts.resize(above.len(), 0);
    let out = contexts.iter_mut().zip(shifts);
    for ((context, shift), (&above, &sum)) in out.zip(above.iter().zip(sums)) {
        let expected = expected_in_group(above, sum, i);
        let state = 2 * position + usize::from(sum != 0);
        *context = (state * CLASSES + class_of(expected)) as u8;
        *shift = plain_bits(expected) as u8;
    }
}

const _: () = assert!(SCALE_BITS < 16 && UNGROUPED >= GROUP && LANES > ACTIVITIES);
