//! A second decoder of attributes, written from the documentation of `coefficients`: one list per
//! thing, no lanes, every class and weight computed where it is used. It must return what
//! `attribute::decode` does, bit for bit.

mod common;

use std::collections::BTreeMap;

use common::{any_octree, any_weights, power_of_two, rows_of};
use gpcc_lite::attribute::{self, Quantisation};
use gpcc_lite::coder::{Coder, RansDecoder, RansEncoder};
use gpcc_lite::model::{Bit, Symbols};
use gpcc_lite::raht::{RahtPlan, Rows};
use gpcc_lite::{Leaf, Octree, morton};
use proptest::prelude::*;

/// Elias gamma.
fn gamma(coder: &mut RansDecoder<'_>) -> u32 {
    let mut zeros = 0;
    while zeros < 32 && coder.bits(0, 1) == 0 {
        zeros += 1;
    }
    ((1u64 << zeros) + u64::from(coder.bits(0, zeros)) - 1).min(u64::from(u32::MAX)) as u32
}

/// Class of an expectation: half-octaves above 1/16.
fn class(expected: f32) -> usize {
    let mut x = expected + 1.0 / 16.0;
    let mut class = 0;
    while x >= 2.0 / 16.0 {
        x /= 2.0;
        class += 2;
    }
    class + usize::from(x >= 1.5 / 16.0)
}

/// Number of plain low bits: those below the leading three of the expected magnitude.
fn plain_bits(mut expected: f32) -> u32 {
    let mut bits = 0;
    while expected >= 8.0 && bits < 30 {
        expected /= 2.0;
        bits += 1;
    }
    bits
}

/// The model of a magnitude before anything was learned.
fn magnitude_model(class: usize, group_is_zero: bool, channels: usize) -> Symbols {
    let octave = (0..class / 2).fold(1.0 / 16.0, |x, _| 2.0 * x);
    let mean: f32 = octave * [1.25, 1.75][class % 2] - 1.0 / 16.0;
    let above_plain = (0..plain_bits(mean)).fold(mean, |m, _| m / 2.0);
    let more = if group_is_zero && channels > 1 { 0.25 } else { 0.0 };
    Symbols::geometric(((above_plain + more) * 256.0) as u32, 8)
}

/// One merge: leaves `start..middle` and `middle..end`.
struct Merge {
    bit: u32,
    start: usize,
    middle: usize,
    end: usize,
    /// First leaf of the right half of the merge above.
    above: Option<usize>,
}

fn merges(leaves: &[Leaf], start: usize, end: usize, above: Option<usize>, out: &mut Vec<Merge>) {
    if end - start < 2 {
        return;
    }
    let bit = 63 - (leaves[start].morton ^ leaves[end - 1].morton).leading_zeros();
    let middle = (start..end).find(|&i| leaves[i].morton >> bit & 1 == 1).unwrap();
    out.push(Merge { bit, start, middle, end, above });
    merges(leaves, start, middle, Some(middle), out);
    merges(leaves, middle, end, Some(middle), out);
}

impl Merge {
    /// Sums of weights and of squared weights, left and right.
    fn sums(&self, weights: &[u32]) -> [[f64; 2]; 2] {
        [self.start..self.middle, self.middle..self.end].map(|r| {
            let w = weights[r].iter().map(|&w| f64::from(w));
            [w.clone().sum(), w.map(|w| w * w).sum()]
        })
    }

    /// The share of the right half, the factor to a difference of means, and the noise gain.
    fn factors(&self, weights: &[u32]) -> [f32; 3] {
        let [[w1, s1], [w2, s2]] = self.sums(weights);
        let inverse = (w1 + w2) / (w1 * w2);
        let gain = ((s1 / (w1 * w1) + s2 / (w2 * w2)) / inverse).sqrt();
        [(w2 / (w1 + w2)) as f32, inverse.sqrt() as f32, gain as f32]
    }
}

/// Models and activities of one group of channels.
struct State {
    channels: usize,
    rows: BTreeMap<usize, Bit>,
    groups: BTreeMap<(usize, usize), Bit>,
    magnitudes: BTreeMap<(usize, bool, usize), Symbols>,
    /// By the first leaf of the merge's right half.
    activity: BTreeMap<usize, [f32; 3]>,
}

