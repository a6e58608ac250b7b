//! [`Cube`]: the half-open cube that the octree divides.

use gpcc_lite::{Leaf, morton};

/// The half-open cube `origin + [0, side)^3` in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cube {
    /// Minimum corner.
    pub origin: [f64; 3],
    /// Length of a side; positive and finite.
    pub side: f64,
}

impl Cube {
    /// Centre of a leaf, in world units, rounded to `f32`.
    ///
    /// Encoder and decoder both call this, so voxelized means survive coding exactly. Only
    /// IEEE additions and multiplications are used, in a fixed order.
    #[must_use]
    pub fn leaf_centre(&self, leaf: Leaf, j_high: u8) -> [f32; 3] {
        let index = morton::decode(leaf.morton);
        // Exact: powers of two, and indices below 2^21.
        let cell = self.side / (1u64 << j_high) as f64;
        let half = 0.5 * (1u64 << (j_high - leaf.depth)) as f64;
        std::array::from_fn(|k| (self.origin[k] + (f64::from(index[k]) + half) * cell) as f32)
    }
}
