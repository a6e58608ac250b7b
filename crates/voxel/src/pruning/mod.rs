//! [`prune`]: the dynamic programme of the rate-distortion strategy.
//!
//! The strategy chooses, among all prunings of the full octree, the one whose distortion plus
//! lambda times bits is least. It replaces the thresholds of the paper's section 3.2.2. Costs add
//! up over cells, so the best pruning of a cell follows from those of its children:
//!
//! - **State** (`state`): of every occupied cell, the least cost of what lies in it, and the
//!   [`CellMoments`](crate::distortion::CellMoments) that the distortion of a leaf there follows from.
//! - **Recurrence** (`recurrence`): the cost of a cell is the least of three: a leaf (allowed from
//!   `j_low` on), a division plus the costs of the children, and dropping every Gaussian. The
//!   prices of these are in `prices`.
//! - **Base case** (`base_cases`): a cell at `j_high` is not divided.
//! - **Fast paths**: `single` is the closed form for a cell of one Gaussian, and `blocks` solves
//!   cells in parallel, with their records side by side. Each names the reference that it equals,
//!   and a test compares the two. `single` more than halves the time of a voxelization, and
//!   `blocks` halves it for scenes of millions of Gaussians.
//!
//! The octree is not built: a cell is a range of the Gaussians in Morton order.
//!
//! *Invariant:* sums run over children or members in Morton order, so no result depends on the
//! number of threads.

mod base_cases;
mod blocks;
mod prices;
mod recurrence;
mod single;
mod state;
#[cfg(test)]
mod tests;

use std::ops::Range;

use gpcc_lite::Leaf;
use gs_model::Scene;

use crate::descend::{self, OccupiedCell};
use crate::error::Result;
use crate::order::MortonOrder;
use crate::rate_distortion::RateDistortion;
use crate::record::{Record, Records, WeightSums};
use crate::voxelization::PrunedOctree;
use gpcc_lite::Cube;

/// The leaves of the Gaussians whose Morton codes are in `codes`. Their weights are scaled by `sums`, or by those of
/// this scene.
pub(crate) fn prune(
    scene: &Scene,
    cube: &Cube,
    options: &RateDistortion,
    codes: &Range<u64>,
    sums: Option<WeightSums>,
) -> Result<PrunedOctree> {
    let order = MortonOrder::of(scene, cube, options.j_high)?;
    let records = Records::of(scene, &options.importance, options.size_exponent)?.scaled_by(sums);
    let mut depths = vec![0; scene.len()];
    let root = OccupiedCell { codes: &order.codes, members: &order.members };
    let pruning = Pruning::new(cube, options, &records);
    let solve = |cell: OccupiedCell<'_, u32>, depth: u8, depths: &mut [u8]| {
        pruning.solve_in_blocks(cell, depth, depths);
    };
    descend::inside(root, codes, 0, options.j_high, &mut depths, &solve);
    drop(records);
    Ok(PrunedOctree { cube: *cube, j_high: options.j_high, order, depths })
}

/// The rate-distortion strategy on one scene.
pub(crate) struct Pruning<'a> {
    cube: &'a Cube,
    options: &'a RateDistortion,
    records: &'a Records,
}

impl<'a> Pruning<'a> {
    pub(crate) fn new(cube: &'a Cube, options: &'a RateDistortion, records: &'a Records) -> Self {
        Self { cube, options, records }
    }

    /// Centre of the cell at `depth` that holds `code`, relative to the cube's origin.
    fn centre(&self, code: u64, depth: u8) -> [f64; 3] {
        let j_high = self.options.j_high;
        self.cube.centre_offset(Leaf::of(code, depth, j_high), j_high)
    }

    /// The mean of a Gaussian relative to `centre`.
    fn offset_from(&self, centre: [f64; 3], record: &Record) -> [f64; 3] {
        let offset = self.cube.offset(record.mean);
        std::array::from_fn(|k| offset[k] - centre[k])
    }
}