impl State {
    /// Which of the rows a flag is set for.
    fn row_flags(&mut self, coder: &mut RansDecoder<'_>, expected: &[[f32; 3]]) -> Vec<usize> {
        if self.channels == 1 {
            return (0..expected.len()).collect();
        }
        let mut active = Vec::new();
        for (row, [a, b, c]) in expected.iter().enumerate() {
            let model = self.rows.entry(class(2.0 * (a + b + c)).min(15)).or_default();
            if model.code(coder, false, 1023) {
                active.push(row);
            }
        }
        active
    }

    /// The quantised values of a level's rows.
    fn level(&mut self, coder: &mut RansDecoder<'_>, expected: &[[f32; 3]]) -> Vec<Vec<i32>> {
        let channels = self.channels;
        let mut values = vec![vec![0i32; channels]; expected.len()];
        let active = self.row_flags(coder, expected);
        let all: Vec<usize> = (0..channels).collect();
        let groups: Vec<&[usize]> = all.chunks(if channels > 6 { 3 } else { channels }).collect();
        for (number, group) in groups.iter().enumerate() {
            let mut chosen = active.clone();
            if groups.len() > 1 {
                chosen.retain(|&row| {
                    let [a, b, c] = expected[row];
                    let before: u32 = values[row].iter().map(|v| v.unsigned_abs()).sum();
                    let state = match before {
                        0 if number + 1 == groups.len() => 3,
                        0 => 0,
                        _ if 2 * before as usize > 3 * number => 2,
                        _ => 1,
                    };
                    let model = self.groups.entry((state, class(2.0 * (a + b + c)).min(15)));
                    model.or_default().code(coder, false, 1023)
                });
            }
            for (i, &channel) in group.iter().enumerate() {
                for &row in &chosen {
                    let sum: u32 = group[..i].iter().map(|&c| values[row][c].unsigned_abs()).sum();
                    let above = expected[row][channel % 3];
                    let expected = match i {
                        0 => above,
                        _ => (3.0 * above + sum as f32) * (1.0 / (3 + i) as f32),
                    };
                    values[row][channel] = self.value(coder, i, sum != 0, expected);
                }
            }
        }
        values
    }

    fn value(&mut self, coder: &mut RansDecoder<'_>, i: usize, some: bool, expected: f32) -> i32 {
        let (class, plain, channels) =
            (class(expected).min(15), plain_bits(expected), self.channels);
        let position = if channels > 6 { i } else { 0 };
        let model = self.magnitudes.entry((position, some, class));
        let model = model.or_insert_with(|| magnitude_model(class, !some, channels));
        let mut high = coder.symbol(model, 0) as u32;
        if high == 15 {
            high += gamma(coder);
        }
        let magnitude = ((high << plain) + coder.bits(0, plain)) as i32;
        if magnitude != 0 && coder.bits(0, 1) == 1 { -magnitude } else { magnitude }
    }

    /// What a merge passes on to the merges below.
    fn learn(&mut self, merge: &Merge, gain: f32, values: &[i32]) {
        let above = merge.above.map_or([0.0; 3], |m| self.activity[&m]);
        let own: [f32; 3] = std::array::from_fn(|a| {
            let members: Vec<u32> =
                values.iter().skip(a).step_by(3).map(|v| v.unsigned_abs()).collect();
            let share = 0.5 / members.len().max(1) as f32;
            above[a] * 0.5 + members.iter().sum::<u32>() as f32 * (share * (1.0 / gain))
        });
        self.activity.insert(merge.middle, own);
    }
}

