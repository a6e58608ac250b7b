//! [`Leaf`]: one cell of a pruned octree.

/// A leaf cell of a pruned octree whose finest level is `j_high`.
///
/// `morton` is the Morton code, at depth `j_high`, of the cell's minimum corner: its low
/// `3 * (j_high - depth)` bits are zero. A set of leaves is valid if no leaf contains another;
/// sorted by `morton` it is then strictly ascending.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Leaf {
    /// Morton code of the minimum corner at depth `j_high`.
    pub morton: u64,
    /// Depth of the cell, 0 (the root) to `j_high`.
    pub depth: u8,
}
