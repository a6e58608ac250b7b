//! What a leaf, a division and a drop cost: distortion, and lambda times bits.

use super::Pruning;
use crate::distortion::Moments;
use crate::rate_distortion::RateDistortion;
use crate::voxelization::DROPPED;

/// Lambda times the bits of cells that hold one leaf.
#[derive(Clone, Copy)]
pub(super) struct Prices {
    /// A divided cell with one child, above `j_low`.
    pub(super) above_j_low: f64,
    /// A divided cell with one child, from `j_low` on: it has a flag too.
    pub(super) from_j_low: f64,
    /// A leaf at `j_high`.
    pub(super) finest_leaf: f64,
    /// A leaf above `j_high`: it has a flag too.
    pub(super) flagged_leaf: f64,
}

impl Prices {
    pub(super) fn new(options: &RateDistortion) -> Self {
        let (lambda, c) = (options.lambda, &options.cost);
        Self {
            above_j_low: lambda * c.occupancy[0],
            from_j_low: lambda * (c.occupancy[0] + c.go_on),
            finest_leaf: lambda * c.gaussian,
            flagged_leaf: lambda * (c.stop + c.gaussian),
        }
    }
}

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
        if depth < self.options.j_high { self.prices.flagged_leaf } else { self.prices.finest_leaf }
    }

    /// Cost of a leaf at `depth` of which these are the moments, relative to its centre: its
    /// price, and the distortion of giving all members one mean, one shape and one colour.
    pub(super) fn leaf_cost(&self, moments: &Moments, depth: u8) -> f64 {
        moments.displacement()
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
