//! [`Leaf`]: one cell of a pruned octree.

/// A leaf cell of a pruned octree.
///
/// `morton` is the Morton code, at the depth `J` of the octree, of the cell's minimum corner: its low
/// `3 * (J - depth)` bits are zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Leaf {
    /// Morton code of the minimum corner at the depth of the octree.
    pub morton: u64,
    /// Depth of the cell, 0 (the root) to that of the octree.
    pub depth: u8,
}

impl Leaf {
    /// The leaf at `depth` that holds the finest cell of this code, in an octree of depth `tree_depth`.
    #[inline]
    #[must_use]
    pub fn of(code: u64, depth: u8, tree_depth: u8) -> Self {
        let shift = 3 * u32::from(tree_depth - depth);
        Self { morton: code >> shift << shift, depth }
    }
}
