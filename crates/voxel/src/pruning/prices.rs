//! What a leaf, a division and a drop cost: distortion, and lambda times bits.

use super::Pruning;
use crate::distortion::CellMoments;
use crate::merge::Place;
use crate::voxelization::DROPPED;

impl Pruning<'_> {
    /// Price of dividing a cell at `depth` into `occupied` children. A cell without an occupied
    /// child is not occupied itself and costs nothing.
    pub(super) fn division_price(&self, occupied: usize, depth: u8) -> f64 {
        let c = &self.options.cost;
        let go_on = if depth >= self.options.j_low { c.go_on } else { 0.0 };
        match occupied {
            0 => 0.0,
            n => self.options.lambda * (c.occupancy[n - 1] + go_on),
        }
    }

    /// Price of a leaf at `depth`, without its distortion.
    pub(super) fn leaf_price(&self, depth: u8) -> f64 {
        let c = &self.options.cost;
        // A leaf above `j_high` has a flag too.
        let bits = if depth < self.options.j_high { c.stop + c.gaussian } else { c.gaussian };
        self.options.lambda * bits
    }

    /// Cost of a leaf at `depth` of which these are the moments, relative to its centre: its
    /// price, and the distortion of giving all members one mean, one shape and one colour.
    pub(super) fn leaf_cost(&self, moments: &CellMoments, depth: u8) -> f64 {
        let displacement = match self.options.place {
            Place::LeafCentre => moments.displacement(),
            Place::MemberMean => moments.scatter(),
        };
        displacement
            + self.leaf_price(depth)
            + (self.options.shape * moments.shape() + self.options.colour * moments.colour())
    }

    /// Drops every Gaussian of a cell if that costs less than `cost`. Returns the lesser cost, and
    /// whether it drops them.
    pub(super) fn drop_if_cheaper(
        &self,
        cost: f64,
        importance: f64,
        depths: &mut [u8],
    ) -> (f64, bool) {
        match self.options.drop.map(|drop| drop * importance) {
            Some(dropped) if dropped < cost => {
                depths.fill(DROPPED);
                (dropped, true)
            }
            _ => (cost, false),
        }
    }
}
