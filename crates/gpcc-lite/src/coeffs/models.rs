//! Contexts and counters of the magnitudes and signs of coefficients.

use crate::context::{Here, Row, mean_of, others};
use crate::mix::{Mixer, code_mixed};
use crate::model::Bit;
use crate::range::BinaryCoder;
pub(super) use crate::rdoq::BUCKETS;
use crate::rdoq::bucket;
use crate::symbol_coder::SymbolCoder;
use crate::symbols::{self, Symbols};
use std::hint::select_unpredictable;
use std::sync::LazyLock;

/// Unary decisions before the exponential-Golomb escape.
pub(super) const UNARY: usize = 14;
/// Slots up to this one are mixed; what mixing the others saves is less than 0.1 %.
const MIXED: usize = 2;
/// Memory of the counters.
pub(super) const LIMIT: u32 = 250;
/// Rate of the mixers: 2 costs small clouds up to 0.3 %, more than 8 gains nothing.
pub(super) const RATE: i32 = 8;
/// Counters that are mixed for each decision.
const INPUTS: usize = 3;
/// Logarithmic classes of a magnitude in the finer contexts.
pub(super) const CLASSES: usize = 6;
/// Expected magnitudes from here on (8 fraction bits) are coded without their low bits.
const COARSE: u32 = 768;
/// The same where they are symbols; a power of two.
const PLAIN: u32 = 2048;
/// Expected sums of a chunk from here on have no flag that says all are zero.
const BUSY: u32 = 224;

/// Expected sums of all channels from here on have no flag that says all are zero.
const BUSY_ROW: u32 = 512;
/// Classes of what is near a chunk, in the context of its flag beside symbols.
const NEAR: usize = 9;
/// Memory of the counters of flags that have one each, beside symbols.
const FLAG_LIMIT: u32 = 1023;

/// What the context of a decision is made of.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Octree level and axis: `3 depth + axis`.
    pub(super) level: usize,
    /// Sum of the magnitudes already coded here.
    pub(super) coded: u32,
}

/// What the flag of a chunk tells of a magnitude.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Known {
    Nothing,
    /// This one or a later one of the chunk is not zero.
    SomeNotZero,
    /// This one is not zero.
    NotZero,
}

/// Counters of the unary decisions of one coefficient context. The first decision has two: one
/// where the chunk is known not to be zero and its channels before are, then the plain one.
type Unary = [Bit; UNARY + 1];

/// All adaptive state of a group.
pub(super) struct Models {
    /// By channel and expected magnitude.
    expected: Vec<Unary>,
    /// By ancestors, previous and other channels, each in classes.
    parts: Vec<Unary>,
    /// By octree level, axis and coarse expected magnitude.
    level: Vec<Unary>,
    mixers: Vec<[Mixer<INPUTS>; UNARY + 1]>,
    tail: Tail,
    sign: Vec<Bit>,
    /// The same three tables and mixers for the flags of chunks.
    flag: [Vec<Bit>; INPUTS],
    flag_mixers: Vec<Mixer<INPUTS>>,
    /// And for the flags of whole coefficients.
    row: [Vec<Bit>; INPUTS],
    row_mixers: Vec<Mixer<INPUTS>>,
    /// Of whole magnitudes, in place of the counters above: by channel, what is known, the other
    /// channels' part and expected magnitude; none in binary.
    symbols: Vec<Symbols>,
    /// Which of the tables there is a channel's.
    table: Vec<usize>,
}

/// Classes of expected magnitudes that have symbols of their own: quarter-octaves up to a quarter, half
/// octaves above.
const EXPECTED: usize = 28;
/// Quarter-octaves below a quarter.
const FINE: usize = 16;
/// Classes of [`part_of_others`].
const OTHERS: usize = 7;
/// The models of one channel at the start.
static CHANNEL: LazyLock<Vec<Symbols>> = LazyLock::new(|| {
    let model = |i| symbols_prior(i % EXPECTED, i / EXPECTED / OTHERS == 1);
    (0..3 * OTHERS * EXPECTED).map(model).collect()
});
/// Observations that the priors of symbols count for.
const PRIOR: u32 = 6;

