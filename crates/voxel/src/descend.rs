//! Top-down division by a rule that decides one voxel at a time: the form of the paper's criteria
//! (section 3.2.2).

use std::ops::Range;

use rayon::prelude::*;

use crate::order::cell_end;

/// Depth of the leaf of every Gaussian, given the sorted codes.
///
/// A voxel at `j_low` to `j_high - 1` is divided if `splits` returns true for the code of one of
/// its members, the range of its members in `codes`, and its depth.
pub(crate) fn depths(
    codes: &[u64],
    j_low: u8,
    j_high: u8,
    splits: impl Fn(u64, Range<usize>, u8) -> bool + Sync,
) -> Vec<u8> {
    let mut depths = vec![0; codes.len()];
    // Voxels at j_low are independent of each other.
    let mut tasks = Vec::new();
    let (mut start, mut rest) = (0, depths.as_mut_slice());
    while start < codes.len() {
        let end = cell_end(codes, start, j_high, j_low);
        let (head, tail) = rest.split_at_mut(end - start);
        tasks.push((start, head));
        (start, rest) = (end, tail);
    }
    tasks.par_iter_mut().with_min_len(64).for_each(|(start, depths)| {
        Division { splits: &splits, j_high, codes }.divide(*start, j_low, depths);
    });
    depths
}

/// See [`depths`].
#[derive(Clone, Copy)]
struct Division<'a, S> {
    splits: &'a S,
    j_high: u8,
    codes: &'a [u64],
}

impl<S: Fn(u64, Range<usize>, u8) -> bool> Division<'_, S> {
    /// Decides one voxel and the voxels below it. It holds as many codes as `depths`, from `start` on.
    fn divide(&self, start: usize, depth: u8, depths: &mut [u8]) {
        let Self { splits, j_high, codes } = *self;
        let stop = start + depths.len();
        if let [leaf] = depths {
            // One Gaussian: every voxel below holds it alone.
            *leaf =
                (depth..j_high).find(|&d| !splits(codes[start], start..stop, d)).unwrap_or(j_high);
            return;
        }
        if depth == j_high || !splits(codes[start], start..stop, depth) {
            depths.fill(depth);
            return;
        }
        let (mut at, mut rest) = (start, depths);
        while at < stop {
            let end = at + cell_end(&codes[at..stop], 0, j_high, depth + 1);
            let (head, tail) = rest.split_at_mut(end - at);
            self.divide(at, depth + 1, head);
            (at, rest) = (end, tail);
        }
    }
}
