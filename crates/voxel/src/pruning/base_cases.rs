//! The base case: a cell at `j_high`, which has no children.

use super::Pruning;
use super::state::Solution;
use crate::descend::OccupiedCell;
use crate::distortion::CellMoments;
use crate::record::Record;

impl Pruning<'_> {
    /// The lesser of a leaf and a drop.
    pub(super) fn solve_finest(
        &self,
        cell: &OccupiedCell<'_, Record>,
        depths: &mut [u8],
    ) -> Solution {
        let depth = self.options.j_high;
        let centre = self.centre(cell.codes[0], depth);
        let mut moments = CellMoments::default();
        for record in cell.members {
            moments.add(&CellMoments::of(record, self.offset_from(centre, record)));
        }
        depths.fill(depth);
        let leaf = self.leaf_cost(&moments, depth);
        let (cost, empty) = self.drop_if_cheaper(leaf, moments.importance, depths);
        Solution { cost, empty, centre, moments }
    }
}
