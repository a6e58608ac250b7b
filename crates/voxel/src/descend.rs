//! Top-down division by a rule that looks at one voxel at a time.

use rayon::prelude::*;

use crate::order::{MortonOrder, cell_end};

/// Depth of the leaf of every Gaussian of `order`: voxels from `j_low` on are divided while
/// `splits(code of a member, members, depth)` and the depth is below `j_high`.
pub(crate) fn depths(
    order: &MortonOrder,
    j_low: u8,
    j_high: u8,
    splits: impl Fn(u64, &[u32], u8) -> bool + Sync,
) -> Vec<u8> {
    let mut depths = vec![j_high; order.codes.len()];
    // Voxels at j_low are independent of each other.
    let mut tasks = Vec::new();
    let (mut start, mut rest) = (0, depths.as_mut_slice());
    while start < order.codes.len() {
        let end = cell_end(&order.codes, start, j_high, j_low);
        let (head, tail) = rest.split_at_mut(end - start);
        tasks.push((start, head));
        (start, rest) = (end, tail);
    }
    tasks.par_iter_mut().with_min_len(64).for_each(|(start, depths)| {
        let range = *start..*start + depths.len();
        divide(&splits, j_high, &order.codes[range.clone()], &order.members[range], j_low, depths);
    });
    depths
}

/// Decides one voxel, which holds all of `codes`, and what lies below it.
fn divide(
    splits: &impl Fn(u64, &[u32], u8) -> bool,
    j_high: u8,
    codes: &[u64],
    members: &[u32],
    depth: u8,
    depths: &mut [u8],
) {
    if depth == j_high || !splits(codes[0], members, depth) {
        depths.fill(depth);
        return;
    }
    let mut start = 0;
    while start < codes.len() {
        let end = cell_end(codes, start, j_high, depth + 1);
        let at = start..end;
        let (codes, members) = (&codes[at.clone()], &members[at.clone()]);
        divide(splits, j_high, codes, members, depth + 1, &mut depths[at]);
        start = end;
    }
}
