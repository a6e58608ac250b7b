//! [`sort`]: a parallel radix sort of Morton codes.
//!
//! *Invariant:* the sort is stable, and its result does not depend on the number of threads.

use rayon::prelude::*;

use crate::pages::Pages;
use crate::parallel::CHUNK;

/// Bits of a radix pass. The write positions of that many buckets fit the first-level cache, and
/// the index in a bucket of [`SMALL`] entries fits beside the unsorted bits of a code.
const DIGIT_BITS: u32 = 11;

/// Buckets of at most this many entries are sorted by comparison.
const SMALL: usize = 1 << DIGIT_BITS;

/// Ranges longer than this are scattered in parallel, in parts.
const PARALLEL: usize = 1 << 16;

/// Buckets of ranges longer than this are sorted in parallel.
const MANY: usize = 2 * SMALL;

/// Parts in which a long range is scattered at the same time.
const PARTS: usize = 8;

/// Sorts `codes` (fewer than 2^32). Returns the old index of each; ties ascend.
///
/// A radix sort from the most significant digit that differs, linear in the number of codes.
pub(crate) fn sort(codes: &mut [u64]) -> Vec<u32> {
    let len = codes.len();
    let mut members = vec![0u32; len];
    let bits = differing_bits(len, &|i| codes[i]);
    if len <= SMALL || bits == 0 {
        let entries: Vec<Entry> = (0..len).map(|i| entry(codes[i], i as u32)).collect();
        sort_small(&entries, bits, codes, &mut members);
        return members;
    }
    let mut entries = Pages::<Entry>::zeroed(len);
    let shift = bits.saturating_sub(DIGIT_BITS);
    let ends = scatter(len, &|i| entry(codes[i], i as u32), &mut entries, shift);
    // Untouched, and so without memory, unless a bucket is large.
    let mut spare = Pages::<Entry>::zeroed(len);
    let range = Part { entries: &mut entries, spare: &mut spare, codes, members: &mut members };
    sort_buckets(range, &ends, shift);
    members
}

/// Low and high half of a code, and its Gaussian. With a `u64` it would be four bytes longer.
type Entry = [u32; 3];

fn entry(code: u64, member: u32) -> Entry {
    [code as u32, (code >> 32) as u32, member]
}

fn code(entry: &Entry) -> u64 {
    u64::from(entry[0]) | u64::from(entry[1]) << 32
}

/// Entries to sort, as much free memory, and the place of the result; all equally long.
struct Part<'a> {
    entries: &'a mut [Entry],
    spare: &'a mut [Entry],
    codes: &'a mut [u64],
    members: &'a mut [u32],
}

/// One more than the highest bit in which any two of `len` codes differ; 0 if none do.
fn differing_bits(len: usize, code: &(impl Fn(usize) -> u64 + Sync)) -> u32 {
    let of = |range: std::ops::Range<usize>| {
        range.map(code).fold((u64::MAX, 0), |(all, any), c| (all & c, any | c))
    };
    let (all, any) = if len > PARALLEL {
        let chunks = (0..len.div_ceil(CHUNK)).into_par_iter();
        chunks
            .map(|c| of(c * CHUNK..len.min((c + 1) * CHUNK)))
            .reduce(|| (u64::MAX, 0), |a, b| (a.0 & b.0, a.1 | b.1))
    } else {
        of(0..len)
    };
    if len == 0 { 0 } else { u64::BITS - (all ^ any).leading_zeros() }
}

/// Sorts each bucket; the codes of a bucket differ in the `bits` low bits only.
fn sort_buckets(range: Part<'_>, ends: &[usize], bits: u32) {
    let parallel = range.entries.len() > MANY;
    let mut buckets = Vec::with_capacity(ends.len());
    let Part { mut entries, mut spare, mut codes, mut members } = range;
    let mut start = 0;
    for &end in ends {
        let n = end - start;
        let (a, b) = (entries.split_at_mut(n), spare.split_at_mut(n));
        let (c, d) = (codes.split_at_mut(n), members.split_at_mut(n));
        if n > 0 {
            buckets.push(Part { entries: a.0, spare: b.0, codes: c.0, members: d.0 });
        }
        (entries, spare, codes, members) = (a.1, b.1, c.1, d.1);
        start = end;
    }
    if parallel {
        buckets.into_par_iter().for_each(|bucket| sort_bucket(bucket, bits));
    } else {
        buckets.into_iter().for_each(|bucket| sort_bucket(bucket, bits));
    }
}

fn sort_bucket(range: Part<'_>, bits: u32) {
    let Part { entries, spare, codes, members } = range;
    let len = entries.len();
    if len <= SMALL || bits == 0 {
        sort_small(entries, bits, codes, members);
        return;
    }
    // Few bits may differ: with one distant floater, all other codes fall into one bucket.
    let bits = differing_bits(len, &|i| code(&entries[i]));
    if bits == 0 {
        sort_small(entries, 0, codes, members);
        return;
    }
    let shift = bits.saturating_sub(DIGIT_BITS);
    let ends = scatter(len, &|i| entries[i], spare, shift);
    sort_buckets(Part { entries: spare, spare: entries, codes, members }, &ends, shift);
}

