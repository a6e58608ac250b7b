//! [`MortonOrder`]: the one sort of the crate.

use gpcc_lite::morton;
use gs_model::Scene;
use rayon::prelude::*;

use crate::cube::Cube;
use crate::error::{Error, Result};

/// Gaussians per parallel work item. Fixed, so that no result depends on the thread count.
pub(crate) const CHUNK: usize = 4096;

/// Bits per pass of the radix sort: 2^11 counters fit the first-level cache, and 63 bits take
/// six passes.
const DIGIT_BITS: u32 = 11;

/// The Gaussians of a scene in Morton order at one depth.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MortonOrder {
    /// Ascending Morton codes at `depth`.
    pub(crate) codes: Vec<u64>,
    /// `members[i]` is the Gaussian whose code is `codes[i]`; ties ascend.
    pub(crate) members: Vec<u32>,
}

impl MortonOrder {
    /// Codes every mean at `depth` and sorts. Linear in the number of Gaussians.
    pub(crate) fn of(scene: &Scene, cube: &Cube, depth: u8) -> Result<Self> {
        let len = scene.len();
        if u32::try_from(len).is_err() {
            return Err(Error::TooMany(len));
        }
        let mut codes = vec![0u64; len];
        let first_outside = codes
            .par_chunks_mut(CHUNK)
            .zip(scene.means.par_chunks(CHUNK))
            .enumerate()
            .filter_map(|(chunk, (codes, means))| {
                for (i, (code, mean)) in codes.iter_mut().zip(means).enumerate() {
                    match cube.index_of(*mean, depth) {
                        Some(index) => *code = morton::encode(index),
                        None => return Some(chunk * CHUNK + i),
                    }
                }
                None
            })
            .min();
        if let Some(index) = first_outside {
            let finite = scene.means[index].iter().all(|x| x.is_finite());
            return Err(if finite {
                Error::OutsideCube { index }
            } else {
                Error::NonFiniteMean { index }
            });
        }
        Ok(Self::sorted(codes))
    }

    /// Sorts the codes of Gaussians 0, 1, ... (fewer than 2^32).
    pub(crate) fn sorted(codes: Vec<u64>) -> Self {
        let members = (0..codes.len() as u32).collect();
        let mut order = Self { codes, members };
        order.sort();
        order
    }

    /// Radix sort; stable, so ties keep the order of the scene. One pass by the most significant
    /// digit that differs, then the buckets on their own, in parallel.
    fn sort(&mut self) {
        let len = self.codes.len();
        let (all, any) = self.codes.iter().fold((u64::MAX, 0), |(a, o), &c| (a & c, o | c));
        let significant = u64::BITS - (all ^ any).leading_zeros();
        if len == 0 || significant == 0 {
            return;
        }
        let shift = significant.saturating_sub(DIGIT_BITS);
        let mut codes = vec![0u64; len];
        let mut members = vec![0u32; len];
        let ends = scatter(&self.codes, &self.members, &mut codes, &mut members, shift);
        let mut buckets = Vec::new();
        let mut rest =
            (&mut codes[..], &mut members[..], &mut self.codes[..], &mut self.members[..]);
        let mut start = 0;
        for end in ends {
            let (a, b, c, d) = rest;
            let (a, b) = (a.split_at_mut(end - start), b.split_at_mut(end - start));
            let (c, d) = (c.split_at_mut(end - start), d.split_at_mut(end - start));
            buckets.push((a.0, b.0, c.0, d.0));
            rest = (a.1, b.1, c.1, d.1);
            start = end;
        }
        buckets.par_iter_mut().for_each(|(codes, members, spare_codes, spare_members)| {
            sort_bucket(codes, members, spare_codes, spare_members, shift);
        });
        drop(buckets);
        (self.codes, self.members) = (codes, members);
    }
}

