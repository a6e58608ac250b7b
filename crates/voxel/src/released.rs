//! The authors' released criteria, per Gaussian, for reproduction.
//!
//! This is what their `adapt_voxel_recolor.py` does, in `f32` as there. It differs from the
//! paper's text (section 3.2.2), which is [`Strategy::Paper`](crate::Strategy::Paper). At every
//! depth from `j_low` on, cells of fewer than `tau1` Gaussians are *small*. A Gaussian in a small
//! cell moves to the cell's centre if it is not large, has not moved before and is closer to the
//! centre than half a side. The loop ends after the first depth at which every cell is small. Then
//! all Gaussians, moved or not, are voxelized one depth further. No leaf depth is recorded, so all
//! leaves are at `j_high`, which is a result and not a parameter.

use gpcc_lite::morton::{self, MAX_DEPTH};
use gs_model::Scene;

use crate::check::check_depths;
use crate::cube::cube_of;
use crate::error::{Error, Result};
use crate::order::MortonOrder;
use crate::paper::large;
use crate::voxelization::PrunedOctree;
use gpcc_lite::Cube;

/// Parameters of the authors' released code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReleasedRule {
    /// First depth (`depth_start` there).
    pub j_low: u8,
    /// Cells of at least this many Gaussians are divided (`voxel_thr`; 30 in all their runs).
    pub tau1: u32,
    /// Percentage of large Gaussians, by volume (20, hard-coded there).
    pub large_percent: f64,
    /// Greatest depth of the loop, at most 19; the authors' code has no bound. Their cube includes
    /// its upper faces, which takes one depth more here.
    pub max_depth: u8,
}

impl ReleasedRule {
    /// The published settings.
    #[must_use]
    pub fn new(j_low: u8) -> Self {
        Self { j_low, tau1: 30, large_percent: 20.0, max_depth: MAX_DEPTH - 2 }
    }
}

/// Runs the authors' voxelizer.
///
/// In their cube the extreme point lies *on* the upper face. The cube of the result is twice as
/// wide and `j_high` is one more; leaf centres are the same. [`Merge::Paper`](crate::Merge::Paper)
/// merges as the paper says; their code averages rotations too, which is not reproduced.
///
/// # Errors
/// [`Error::NonFiniteMean`], [`Error::DepthTooGreat`], [`Error::DepthRange`];
/// [`Error::InvalidCube`] if the extent overflows the `f32` of the authors' arithmetic.
pub(crate) fn released(scene: &Scene, options: &ReleasedRule) -> Result<PrunedOctree> {
    let &ReleasedRule { j_low, tau1, large_percent, max_depth } = options;
    if max_depth > MAX_DEPTH - 2 {
        return Err(Error::DepthTooGreat { depth: max_depth, max: MAX_DEPTH - 2 });
    }
    check_depths(j_low, max_depth)?;
    let tight = cube_of(&scene.means)?;
    let origin = tight.origin.map(|x| x as f32);
    let width = (0..3)
        .map(|k| scene.means.iter().map(|p| p[k] - origin[k]).fold(0.0, f32::max))
        .fold(0.0, f32::max);
    if !width.is_finite() {
        return Err(Error::InvalidCube { origin: tight.origin, side: f64::from(width) });
    }
    // All means coincide: their code divides by zero here.
    let width = if width > 0.0 { width } else { tight.side as f32 };

    let large = large(scene, large_percent);
    let mut points = scene.means.clone();
    let mut moved = vec![false; points.len()];
    // A point on the upper face has the last index. Where the cell underflows, so have others.
    let index = |p: &[f32; 3], cell: f32, depth: u8| {
        std::array::from_fn(|k| (((p[k] - origin[k]) / cell) as u32).min(1 << depth))
    };
    let sorted = |points: &[[f32; 3]], cell: f32, depth: u8| {
        let code = |p: &[f32; 3]| morton::encode(index(p, cell, depth));
        MortonOrder::sorted(points.iter().map(code).collect::<Vec<u64>>().into())
    };
    let mut depth = j_low;
    loop {
        let cell = width / (1u32 << depth) as f32;
        let order = sorted(&points, cell, depth);
        let mut all_small = true;
        let mut start = 0;
        while start < order.codes.len() {
            let run = order.codes[start..].partition_point(|&c| c == order.codes[start]);
            if run as u64 >= u64::from(tau1) {
                all_small = false;
            } else {
                let index = morton::decode(order.codes[start]);
                let centre: [f32; 3] =
                    std::array::from_fn(|k| (index[k] as f32 + 0.5) * cell + origin[k]);
                for &i in &order.members[start..start + run] {
                    let i = i as usize;
                    let d: [f32; 3] = std::array::from_fn(|k| points[i][k] - centre[k]);
                    let near = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() < cell / 2.0;
                    if near && !large[i] && !moved[i] {
                        points[i] = centre;
                        moved[i] = true;
                    }
                }
            }
            start += run;
        }
        depth += 1;
        if all_small || depth > max_depth {
            break;
        }
    }
    let cell = width / (1u32 << depth) as f32;
    let order = sorted(&points, cell, depth);
    let cube = Cube { origin: tight.origin, side: 2.0 * f64::from(width) };
    Ok(PrunedOctree { cube, j_high: depth + 1, order, depths: vec![depth + 1; points.len()] })
}