fn decode(bytes: &[u8], leaves: &[Leaf], weights: &[u32], steps: &[f32]) -> Vec<Vec<f32>> {
    let channels = steps.len();
    let mut coder = RansDecoder::new(bytes).unwrap();
    let mut rows = vec![vec![0f32; channels]; leaves.len()];
    if leaves.is_empty() {
        return rows;
    }
    let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
    for c in 0..channels {
        let folded = i64::from(gamma(&mut coder));
        let level = if folded % 2 == 0 { folded / 2 } else { -(folded + 1) / 2 };
        rows[0][c] = (level as f64 * f64::from(steps[c]) / total.sqrt()) as f32;
    }
    let mut list = Vec::new();
    merges(leaves, 0, leaves.len(), None, &mut list);
    list.sort_by_key(|m| (u32::MAX - m.bit, m.middle));
    let mut state = State {
        channels,
        rows: BTreeMap::new(),
        groups: BTreeMap::new(),
        magnitudes: BTreeMap::new(),
        activity: BTreeMap::new(),
    };
    for level in list.chunk_by(|a, b| a.bit == b.bit) {
        let expected: Vec<[f32; 3]> = level
            .iter()
            .map(|m| {
                let above = m.above.map_or([0.0; 3], |m| state.activity[&m]);
                above.map(|a| a * m.factors(weights)[2])
            })
            .collect();
        let values = state.level(&mut coder, &expected);
        for (merge, values) in level.iter().zip(&values) {
            let [share, scale, gain] = merge.factors(weights);
            state.learn(merge, gain, values);
            for c in 0..channels {
                let difference = values[c] as f32 * steps[c] * scale;
                rows[merge.start][c] -= difference * share;
                rows[merge.middle][c] = rows[merge.start][c] + difference;
            }
        }
    }
    coder.finish().unwrap();
    rows
}

/// Encodes rows and compares both decoders.
fn compare(tree: &Octree, weights: &[u32], steps: &[f32], lambda: f32, rows: &Rows) {
    let plan = RahtPlan::new(tree.clone()).weighted(weights).unwrap();
    let mut told = rows.clone();
    let mut coder = RansEncoder::default();
    attribute::encode(&mut coder, &plan, &Quantisation { steps, lambda }, &mut told).unwrap();
    let bytes = coder.finish();
    let mut read = Rows::new(tree.len(), steps.len());
    attribute::decode(&mut RansDecoder::new(&bytes).unwrap(), &plan, steps, &mut read).unwrap();
    let second = decode(&bytes, tree.leaves(), weights, steps);
    for (i, row) in second.iter().enumerate() {
        assert_eq!(row, read.row(i), "leaf {i} of {}, {} channels", tree.len(), steps.len());
    }
}

const CHANNELS: [usize; 8] = [1, 3, 6, 7, 9, 11, 15, 21];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn a_second_decoder_agrees(
        tree in any_octree(), seed: u64, log_step in -6i32..10, lambda in 0.0f32..0.3,
        channels in prop::sample::select(CHANNELS.to_vec()),
    ) {
        let weights = any_weights(tree.len(), seed);
        let rows = rows_of(tree.len(), channels, seed, 1);
        compare(&tree, &weights, &vec![power_of_two(log_step); channels], lambda, &rows);
    }
}

/// A slanted plane of leaves with smooth values and some noise: the statistics of real attributes.
#[test]
fn a_second_decoder_agrees_on_a_plane() {
    let point = |i: u32| {
        let (x, y) = (i % 64, i / 64);
        (morton::encode([x, y, (x + 2 * y) / 3]), x as f32, y as f32)
    };
    let mut points: Vec<(u64, f32, f32)> = (0..4096).map(point).collect();
    points.sort_by_key(|p| p.0);
    let leaves = points.iter().map(|p| Leaf { morton: p.0, depth: 7 });
    let tree = Octree::of_points(7, leaves.collect()).unwrap();
    for channels in CHANNELS {
        let noise = rows_of(tree.len(), channels, 9, 1);
        let mut rows = Rows::new(tree.len(), channels);
        for (i, &(_, x, y)) in points.iter().enumerate() {
            for c in 0..channels {
                let smooth = 2.0 * x - y + x * y / (9.0 + c as f32);
                rows.row_mut(i)[c] = smooth + noise.row(i)[c] / (8 << (c % 5)) as f32;
            }
        }
        for (seed, step, lambda) in [(4, 0.01, 0.0), (4, 6.0, 0.1), (5, 0.3, 0.1), (6, 20.0, 0.1)] {
            let weights = any_weights(tree.len(), seed);
            compare(&tree, &weights, &vec![step; channels], lambda, &rows);
        }
    }
}