/// 0, 1, 2, 3-4, 5-8, above.
#[inline]
fn class(v: u32) -> usize {
    const CLASS: [u8; 10] = [0, 1, 2, 3, 3, 4, 4, 4, 4, 5];
    usize::from(CLASS[v.min(9) as usize])
}

/// Quarter-octave of a sum with 8 fraction bits.
#[inline]
fn quarter(m: u32) -> usize {
    let m = m + 4;
    let log = m.ilog2();
    (4 * (log - 2) + (m >> (log - 2) & 3)) as usize
}

/// Class of an expected magnitude.
#[inline]
fn class_of(expected: u32) -> usize {
    let quarter = quarter(expected);
    (quarter.min(FINE) + quarter.saturating_sub(FINE) / 2).min(EXPECTED - 1)
}

/// Index into `parts`.
#[inline]
pub(super) fn parts(above: u32, previous: u32, coded: u32, who: usize) -> usize {
    let parts = (bucket(above) / 2).min(15) * CLASSES + class(previous);
    (parts * CLASSES + class(coded)) * 4 + who.min(3)
}

/// Low bits of a magnitude with this expectation.
#[inline]
pub(super) fn low_bits(expected: u32) -> u32 {
    if expected < COARSE { 0 } else { (expected / (COARSE / 2)).ilog2() }
}

/// Low bits of a magnitude with this expectation that are coded without a model where the others are a symbol.
#[inline]
pub(super) fn plain_bits(expected: u32) -> u32 {
    (expected | (PLAIN / 2)).ilog2() - (PLAIN / 2).ilog2()
}

/// The magnitude, 16 fraction bits, that a bucket stands for.
pub(super) fn mean_of_bucket(bucket: usize) -> u64 {
    let m = 1u64 << (bucket.min(40) / 2 + 8);
    if bucket % 2 == 1 { m } else { m + m / 2 }
}

/// A counter that starts where magnitudes are geometric with this mean, 16 fraction bits.
pub(super) fn geometric(mean: u64) -> Bit {
    let mean = mean >> low_bits((mean >> 8) as u32);
    let p1 = (mean * 65536 / (mean + (1 << 16))).clamp(300, 65000);
    Bit::with_prior(p1 as u32, 3)
}

/// [`geometric`] of the mean that each bucket stands for.
pub(super) static PRIORS: LazyLock<[Bit; BUCKETS]> =
    LazyLock::new(|| std::array::from_fn(|bucket| geometric(mean_of_bucket(bucket))));

/// Counters that start with the prior of `bucket`.
fn prior(bucket: usize) -> Unary {
    let mut unary = [PRIORS[bucket]; UNARY + 1];
    unary[0] = Bit::default();
    unary
}

/// Symbols that start where magnitudes are geometric with the mean of a class, or half a unit more
/// where some channel is known not to be zero.
fn symbols_prior(class: usize, some: bool) -> Symbols {
    // Of two quarter-octaves, the beginning of the second.
    let quarter = if class < FINE { class } else { 2 * class - FINE + 1 };
    let mean = ((4 + (quarter as u32 & 3)) << (quarter / 4)).saturating_sub(4);
    let mean = mean >> plain_bits(mean);
    Symbols::geometric(mean + if some { 128 } else { 0 }, PRIOR)
}

/// The mean magnitude of the channels already coded here, beside the expected one: 0 if it is
/// zero, 1 up to a quarter of it, then a class per octave; 6 above four times it.
#[inline]
fn part_of_others(coded: u32, before: usize, expected: u32) -> usize {
    // Below 2^24 and 2^25: nothing overflows.
    let mean = 4 * mean_of(coded, before);
    let above = |factor: u32| usize::from(mean > factor * expected);
    usize::from(coded > 0) + above(1) + above(2) + above(4) + above(8) + above(16)
}

