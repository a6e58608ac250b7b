//! [`CostModel`]: what leaves and divisions cost in the stream.
//!
//! The rate-distortion strategy estimates bits with it; nothing is coded to find them.

/// Estimated bits of the geometry and the attributes, as far as the choice of leaves changes them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostModel {
    /// Bits of all attributes of one Gaussian. They depend on the quantisation steps.
    pub gaussian: f64,
    /// Bits of the occupancy of a divided cell; entry `n - 1` is for `n` occupied children.
    pub occupancy: [f64; 8],
    /// Bits of the flag that says "leaf", for a cell at `j_low` to `j_high - 1`.
    pub stop: f64,
    /// Bits of the flag that says "divided", for such a cell.
    pub go_on: f64,
}

impl Default for CostModel {
    /// The values of the encoder (`gsvx::prepare`) at quality 50. At other qualities it
    /// sets `gaussian` anew, since that depends on the attribute steps, and keeps the rest.
    ///
    /// The bits of the geometry are close to a least-squares fit to octrees that gpcc-lite coded.
    /// Cells of four and more children are cheap in the fit because they are found at low depths,
    /// which are dense and well predicted.
    fn default() -> Self {
        Self {
            gaussian: 60.0,
            occupancy: [3.1, 10.5, 12.0, 8.0, 6.0, 5.0, 4.0, 3.0],
            stop: 2.4,
            go_on: 0.1,
        }
    }
}
