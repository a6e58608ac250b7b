//! The recurrence: the best pruning of a cell from the best prunings of its children.

use super::Pruning;
use super::state::Solution;
use crate::descend::OccupiedCell;
use crate::distortion::CellMoments;
use crate::record::Record;

impl Pruning<'_> {
    /// Solves a cell at `depth`, and writes the leaf depth of each of its Gaussians.
    pub(super) fn solve(
        &self,
        cell: OccupiedCell<'_, Record>,
        depth: u8,
        depths: &mut [u8],
    ) -> Solution {
        if let [leaf] = depths {
            self.solve_single(&cell, depth, leaf)
        } else if depth == self.options.j_high {
            self.solve_finest(&cell, depths)
        } else {
            self.solve_divided(cell, depth, depths)
        }
    }

    /// Solves a cell above `j_high`, after its children.
    pub(super) fn solve_divided(
        &self,
        cell: OccupiedCell<'_, Record>,
        depth: u8,
        depths: &mut [u8],
    ) -> Solution {
        let mut division = Division::of_cell(self.centre(cell.codes[0], depth));
        for (child, depths) in cell.children(depths, depth + 1, self.options.j_high) {
            division.add(&self.solve(child, depth + 1, depths));
        }
        self.choose(division, depth, depths)
    }

    /// The least of a leaf, a division and a drop.
    pub(super) fn choose(&self, division: Division, depth: u8, depths: &mut [u8]) -> Solution {
        let Division { centre, occupied, moments, .. } = division;
        let mut cost = division.cost + self.division_price(occupied, depth);
        let mut empty = occupied == 0;
        if depth >= self.options.j_low {
            let leaf = self.leaf_cost(&moments, depth);
            // Equal costs: the leaf, which codes faster.
            if leaf <= cost {
                (cost, empty) = (leaf, false);
                depths.fill(depth);
            }
        }
        let (cost, dropped) = self.drop_if_cheaper(cost, moments.importance, depths);
        Solution { cost, empty: empty || dropped, centre, moments }
    }
}

/// The children of a cell, added up in Morton order.
pub(super) struct Division {
    /// Centre of the cell, relative to the cube's origin.
    centre: [f64; 3],
    /// Costs of the children, without the price of the division.
    cost: f64,
    /// Children that are not empty.
    occupied: usize,
    /// Of all Gaussians in the cell; means are relative to `centre`.
    moments: CellMoments,
}

impl Division {
    /// The division of a cell with this centre, before its children are added.
    pub(super) fn of_cell(centre: [f64; 3]) -> Self {
        Self { centre, cost: 0.0, occupied: 0, moments: CellMoments::default() }
    }

    pub(super) fn add(&mut self, child: &Solution) {
        let shift = std::array::from_fn(|k| self.centre[k] - child.centre[k]);
        self.moments.add(&child.moments.moved(shift));
        self.cost += child.cost;
        self.occupied += usize::from(!child.empty);
    }
}
