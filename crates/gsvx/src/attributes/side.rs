//! Prediction from what is already known of a leaf: its depth and its importance class.
//!
//! The octree goes deep where Gaussians are small, and importance is opacity and size as cameras see
//! them. So depth and class predict part of a Gaussian's opacity and size, linearly. The factors of
//! each chunk are fitted by the encoder.

use gpcc_lite::Leaf;

/// Factors are multiples of this.
const UNIT: f32 = 1.0 / 64.0;

/// Factors of depth and class.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Factors {
    pub(crate) depth: i8,
    pub(crate) class: i8,
}

impl Factors {
    /// The value that depth and class predict, up to a constant. In single precision, in this order of
    /// operations.
    #[inline(always)]
    pub(crate) fn predict(self, leaf: Leaf, class: u8) -> f32 {
        let by_depth = f32::from(self.depth) * UNIT * f32::from(leaf.depth);
        by_depth + f32::from(self.class) * UNIT * f32::from(class)
    }

    /// The factors of depth and class.
    #[cfg(feature = "encode")]
    pub(crate) fn as_floats(self) -> [f32; 2] {
        [self.depth, self.class].map(|f| f32::from(f) * UNIT)
    }

    /// Least squares over the differences of consecutive leaves, weighted by importance.
    #[cfg(feature = "encode")]
    pub(crate) fn fit(leaves: &[Leaf], classes: &[u8], value: impl Fn(usize) -> f32) -> Self {
        // Sums of products of the differences: depth, class, value.
        let (mut dd, mut dc, mut cc, mut dv, mut cv) = (1e-9, 0.0, 1e-9, 0.0, 0.0);
        for i in 1..leaves.len() {
            let (before, here) = (classes[i - 1], classes[i]);
            let weight = f64::from(crate::importance::weight(before.min(here)));
            let d = f64::from(leaves[i].depth) - f64::from(leaves[i - 1].depth);
            let c = f64::from(here) - f64::from(before);
            let v = f64::from(value(i)) - f64::from(value(i - 1));
            dd += weight * d * d;
            dc += weight * d * c;
            cc += weight * c * c;
            dv += weight * d * v;
            cv += weight * c * v;
        }
        let determinant = dd * cc - dc * dc;
        let (depth, class) = if determinant > 1e-9 * dd * cc {
            ((dv * cc - cv * dc) / determinant, (cv * dd - dv * dc) / determinant)
        } else {
            (dv / dd, 0.0)
        };
        let factor = |v: f64| libm::round(v / f64::from(UNIT)).clamp(-127.0, 127.0) as i8;
        Self { depth: factor(depth), class: factor(class) }
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn the_factors_of_a_linear_relation_are_found() {
        let leaf = |i: u64| Leaf { morton: i, depth: (i * 7 % 5) as u8 + 9 };
        let leaves: Vec<Leaf> = (0..500).map(leaf).collect();
        let classes: Vec<u8> = (0..500).map(|i| (i * 11 % 8) as u8).collect();
        let wanted = Factors { depth: -25, class: 70 };
        let value = |i: usize| 3.0 + wanted.predict(leaves[i], classes[i]);
        assert_eq!(Factors::fit(&leaves, &classes, value), wanted);
        assert_eq!(Factors::fit(&leaves, &[5; 500], |_| 1.0), Factors::default());
    }
}
