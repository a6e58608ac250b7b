//! [`Cube`]: the half-open cube that an octree divides, and [`Grid`]: its cells of one depth.
//!
//! *Invariant:* the cell of a point, and the centre of a leaf, follow from IEEE additions and
//! multiplications in a fixed order, so encoder and decoder agree on every machine.

use crate::leaf::Leaf;
use crate::morton;

/// The half-open cube `origin + [0, side)^3` in world units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cube {
    /// Minimum corner.
    pub origin: [f64; 3],
    /// Length of a side; positive and finite.
    pub side: f64,
}

/// Significant bits of the side that [`Cube::spanning`] chooses.
///
/// With 20 bits, index times cell (21 + 1 + 20 bits) is exact in `f64`, and the cube is at
/// most 2^-19 longer than the points extend.
const SIDE_BITS: u32 = 20;

/// Side of the cube of points that all coincide.
///
/// The smallest normal `f32`: the centre of the root then rounds to the point itself, unless
/// that is smaller still.
const POINT_SIDE: f64 = f32::MIN_POSITIVE as f64;

impl Cube {
    /// The smallest cube of this form that holds all points of which these are the least and the greatest
    /// coordinates on each axis; both finite.
    ///
    /// `origin` is the least coordinate on each axis; `side` is the smallest number of 20 significant bits
    /// that is *strictly greater* than the longest extent. So no point lies on the upper face (the
    /// authors' closed cube gives the extreme point index 2^J, which takes one depth more),
    /// indices and cell corners are exact, and no index changes if all points are scaled by a power
    /// of two or translated exactly. If all points coincide, `side` is 2^-126.
    #[must_use]
    pub fn spanning(low: [f32; 3], high: [f32; 3]) -> Self {
        let extent = (0..3).map(|k| f64::from(high[k]) - f64::from(low[k])).fold(0.0, f64::max);
        // `+ 0.0` makes -0.0 into 0.0, so that the cube does not depend on the order of points.
        let origin = low.map(|x| f64::from(x) + 0.0);
        let side = if extent > 0.0 { above(extent) } else { POINT_SIDE };
        Self { origin, side }
    }

    /// True for a cube that can be divided: finite, with a positive side.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.origin.iter().all(|x| x.is_finite()) && self.side.is_finite() && self.side > 0.0
    }

    /// Side of a cell at `depth`. Exact: the cube's side times `2^-depth`.
    #[must_use]
    pub fn cell(&self, depth: u8) -> f64 {
        self.side * f64::from_bits((1023 - u64::from(depth)) << 52)
    }

    /// Indices of the cell at `depth` that holds `point`, or `None` outside the cube.
    ///
    /// Cell `i` of an axis holds the offsets `d = point - origin` with
    /// `i * cell <= d < (i + 1) * cell`, compared in `f64`.
    #[must_use]
    pub fn index_of(&self, point: [f32; 3], depth: u8) -> Option<[u32; 3]> {
        self.grid(depth).index_of(point)
    }

    /// The cells of one depth.
    #[must_use]
    pub fn grid(&self, depth: u8) -> Grid {
        let cell = self.cell(depth);
        Grid { cube: *self, cell, scale: 1.0 / cell, last: (1u32 << depth) - 1 }
    }

    /// A point relative to the origin. All decisions use such offsets, so an exact translation of
    /// all points changes no rounding.
    #[inline(always)]
    #[must_use]
    pub fn offset(&self, point: [f32; 3]) -> [f64; 3] {
        std::array::from_fn(|k| f64::from(point[k]) - self.origin[k])
    }

    /// Centre of a leaf relative to the origin; exact for the cubes of [`Cube::spanning`].
    #[must_use]
    pub fn centre_offset(&self, leaf: Leaf, tree_depth: u8) -> [f64; 3] {
        let cell = self.cell(tree_depth);
        // Exact: powers of two, and indices below 2^21.
        let half = 0.5 * (1u64 << (tree_depth - leaf.depth)) as f64;
        morton::decode(leaf.morton).map(|i| (f64::from(i) + half) * cell)
    }

    /// Centre of a leaf of an octree of depth `tree_depth`, in world units, rounded to `f32`.
    ///
    /// Encoder and decoder both call this, so voxelized points survive coding exactly. Where cells
    /// are finer than the spacing of `f32` (coordinates of 1e7 and a cell below 1, for example),
    /// neighbouring leaves share a centre.
    #[must_use]
    pub fn leaf_centre(&self, leaf: Leaf, tree_depth: u8) -> [f32; 3] {
        let offset = self.centre_offset(leaf, tree_depth);
        std::array::from_fn(|k| (self.origin[k] + offset[k]) as f32)
    }
}

