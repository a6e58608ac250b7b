//! [`CostModel`]: what leaves and divisions cost in the stream.

/// Bits of the geometry and attribute streams, as far as the choice of leaves changes them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostModel {
    /// Bits of all attributes of one Gaussian; depends on the attribute quantisers.
    pub gaussian: f64,
    /// Bits of the occupancy of a divided cell with 1 to 8 occupied children (entry 0 is one
    /// child).
    pub occupancy: [f64; 8],
    /// Bits that say "leaf" of a cell at `j_low` to `j_high - 1`.
    pub stop: f64,
    /// Bits that say "divided" of such a cell.
    pub go_on: f64,
}

impl Default for CostModel {
    /// 150 bits per Gaussian (SH degree 3 at middle rates).
    fn default() -> Self {
        Self {
            gaussian: 150.0,
            occupancy: [3.05, 7.0, 8.5, 9.0, 8.5, 8.0, 6.5, 4.0],
            stop: 0.5,
            go_on: 0.5,
        }
    }
}
