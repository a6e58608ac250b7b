//! Inverse RAHT level by level, each level predicted from the one above.
//!
//! The values of a node's children are predicted from the reconstructed means of the node, of
//! its neighbours and of those neighbours' children that are already known; the prediction goes
//! through the same butterflies, and only the difference of the high-pass values is coded.

use super::{FACTOR_BITS, GAIN_BITS, Plan, round_shift};

/// Where the high-pass values come from.
pub(crate) trait Residual {
    /// Called before each octree level; the strength of the prediction there, in 1/16.
    fn start_level(&mut self, depth: usize) -> i64;

    /// The reconstructed high-pass value `k`, given its prediction.
    fn high(&mut self, k: usize, predicted: i64) -> i64;
}

/// Weights of the prediction: the node itself, then by faces, edges, corners shared.
const SELF: i64 = 9;
const NODE: [i64; 4] = [0, 3, 1, 0];
/// The same for a neighbour's child that is already reconstructed.
const CHILD: [i64; 4] = [0, 5, 2, 0];

/// Bounds of a mean: keeps sums of weighted means of a hostile stream within 63 bits.
const MEAN_MAX: i64 = 1 << 50;

/// The merges of a node by child mask, top down: ranks of the first child on either side.
const MERGES: [([(u8, u8); 7], u8); 256] = {
    let mut t = [([(0u8, 0u8); 7], 0u8); 256];
    let mut mask = 0usize;
    while mask < 256 {
        let mut count = 0;
        let mut size = 4; // children per half: x, then y, then z
        while size > 0 {
            let mut at = 0;
            while at < 8 {
                let low = (mask >> at) & ((1 << size) - 1);
                let high = (mask >> (at + size)) & ((1 << size) - 1);
                if low != 0 && high != 0 {
                    let l = (mask & ((1 << at) - 1)).count_ones() as u8;
                    let r = (mask & ((1 << (at + size)) - 1)).count_ones() as u8;
                    t[mask].0[count] = (l, r);
                    count += 1;
                }
                at += 2 * size;
            }
            size /= 2;
        }
        t[mask].1 = count as u8;
        mask += 1;
    }
    t
};

/// For each place of the 3x3x3 neighbourhood: the axes it is off along, and on which sides, as
/// bits of a child index.
const OFFSET: [(u8, u8); 27] = {
    let mut t = [(0u8, 0u8); 27];
    let mut n = 0;
    while n < 27 {
        let d = [n / 9, n / 3 % 3, n % 3];
        let mut k = 0;
        while k < 3 {
            let bit = 4 >> k;
            if d[k] != 1 {
                t[n].0 |= bit;
            }
            if d[k] == 2 {
                t[n].1 |= bit;
            }
            k += 1;
        }
        n += 1;
    }
    t
};

/// Reciprocals of the weight sums, 32 fraction bits.
const RECIPROCAL: [i64; 64] = {
    let mut t = [0i64; 64];
    let mut n = 1;
    while n < 64 {
        t[n] = (1 << 32) / n as i64;
        n += 1;
    }
    t
};

pub(crate) struct ClosedLoop;

impl ClosedLoop {
    /// Reconstructs all values (leaf order, still multiplied by the roots of the leaf weights)
    /// from the DC and from what `source` returns, which is asked for `1..plan.len()` in order.
    pub(crate) fn run<R: Residual>(plan: &Plan, dc: i64, source: &mut R) -> Vec<i64> {
        let mut low = vec![0i64; plan.len()];
        if low.is_empty() {
            return low;
        }
        low[0] = dc;
        let pyramid = plan.pyramid();
        let mut mean = vec![mean_of(dc, pyramid.levels[0].inverse_root[0])];
        let mut k = 1usize;
        for (depth, pair) in pyramid.levels.windows(2).enumerate() {
            let [level, next] = pair else { continue };
            let strength = source.start_level(depth);
            let mut next_mean = vec![0i64; next.first.len()];
            let mut block = 0usize;
            let mut link = 0usize;
            for (at, &mask) in level.mask.iter().enumerate() {
                let base = level.child[at] as usize;
                let (merges, count) = &MERGES[usize::from(mask)];
                let count = usize::from(*count);
                if count == 0 {
                    if mask != 0 {
                        next_mean[base] = mean[at];
                    }
                    continue;
                }
                let links = &level.links[link..level.link_end[block] as usize];
                link = level.link_end[block] as usize;
                block += 1;
                let children = count + 1;
                let mut predicted = [0i64; 7];
                if strength != 0 && !links.is_empty() {
                    let mut acc = [mean[at] * SELF; 8];
                    let mut sum = [SELF; 8];
                    for l in links {
                        let (axes, sides) = OFFSET[usize::from(l.place)];
                        let kind = axes.count_ones() as usize;
                        if NODE[kind] == 0 {
                            continue;
                        }
                        let other = l.node as usize;
                        let other_mask = if other < at { level.mask[other] } else { 0 };
                        let other_mean = mean[other];
                        let mut rank = 0;
                        let mut rest = mask;
                        while rest != 0 {
                            let c = rest.trailing_zeros() as u8;
                            rest &= rest - 1;
                            if (c ^ sides) & axes == 0 {
                                let touching = c ^ axes;
                                if other_mask >> touching & 1 == 1 {
                                    let before = other_mask & ((1u16 << touching) - 1) as u8;
                                    let child = level.child[other] + before.count_ones();
                                    acc[rank] += next_mean[child as usize] * CHILD[kind];
                                    sum[rank] += CHILD[kind];
                                } else {
                                    acc[rank] += other_mean * NODE[kind];
                                    sum[rank] += NODE[kind];
                                }
                            }
                            rank += 1;
                        }
                    }
                    let mut value = [0i64; 8];
                    for i in 0..children {
                        let r = i128::from(RECIPROCAL[sum[i] as usize]);
                        value[i] = ((i128::from(acc[i]) * r) >> 32) as i64;
                    }
                    for m in (0..count).rev() {
                        let (l, r) = (usize::from(merges[m].0), usize::from(merges[m].1));
                        let difference = value[r] - value[l];
                        let gain = i128::from(plan.gain[k + m - 1]);
                        let high = (i128::from(difference) * gain) >> GAIN_BITS;
                        predicted[m] = ((high * i128::from(strength)) >> 4) as i64;
                        let s = i64::from(plan.factor[k + m - 1][1]);
                        let share = i128::from((s * s) >> FACTOR_BITS);
                        value[l] += ((i128::from(difference) * share) >> FACTOR_BITS) as i64;
                    }
                }
                let mut value = [0i64; 8];
                value[0] = low[level.first[at] as usize];
                for m in 0..count {
                    let (l, r) = (usize::from(merges[m].0), usize::from(merges[m].1));
                    let high = i128::from(source.high(k, predicted[m]));
                    let [c, s] = plan.factor[k - 1].map(i128::from);
                    let v = i128::from(value[l]);
                    value[l] = round_shift(c * v - s * high);
                    value[r] = round_shift(s * v + c * high);
                    k += 1;
                }
                for (i, &v) in value[..children].iter().enumerate() {
                    low[next.first[base + i] as usize] = v;
                    next_mean[base + i] = mean_of(v, next.inverse_root[base + i]);
                }
            }
            mean = next_mean;
        }
        low
    }
}

#[inline]
fn mean_of(low: i64, inverse_root: u32) -> i64 {
    let m = (i128::from(low) * i128::from(inverse_root)) >> FACTOR_BITS;
    (m as i64).clamp(-MEAN_MAX, MEAN_MAX)
}
