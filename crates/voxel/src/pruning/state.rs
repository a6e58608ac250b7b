//! The state of the dynamic programme: what is known of a cell once it is solved.

use crate::distortion::CellMoments;

/// The best pruning of a cell, and what its parent needs to know of it.
#[derive(Clone, Copy)]
pub(super) struct Solution {
    /// Least distortion plus lambda times bits of everything in the cell.
    pub(super) cost: f64,
    /// The best pruning drops every Gaussian, so the octree does not occupy the cell.
    pub(super) empty: bool,
    /// Centre of the cell, relative to the cube's origin.
    pub(super) centre: [f64; 3],
    /// Of all Gaussians in the cell; means are relative to `centre`.
    pub(super) moments: CellMoments,
}