/// The cells of one depth.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    cube: Cube,
    cell: f64,
    scale: f64,
    last: u32,
}

impl Grid {
    /// As [`Cube::index_of`].
    fn index_of(&self, point: [f32; 3]) -> Option<[u32; 3]> {
        let (index, inside) = self.nearest(point);
        inside.then_some(index)
    }

    /// As [`Cube::index_of`], and whether the point is in the cube; outside, the index is arbitrary.
    /// There is no branch, so that loops over it become vector instructions.
    #[inline(always)]
    #[must_use]
    pub fn nearest(&self, point: [f32; 3]) -> ([u32; 3], bool) {
        let offset = self.cube.offset(point);
        let inside = offset.map(|d| (d >= 0.0) & (d < self.cube.side));
        let index = offset.map(|d| {
            // Adding 2^52 rounds to an integer, which is then in the low bits. It is one too
            // great for the upper half of a cell, and where the product rounded across a face.
            let shifted = d * self.scale + TWO_52;
            let above = (shifted - TWO_52) * self.cell > d;
            let i = shifted.to_bits() as u32;
            // Greater than the last only if the reciprocal overflowed.
            i.saturating_sub(u32::from(above)).min(self.last)
        });
        (index, inside[0] & inside[1] & inside[2])
    }
}

const TWO_52: f64 = 4_503_599_627_370_496.0;

/// The smallest number of [`SIDE_BITS`] significant bits strictly above a positive `x`.
fn above(x: f64) -> f64 {
    // Every difference of two f32 is a normal f64, so its mantissa is its low 52 bits.
    let drop = 52 - (SIDE_BITS - 1);
    // A carry into the exponent rounds up to the next power of two.
    f64::from_bits(((x.to_bits() >> drop) + 1) << drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn side_is_strictly_longer_and_short() {
        for extent in [1.0, 0.75, 1.0 - f64::EPSILON, 3.0e38, 1.0e-40, 12.345_678_9] {
            let side = above(extent);
            assert!(side > extent && side <= extent * (1.0 + 1.0 / 524_288.0));
            assert_eq!(side.to_bits() & ((1 << 33) - 1), 0);
        }
    }

    #[test]
    fn index_agrees_with_its_definition_at_every_face() {
        let cube = Cube { origin: [-1.5, 0.0, 7.0], side: above(3.1) };
        for depth in [0, 1, 5, 21] {
            let cell = cube.cell(depth);
            for i in [0u32, 1, 2, 1 << (depth / 2), (1 << depth) - 1] {
                let i = i.min((1 << depth) - 1);
                for mean in [
                    (cube.origin[0] + f64::from(i) * cell) as f32,
                    (cube.origin[0] + (f64::from(i) + 0.5) * cell) as f32,
                ] {
                    let Some(index) = cube.index_of([mean, 0.0, 7.0], depth) else { continue };
                    let d = f64::from(mean) - cube.origin[0];
                    assert!(f64::from(index[0]) * cell <= d && d < f64::from(index[0] + 1) * cell);
                }
            }
        }
    }

    #[test]
    fn outside_is_none() {
        let cube = Cube { origin: [0.0; 3], side: 1.0 };
        assert_eq!(cube.index_of([1.0, 0.0, 0.0], 4), None);
        assert_eq!(cube.index_of([0.0, -1e-30, 0.0], 4), None);
        assert_eq!(cube.index_of([f32::NAN, 0.0, 0.0], 4), None);
    }
}
