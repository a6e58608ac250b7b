//! [`Leaf`]: one cell of a pruned octree.

use crate::error::{Error, Result};
use crate::morton::MAX_DEPTH;

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

/// Checks that `leaves` are cells of a tree of depth `j_high`, disjoint and in Morton order.
///
/// # Errors
/// The first leaf that is too deep, misaligned or out of order; [`Error::TooManyPoints`] for 2^32 - 1 leaves
/// or more, because leaves are numbered in 32 bits.
pub fn check_leaves(leaves: &[Leaf], j_high: u8) -> Result<()> {
    if j_high > MAX_DEPTH {
        return Err(Error::Depth { depth: j_high, max: MAX_DEPTH });
    }
    check_count(leaves.len() as u64)?;
    let mut end = 0u64;
    for (index, leaf) in leaves.iter().enumerate() {
        if leaf.depth > j_high {
            return Err(Error::Depth { depth: leaf.depth, max: j_high });
        }
        let size = 1u64 << (3 * (j_high - leaf.depth));
        if leaf.morton & (size - 1) != 0 || leaf.morton >> (3 * j_high) != 0 {
            return Err(Error::LeafAlign { index, morton: leaf.morton, depth: leaf.depth });
        }
        if leaf.morton < end {
            return Err(Error::LeafOrder { index });
        }
        end = leaf.morton + size;
    }
    Ok(())
}

/// Refuses more leaves than 32 bits can number.
pub(crate) fn check_count(points: u64) -> Result<()> {
    if points >= u64::from(u32::MAX) {
        return Err(Error::TooManyPoints { points, limit: u32::MAX as usize - 1 });
    }
    Ok(())
}
