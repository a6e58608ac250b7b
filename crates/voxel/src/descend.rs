//! Top-down division by a rule that decides one voxel at a time: the form of the paper's criteria
//! (section 3.2.2).

use rayon::prelude::*;

use crate::cell::OccupiedCell;

/// Depth of the leaf of every Gaussian of the root.
///
/// A voxel at `j_low` to `j_high - 1` is divided if `splits` returns true for it and its depth.
pub(crate) fn depths<M: Sync>(
    root: &OccupiedCell<'_, M>,
    j_low: u8,
    j_high: u8,
    splits: impl Fn(&OccupiedCell<'_, M>, u8) -> bool + Sync,
) -> Vec<u8> {
    let mut depths = vec![0; root.codes.len()];
    // Voxels at j_low are independent of each other.
    let voxels: Vec<_> = root.children(&mut depths, j_low, j_high).collect();
    let voxels = voxels.into_par_iter().with_min_len(64);
    voxels.for_each(|(voxel, depths)| divide(&voxel, j_low, j_high, depths, &splits));
    depths
}

/// Decides one voxel and the voxels below it.
fn divide<M>(
    voxel: &OccupiedCell<'_, M>,
    depth: u8,
    j_high: u8,
    depths: &mut [u8],
    splits: &impl Fn(&OccupiedCell<'_, M>, u8) -> bool,
) {
    if let [leaf] = depths {
        // One Gaussian: every voxel below holds it alone.
        *leaf = (depth..j_high).find(|&d| !splits(voxel, d)).unwrap_or(j_high);
    } else if depth == j_high || !splits(voxel, depth) {
        depths.fill(depth);
    } else {
        for (child, depths) in voxel.children(depths, depth + 1, j_high) {
            divide(&child, depth + 1, j_high, depths, splits);
        }
    }
}