impl Models {
    /// Codes a level as a symbol and a raw sign. `base` is the expected magnitude but for
    /// [`others`], and `coded` the sum of the magnitudes already coded here.
    #[inline]
    pub(super) fn level<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        (base, coded): (u32, u32),
        channel: usize,
        known: Known,
        level: i32,
    ) -> i32 {
        const ESCAPE: u32 = symbols::SYMBOLS as u32 - 1;
        let expected = base + others(coded, channel);
        let shift = plain_bits(expected);
        let v = level.unsigned_abs();
        let least = u32::from(known == Known::NotZero && shift == 0);
        let high = (v >> shift).saturating_sub(least);
        let part = part_of_others(coded, channel, expected);
        let at = ((self.table[channel] * 3 + known as usize) * OTHERS + part) * EXPECTED
            + class_of(expected);
        let symbol = coder.code_symbol(&mut self.symbols[at], high.min(ESCAPE) as usize) as u32;
        let mut high = symbol + least;
        if symbol == ESCAPE {
            high = self.tail.escape(coder, high, v >> shift).min(u32::MAX >> shift);
        }
        let m = (high << shift) | coder.code_bits(v & ((1 << shift) - 1), shift);
        let negative = coder.code_bits(u32::from(level < 0), u32::from(m != 0)) != 0;
        select_unpredictable(negative, (m as i32).wrapping_neg(), m as i32)
    }

    pub(super) fn new(channels: usize, chunks: usize, period: Option<u8>) -> Self {
        let tables = period.map_or(0, |p| channels.min(usize::from(p).max(1)));
        let parts = 16 * CLASSES * CLASSES * 4;
        let plain = |n: usize| vec![Bit::default(); n];
        Self {
            expected: (0..channels * BUCKETS).map(|i| prior(i % BUCKETS)).collect(),
            parts: vec![[Bit::default(); UNARY + 1]; parts],
            level: (0..64 * BUCKETS).map(|i| prior(i % BUCKETS)).collect(),
            mixers: vec![[Mixer::new(68_000); UNARY + 1]; channels],
            tail: Tail::new(),
            sign: plain(channels * 9),
            flag: [
                (0..2 * chunks * NEAR * BUCKETS).map(|i| PRIORS[i % BUCKETS]).collect(),
                plain(2 * parts),
                (0..2 * 64 * BUCKETS).map(|i| PRIORS[i / 2 % BUCKETS]).collect(),
            ],
            flag_mixers: vec![Mixer::new(68_000); 2 * chunks],
            row: [plain(256), plain(32 * 64), plain(64 * 64)],
            row_mixers: vec![Mixer::new(68_000); 64],
            symbols: CHANNEL.repeat(tables),
            table: (0..channels).map(|c| c % tables.max(1)).collect(),
        }
    }

    /// Codes whether any channel is not zero; `None` if there is no flag to code.
    #[inline]
    pub(super) fn row<const BY_SYMBOLS: bool, C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        row: &Row,
        level: usize,
        truth: bool,
    ) -> Option<bool> {
        let (expected, above, previous) = row.sums();
        if expected >= BUSY_ROW {
            return None;
        }
        let [a, b, c] = &mut self.row;
        let fine = (bucket(above).min(31) * 8 + previous[0].min(7) as usize) * 8
            + previous[1].min(7) as usize;
        let quarter = quarter(expected).min(63);
        if BY_SYMBOLS {
            return Some(a[quarter * 4 + row.age().min(3)].code(coder, truth, FLAG_LIMIT));
        }
        let bits =
            [&mut a[quarter * 4 + row.age().min(3)], &mut b[fine], &mut c[level * 64 + quarter]];
        Some(code_mixed(coder, &mut self.row_mixers[level & 63], bits, truth, RATE, LIMIT))
    }

    /// Codes whether any of the `size` channels of chunk `chunk` is not zero; `None` if there is
    /// no flag to code. `pending`: some channel of the coefficient is not zero, and all before
    /// are.
    #[inline]
    pub(super) fn any<const BY_SYMBOLS: bool, C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        here: &Here,
        place: Place,
        (chunk, size): (usize, usize),
        pending: bool,
        truth: bool,
    ) -> Option<bool> {
        let [expected, above, previous] = here.sums(size, place.coded);
        if size == 1 || expected >= BUSY {
            return None;
        }
        let m = bucket(expected);
        let [a, b, c] = &mut self.flag;
        let state = usize::from(pending);
        if BY_SYMBOLS {
            let near = 3 * previous.min(2) + place.coded.min(2);
            let at = ((2 * chunk + state) * NEAR + near as usize) * BUCKETS + m;
            return Some(a[at].code(coder, truth, FLAG_LIMIT));
        }
        let bits = [
            &mut a[(2 * chunk + state) * BUCKETS + m],
            &mut b[2 * parts(above, previous, place.coded, chunk) + state],
            &mut c[2 * (place.level * BUCKETS + m) + state],
        ];
        Some(code_mixed(coder, &mut self.flag_mixers[2 * chunk + state], bits, truth, RATE, LIMIT))
    }

    /// Codes the magnitude of the chunk's channel `i`, which is number `channel`, and begins
    /// with what is known.
    #[inline]
    pub(super) fn magnitude<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        here: &Here,
        place: Place,
        (i, channel): (usize, usize),
        known: Known,
        v: u32,
    ) -> u32 {
        let m = here.expected(i, place.coded);
        let b = bucket(m);
        // Low bits whose distribution is flat at this scale go out unmodelled.
        let shift = low_bits(m);
        let high = v >> shift;
        let previous = here.previous[0].get(i) + here.previous[1].get(i);
        let x = &mut self.expected[channel * BUCKETS + b];
        let y = &mut self.parts[parts(here.above[i], previous, place.coded, channel)];
        let z = &mut self.level[place.level * BUCKETS + b];
        let mixers = &mut self.mixers[channel];
        let mut u = usize::from(known == Known::NotZero && shift == 0);
        let mut slot = if known == Known::Nothing { 1 } else { 0 };
        while u < UNARY {
            slot = slot.max(u + usize::from(u > 0));
            let more = if slot <= MIXED {
                let bits = [&mut x[slot], &mut y[slot], &mut z[slot]];
                code_mixed(coder, &mut mixers[slot], bits, high > u as u32, RATE, LIMIT)
            } else {
                x[slot].code(coder, high > u as u32, LIMIT)
            };
            if !more {
                break;
            }
            u += 1;
        }
        self.tail.code(coder, m, (u as u32, u == UNARY), v)
    }

    /// Codes a sign, true for negative; `signs` sums up those of the two channels before.
    #[inline]
    pub(super) fn sign<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        channel: usize,
        signs: usize,
        truth: bool,
    ) -> bool {
        self.sign[channel * 9 + signs].code(coder, truth, 1023)
    }
}

