//! Leaves for Gaussians whose means must not err by more than a bound.

use super::errors;
use crate::encoder::options::MaxError;
use crate::error::{Result, coding};
use gpcc_lite::morton::{self, MAX_DEPTH};
use gpcc_lite::{Cube, Leaf, Octree};
use gs_model::Scene;
use rayon::prelude::*;

/// Gaussians with a leaf each.
pub(super) struct PlacedLeaves {
    /// Their numbers in the scene, in the order of the leaves.
    pub(super) order: Vec<usize>,
    pub(super) octree: Octree,
}

/// Gives a leaf to every Gaussian that is not exact. Those for which no leaf is small enough become
/// exact. `None` if all are.
pub(super) fn place(
    scene: &Scene,
    exact: &mut [bool],
    bounds: &MaxError,
) -> Result<Option<PlacedLeaves>> {
    loop {
        let inside: Vec<usize> = (0..scene.len()).filter(|&i| !exact[i]).collect();
        if inside.is_empty() {
            return Ok(None);
        }
        let means: Vec<[f32; 3]> = inside.iter().map(|&i| scene.means[i]).collect();
        let cube = voxel::cube_of(&means)?;
        let mut sorted: Vec<(u64, usize)> = inside
            .par_iter()
            .map(|&i| (cube.index_of(scene.means[i], MAX_DEPTH).map_or(0, morton::encode), i))
            .collect();
        sorted.par_sort_unstable();
        // One Gaussian of each finest cell stays, the others become exact.
        let before = sorted.len();
        sorted.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            exact[next.1] |= same;
            same
        });
        let placed = with_leaves(scene, cube, &sorted, bounds)?;
        let off = |k: &usize| {
            let i = placed.order[*k];
            errors::mean_error(scene, i, placed.octree.centre(*k)) > bounds.mean
        };
        let off: Vec<usize> = (0..placed.order.len()).into_par_iter().filter(off).collect();
        off.iter().for_each(|&k| exact[placed.order[k]] = true);
        // The cube may be smaller without the Gaussians that have become exact.
        if off.is_empty() && before == sorted.len() {
            return Ok(Some(placed));
        }
    }
}

/// The largest leaves that keep the bound on the mean and hold one Gaussian each.
fn with_leaves(
    scene: &Scene,
    cube: Cube,
    sorted: &[(u64, usize)],
    bounds: &MaxError,
) -> Result<PlacedLeaves> {
    let apart = |k: usize| {
        // Codes differ, and their highest bits are those of the coarsest level.
        let shared = (sorted[k].0 ^ sorted[k + 1].0).leading_zeros() as u8;
        (shared - (64 - 3 * MAX_DEPTH)) / 3 + 1
    };
    let depth = |k: usize| {
        let size = errors::longest_axis(scene, sorted[k].1);
        // Half the diagonal of a cell is the greatest distance from its centre.
        let cells = 0.5 * 3f64.sqrt() * cube.side / (f64::from(bounds.mean) * size);
        let wanted = libm::ceil(libm::log2(cells)).clamp(0.0, f64::from(MAX_DEPTH)) as u8;
        let left = if k > 0 { apart(k - 1) } else { 0 };
        let right = if k + 1 < sorted.len() { apart(k) } else { 0 };
        wanted.max(left).max(right)
    };
    let depths: Vec<u8> = (0..sorted.len()).into_par_iter().map(depth).collect();
    let finest = depths.iter().copied().max().unwrap_or(0);
    let leaf = |(&(code, _), &depth): (&(u64, usize), &u8)| Leaf {
        morton: code >> (3 * (MAX_DEPTH - depth)) << (3 * (finest - depth)),
        depth,
    };
    let leaves = sorted.iter().zip(&depths).map(leaf).collect();
    let octree = Octree::new(cube, finest, leaves).map_err(coding("geometry"))?;
    Ok(PlacedLeaves { order: sorted.iter().map(|s| s.1).collect(), octree })
}
