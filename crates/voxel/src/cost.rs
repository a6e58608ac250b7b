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
    /// Geometry near what is fitted to gpcc-lite on `fox` and `bonsai` (docs/results/voxel.md);
    /// 90 bits per Gaussian, SH degree 3 at middle to high rates.
    ///
    /// Cells of four and more children come out cheap because they sit in the dense upper
    /// levels, where contexts predict well; the fit cannot tell them apart.
    fn default() -> Self {
        Self {
            gaussian: 90.0,
            occupancy: [3.1, 10.5, 12.0, 8.0, 6.0, 5.0, 4.0, 3.0],
            stop: 2.4,
            go_on: 0.1,
        }
    }
}
