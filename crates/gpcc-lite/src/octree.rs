//! [`Octree`]: the leaves of a pruned octree, and the cube that it divides.

use std::ops::Range;

use crate::cube::Cube;
use crate::error::{Error, Result};
use crate::leaf::Leaf;
use crate::morton::MAX_DEPTH;

/// The leaves of a pruned octree, and the cube that it divides.
///
/// *Invariant:* the depth is at most [`MAX_DEPTH`], leaves ascend in Morton order, none contains another, and there
/// are fewer than 2^32 - 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Octree {
    cube: Cube,
    depth: u8,
    leaves: Vec<Leaf>,
}

impl Octree {
    /// An octree that divides `cube`. Its finest leaves can be at `depth`, the paper's `J`.
    ///
    /// # Errors
    /// The first leaf that is too deep, misaligned or out of order; [`Error::TooManyPoints`] for 2^32 - 1 leaves
    /// or more, because leaves are numbered in 32 bits.
    pub fn new(cube: Cube, depth: u8, leaves: Vec<Leaf>) -> Result<Self> {
        check_depth(depth)?;
        check_count(leaves.len() as u64)?;
        let mut end = 0u64;
        for (index, leaf) in leaves.iter().enumerate() {
            if leaf.depth > depth {
                return Err(Error::Depth { depth: leaf.depth, max: depth });
            }
            let size = 1u64 << (3 * (depth - leaf.depth));
            if leaf.morton & (size - 1) != 0 || leaf.morton >> (3 * depth) != 0 {
                return Err(Error::LeafAlign { index, morton: leaf.morton, depth: leaf.depth });
            }
            if leaf.morton < end {
                return Err(Error::LeafOrder { index });
            }
            end = leaf.morton + size;
        }
        Ok(Self { cube, depth, leaves })
    }

    /// The octree of a point cloud: its finest cells have side 1.
    ///
    /// # Errors
    /// As [`Octree::new`].
    pub fn of_points(depth: u8, leaves: Vec<Leaf>) -> Result<Self> {
        check_depth(depth)?;
        Self::new(Cube { origin: [0.0; 3], side: (1u64 << depth) as f64 }, depth, leaves)
    }

    /// The same leaves in another cube.
    #[must_use]
    pub fn in_cube(self, cube: Cube) -> Self {
        Self { cube, ..self }
    }

    /// The cube that it divides.
    #[must_use]
    pub fn cube(&self) -> Cube {
        self.cube
    }

    /// Depth of the finest possible leaf, the paper's `J`.
    #[must_use]
    pub fn depth(&self) -> u8 {
        self.depth
    }

    /// The leaves, in Morton order.
    #[must_use]
    pub fn leaves(&self) -> &[Leaf] {
        &self.leaves
    }

    /// Number of leaves.
    #[must_use]
    pub fn len(&self) -> usize {
        self.leaves.len()
    }

    /// True if there is no leaf.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }

    /// Centre of leaf `i`, in world units.
    #[must_use]
    pub fn centre(&self, i: usize) -> [f32; 3] {
        self.cube.leaf_centre(self.leaves[i], self.depth)
    }

    /// Number of leaves at every depth, 0 to [`Octree::depth`].
    #[must_use]
    pub fn depth_histogram(&self) -> Vec<usize> {
        let mut counts = vec![0; usize::from(self.depth) + 1];
        for leaf in &self.leaves {
            counts[usize::from(leaf.depth)] += 1;
        }
        counts
    }

    /// Some of the leaves.
    #[must_use]
    pub fn part(&self, leaves: Range<usize>) -> Self {
        Self { leaves: self.leaves[leaves].to_vec(), ..*self }
    }

    /// Adds the leaves of the next part of the same octree.
    ///
    /// # Errors
    /// [`Error::Depth`] if the depths differ, [`Error::LeafOrder`] if the part does not follow the leaves so far.
    pub fn append(&mut self, next: &Self) -> Result<()> {
        if next.depth != self.depth {
            return Err(Error::Depth { depth: next.depth, max: self.depth });
        }
        let end = |leaf: &Leaf| leaf.morton + (1 << (3 * (self.depth - leaf.depth)));
        if let (Some(last), Some(first)) = (self.leaves.last(), next.leaves.first())
            && first.morton < end(last)
        {
            return Err(Error::LeafOrder { index: self.leaves.len() });
        }
        self.leaves.extend(&next.leaves);
        check_count(self.leaves.len() as u64)
    }
}

/// Refuses a depth that Morton codes do not hold.
pub(crate) fn check_depth(depth: u8) -> Result<()> {
    if depth > MAX_DEPTH { Err(Error::Depth { depth, max: MAX_DEPTH }) } else { Ok(()) }
}

/// Refuses more leaves than 32 bits can number.
pub(crate) fn check_count(points: u64) -> Result<()> {
    if points >= u64::from(u32::MAX) {
        return Err(Error::TooManyPoints { points, limit: u32::MAX as usize - 1 });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_make_the_whole_again_in_order_only() {
        let leaves: Vec<Leaf> = (0..40).map(|i| Leaf { morton: 8 * i, depth: 3 }).collect();
        let whole = Octree::of_points(4, leaves).unwrap();
        let mut joined = whole.part(0..17);
        joined.append(&whole.part(17..40)).unwrap();
        assert_eq!(joined, whole);
        assert_eq!(joined.append(&whole.part(3..4)), Err(Error::LeafOrder { index: 40 }));
        assert_eq!(whole.depth_histogram(), [0, 0, 0, 40, 0]);
        assert_eq!(whole.centre(1), [1.0, 1.0, 3.0].map(|x: f32| x));
    }
}
