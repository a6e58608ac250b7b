//! Slices: runs of consecutive leaves that are coded apart.
//!
//! A slice has its own octree, transform and coder state, so that slices are coded on different
//! cores, in memory that fits a cache, and can be handed on before the next is finished. Each
//! section holds one payload per slice, so that sections keep their order in the stream. A slice
//! costs what its counters must learn again; hence small scenes are one slice.

use crate::error::{Error, Result};
use crate::options::{CovarianceMode, EncodeOptions, Entropy};
use crate::stream::{Reader, Writer};
use std::ops::Range;

/// Fewest leaves of a slice where there is more than one: bounds their number, and what a decoder
/// spends on each, by the number of leaves.
pub(crate) const LEAST: u64 = 1 << 12;
/// Leaves of a slice that an encoder aims at: twice as many would cost decoders memory, half as many
/// 0.3 % more bytes.
const SIZE: usize = 1 << 18;
/// Fewest leaves of which an encoder makes two slices, so that both cores decode geometry too, and
/// takes symbols for [`Entropy::Range`]. Smaller scenes learn too slowly for that, and are decoded in
/// less than 0.08 s all the same.
pub(crate) const TWO: usize = 1 << 16;

/// The number of slices an encoder makes: an even one, for two cores. What is said once for all
/// Gaussians (a codebook, the ranges behind the paper's steps) would have to be said in each: such
/// streams have one.
pub(crate) fn count(leaves: usize, options: &EncodeOptions) -> usize {
    if options.paper_qp.is_some() || options.covariance != CovarianceMode::Transform {
        return 1;
    }
    let wanted = match options.slices {
        Some(wanted) => wanted.get(),
        None if leaves < if options.entropy == Entropy::Small { SIZE } else { TWO } => 1,
        None => 2 * ((leaves + SIZE) / (2 * SIZE)).max(1),
    };
    wanted.min((leaves as u64 / LEAST) as usize).max(1)
}

/// The leaves of slice `slice` of `slices`, as an encoder cuts them: all of about the same size.
#[must_use]
pub fn range(leaves: usize, slices: usize, slice: usize) -> Range<usize> {
    let at = |i: usize| (leaves as u128 * i as u128 / slices as u128) as usize;
    at(slice)..at(slice + 1)
}

/// Puts the payloads of all slices into that of a section: lengths of all but the last, then the
/// payloads.
pub(crate) fn join(parts: Vec<Vec<u8>>) -> Vec<u8> {
    let mut parts = parts;
    if parts.len() == 1
        && let Some(only) = parts.pop()
    {
        return only;
    }
    let mut out = Writer::default();
    for part in parts.iter().rev().skip(1).rev() {
        out.varint(part.len() as u64);
    }
    for part in parts {
        out.bytes.extend(part);
    }
    out.bytes
}

/// Takes a section's payload apart: undoes [`join`].
///
/// # Errors
/// [`Error::Corrupt`] if a slice reaches beyond the payload.
pub fn split(payload: &[u8], slices: usize) -> Result<Vec<&[u8]>> {
    let mut r = Reader::new(payload, "slices");
    let mut lengths = Vec::new();
    for _ in 1..slices {
        lengths.push(r.varint()?);
    }
    let mut parts = Vec::with_capacity(slices);
    for len in lengths {
        if len > r.remaining() as u64 {
            return Err(Error::Corrupt { what: "length of a slice", value: len });
        }
        parts.push(r.take(len as usize)?);
    }
    parts.push(r.take(r.remaining())?);
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_come_apart_as_they_were_put_together() {
        for parts in
            [vec![vec![1, 2, 3]], vec![vec![], vec![7; 300], vec![5]], vec![vec![], vec![]]]
        {
            assert_eq!(split(&join(parts.clone()), parts.len()).unwrap(), parts);
        }
        assert!(split(&[5, 1], 2).is_err());
        assert!(split(&[5, 1], 3).is_err());
    }

    #[test]
    fn slices_cover_all_leaves() {
        for (leaves, slices) in [(0, 1), (7, 1), (100_003, 6)] {
            let ranges: Vec<_> = (0..slices).map(|i| range(leaves, slices, i)).collect();
            assert_eq!((ranges[0].start, ranges[slices - 1].end), (0, leaves));
            assert!(ranges.windows(2).all(|w| w[0].end == w[1].start));
        }
    }
}