/// What follows the modelled part of a magnitude.
pub(super) struct Tail {
    /// Of the highest of the low bits, by expected magnitude and what is above.
    low: Vec<[Bit; 4]>,
    escape: [Bit; 32],
}

impl Tail {
    pub(super) fn new() -> Self {
        Self { low: vec![[Bit::default(); 4]; BUCKETS], escape: [Bit::default(); 32] }
    }

    /// Codes what `v` has beyond `high`, all of which is coded.
    #[cold]
    fn escape<C: BinaryCoder>(&mut self, coder: &mut C, high: u32, v: u32) -> u32 {
        let rest = code_exp_golomb(coder, &mut self.escape, v.saturating_sub(high));
        high.saturating_add(rest)
    }

    /// Codes what `v` has beyond `high`, which is all above its low bits unless it has `escaped`.
    #[inline]
    pub(super) fn code<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        expected: u32,
        (mut high, escaped): (u32, bool),
        v: u32,
    ) -> u32 {
        let shift = low_bits(expected);
        if escaped {
            high = self.escape(coder, high, v >> shift).min(u32::MAX >> shift);
        }
        if shift == 0 {
            return high;
        }
        let top = &mut self.low[bucket(expected)][high.min(3) as usize];
        let top = u32::from(top.code(coder, v >> (shift - 1) & 1 == 1, LIMIT));
        let rest = shift - 1;
        let low = if rest > 0 { coder.code_raw_wide(v & ((1 << rest) - 1), rest) } else { 0 };
        (high << shift) | (top << rest) | low
    }
}

/// Exponential Golomb with modelled prefix.
fn code_exp_golomb<C: BinaryCoder>(coder: &mut C, model: &mut [Bit; 32], v: u32) -> u32 {
    let v1 = u64::from(v) + 1;
    let bits = v1.ilog2();
    let mut k = 0;
    while k < 31 && model[k as usize].code(coder, bits > k, LIMIT) {
        k += 1;
    }
    let low = coder.code_raw_wide((v1 & ((1 << k) - 1)) as u32, k);
    (((1u64 << k) | u64::from(low)) - 1) as u32
}