/// Writes the entries out, sorted by their `bits` low bits. There are at most [`SMALL`], unless
/// `bits` is 0.
fn sort_small(entries: &[Entry], bits: u32, codes: &mut [u64], members: &mut [u32]) {
    if bits == 0 {
        for ((entry, c), m) in entries.iter().zip(codes).zip(members) {
            (*c, *m) = (code(entry), entry[2]);
        }
    } else if bits + DIGIT_BITS <= u64::BITS {
        // One number each: the code, then the index.
        let mask = (1u64 << bits) - 1;
        for ((i, entry), key) in entries.iter().enumerate().zip(codes.iter_mut()) {
            *key = (code(entry) & mask) << DIGIT_BITS | i as u64;
        }
        codes.sort_unstable();
        let above = code(&entries[0]) & !mask;
        for (key, m) in codes.iter_mut().zip(members) {
            *m = entries[(*key & (SMALL as u64 - 1)) as usize][2];
            *key = above | *key >> DIGIT_BITS;
        }
    } else {
        let mut order: Vec<(u64, u32)> = entries.iter().map(|e| (code(e), e[2])).collect();
        order.sort_unstable();
        for ((pair, c), m) in order.into_iter().zip(codes).zip(members) {
            (*c, *m) = pair;
        }
    }
}

/// Stable counting sort of `len` entries by the digit at `shift`. Returns the end of every digit's
/// bucket.
///
/// The parts of a long range are scattered in parallel. Each part has its own slice of every
/// bucket, and these slices are in the order of the parts, so the result is the same.
fn scatter(
    len: usize,
    entry: &(impl Fn(usize) -> Entry + Sync),
    to: &mut [Entry],
    shift: u32,
) -> Vec<usize> {
    const DIGITS: usize = 1 << DIGIT_BITS;
    let digit = |e: &Entry| (code(e) >> shift) as usize % DIGITS;
    let parts = if len > PARALLEL { PARTS } else { 1 };
    let range = |part: usize| part * len / parts..(part + 1) * len / parts;
    let count = |part: usize| {
        let mut counts = vec![0usize; DIGITS];
        range(part).for_each(|i| counts[digit(&entry(i))] += 1);
        counts
    };
    let counts: Vec<Vec<usize>> =
        if parts > 1 { (0..parts).into_par_iter().map(count).collect() } else { vec![count(0)] };
    let mut heads: Vec<Vec<std::slice::IterMut<'_, Entry>>> =
        (0..parts).map(|_| Vec::with_capacity(DIGITS)).collect();
    let mut ends = Vec::with_capacity(DIGITS);
    let (mut rest, mut end) = (to, 0);
    for digit in 0..DIGITS {
        for (heads, counts) in heads.iter_mut().zip(&counts) {
            let (head, tail) = rest.split_at_mut(counts[digit]);
            heads.push(head.iter_mut());
            rest = tail;
            end += counts[digit];
        }
        ends.push(end);
    }
    let fill = |part: usize, mut heads: Vec<std::slice::IterMut<'_, Entry>>| {
        for i in range(part) {
            let e = entry(i);
            // There is a slot for each, because they were counted.
            if let Some(slot) = heads[digit(&e)].next() {
                *slot = e;
            }
        }
    };
    if parts > 1 {
        heads.into_par_iter().enumerate().for_each(|(part, heads)| fill(part, heads));
    } else {
        heads.into_iter().enumerate().for_each(|(part, heads)| fill(part, heads));
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sorts_like_the_standard_library() {
        let cases = [(0, 0), (1, 5), (2000, 63), (2000, 30), (5000, 63), (50_000, 12), (9000, 0)];
        for (len, bits) in cases.into_iter().chain([(200_000, 63), (200_000, 9), (100_000, 40)]) {
            check_sort(len, bits);
        }
    }

    /// One code is far from the rest, which all have the same first digit.
    #[test]
    fn sorts_beside_a_floater() {
        let mut codes: Vec<u64> =
            (0..150_000u64).map(|i| i.wrapping_mul(0x9e37_79b9) % 65_536).collect();
        codes.push(1 << 62);
        check(codes);
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
        check(codes);
    }

    fn check(codes: Vec<u64>) {
        let mut want: Vec<(u64, u32)> = codes.iter().copied().zip(0..).collect();
        want.sort();
        let mut sorted = codes;
        let members = sort(&mut sorted);
        let got: Vec<_> = sorted.into_iter().zip(members).collect();
        assert_eq!(got, want);
    }
}