/// Stable counting sort by the digit at `shift`; returns the end of every digit's bucket.
fn scatter(
    codes: &[u64],
    members: &[u32],
    to_codes: &mut [u64],
    to_members: &mut [u32],
    shift: u32,
) -> Vec<usize> {
    let mask = (1u64 << DIGIT_BITS) - 1;
    let mut starts = vec![0usize; 1 << DIGIT_BITS];
    for &code in codes {
        starts[((code >> shift) & mask) as usize] += 1;
    }
    let mut total = 0;
    for start in &mut starts {
        total += std::mem::replace(start, total);
    }
    for (&code, &member) in codes.iter().zip(members) {
        let to = &mut starts[((code >> shift) & mask) as usize];
        to_codes[*to] = code;
        to_members[*to] = member;
        *to += 1;
    }
    // Every start has moved to its bucket's end.
    starts
}

/// Sorts by the `bits` low bits, in place; the spare slices are as long.
fn sort_bucket(
    codes: &mut [u64],
    members: &mut [u32],
    spare_codes: &mut [u64],
    spare_members: &mut [u32],
    bits: u32,
) {
    // Clearing the counters of a radix pass costs more than comparing so few.
    if codes.len() < 1 << DIGIT_BITS {
        let mut pairs: Vec<(u64, u32)> =
            codes.iter().copied().zip(members.iter().copied()).collect();
        pairs.sort_by_key(|&(code, _)| code);
        for ((code, member), pair) in codes.iter_mut().zip(members.iter_mut()).zip(pairs) {
            (*code, *member) = pair;
        }
        return;
    }
    for pass in 0..bits.div_ceil(DIGIT_BITS) {
        scatter(codes, members, spare_codes, spare_members, pass * DIGIT_BITS);
        codes.copy_from_slice(spare_codes);
        members.copy_from_slice(spare_members);
    }
}

/// End of the run, starting at `start`, of codes that share their cell at `depth`.
pub(crate) fn cell_end(codes: &[u64], start: usize, j_high: u8, depth: u8) -> usize {
    let shift = 3 * u32::from(j_high - depth);
    let cell = codes[start] >> shift;
    // Galloping: cheap for the short runs that most cells are, logarithmic for long ones.
    let mut step = 1;
    let mut low = start;
    while low + step < codes.len() && codes[low + step] >> shift == cell {
        low += step;
        step *= 2;
    }
    let high = (low + step).min(codes.len());
    low + codes[low..high].partition_point(|&c| c >> shift == cell)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sorts_like_the_standard_library() {
        for (len, bits) in [(0, 0), (1, 5), (5000, 63), (50_000, 63), (50_000, 12), (9000, 0)] {
            check_sort(len, bits);
        }
    }

    fn check_sort(len: usize, bits: u32) {
        let mut x = 0x9e37_79b9_7f4a_7c15_u64;
        let codes: Vec<u64> = (0..len)
            .map(|i| {
                x ^= x << 13;
                x ^= x >> 7;
                x ^= x << 17;
                let code = if i % 3 == 0 { x % 17 } else { x >> 1 };
                code & ((1 << bits) - 1)
            })
            .collect();
        let mut want: Vec<(u64, u32)> = codes.iter().copied().zip(0..).collect();
        want.sort();
        let order = MortonOrder::sorted(codes);
        let got: Vec<_> = order.codes.iter().copied().zip(order.members).collect();
        assert_eq!(got, want);
    }

    #[test]
    fn cell_end_agrees_with_a_scan() {
        let codes: Vec<u64> = (0..300u64).map(|i| i * i / 7).collect();
        for depth in 0..=6 {
            let shift = 3 * (6 - depth);
            for start in 0..codes.len() {
                let scan = (start..codes.len())
                    .find(|&i| codes[i] >> shift != codes[start] >> shift)
                    .unwrap_or(codes.len());
                assert_eq!(cell_end(&codes, start, 6, depth as u8), scan);
            }
        }
    }
}
