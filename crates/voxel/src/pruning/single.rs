//! Fast path: a cell of one Gaussian, in closed form.

use super::Pruning;
use super::state::Solution;
use crate::descend::OccupiedCell;
use crate::distortion::CellMoments;
use crate::merge::Place;
use crate::record::Record;

impl Pruning<'_> {
    /// Solves a cell of one Gaussian without visiting the cells below.
    ///
    /// It equals [`Pruning::solve_divided`], and [`Pruning::solve_finest`] at `j_high`, up to
    /// rounding. One Gaussian has no distortion of shape or colour, and every cell below has one
    /// child. So a leaf at `d` costs the squared displacement from its centre, plus prices. A
    /// loop over `d` finds the least; it ends where a deeper leaf would cost more bits than the
    /// best leaf costs in all. Without this path a voxelization takes 2.3 times as long.
    #[inline(always)]
    pub(super) fn solve_single(
        &self,
        cell: &OccupiedCell<'_, Record>,
        depth: u8,
        leaf: &mut u8,
    ) -> Solution {
        let (code, record) = (cell.codes[0], &cell.members[0]);
        let (j_low, j_high) = (self.options.j_low, self.options.j_high);
        // A Gaussian that keeps its mean is displaced by nothing.
        let geometry = match self.options.place {
            Place::LeafCentre => record.geometry,
            Place::MemberMean => 0.0,
        };
        let (lambda, bits) = (self.options.lambda, &self.options.cost);
        // Of a divided cell with one child, and that with the flag that it has from `j_low` on.
        let division = lambda * bits.occupancy[0];
        let flagged_division = lambda * (bits.occupancy[0] + bits.go_on);
        let finest_leaf = self.leaf_price(j_high);
        let centre = self.centre(code, depth);
        let moments = CellMoments::of(record, self.offset_from(centre, record));
        let first = depth.max(j_low);
        let first_centre = if first == depth { centre } else { self.centre(code, first) };
        // From the centre of the cell at `d` to the mean, except for the signs.
        let mut displacement = self.offset_from(first_centre, record);
        let mut half_side = 0.5 * self.cube.cell(first);
        let mut path = f64::from(first - depth) * division;
        let (mut cost, mut best, mut d) = (f64::INFINITY, j_high, first);
        loop {
            let [x, y, z] = displacement;
            let distortion = geometry * (x * x + y * y + z * z);
            let leaf_at_d = distortion + path + self.leaf_price(d);
            if leaf_at_d < cost {
                (cost, best) = (leaf_at_d, d);
            }
            let least_deeper = path + division + finest_leaf;
            if d == j_high || least_deeper >= cost {
                break;
            }
            path += flagged_division;
            d += 1;
            // The child that holds the mean has its centre half its own side towards the mean.
            half_side *= 0.5;
            displacement = displacement.map(|x| x.abs() - half_side);
        }
        *leaf = best;
        let (cost, empty) =
            self.drop_if_cheaper(cost, record.importance, std::slice::from_mut(leaf));
        Solution { cost, empty, centre, moments }
    }
}
