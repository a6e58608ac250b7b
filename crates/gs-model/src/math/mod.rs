//! Rotations, symmetric 3x3 matrices and linear equations, as plain arrays; floats as integers of the same order.
//!
//! A Gaussian's covariance is `R diag(s^2) R^T`, with the rotation `R` of its quaternion and its
//! scales `s`. The functions here lead from quaternion and scales to such a matrix, and back.
//!
//! *Invariant:* only `+ - * /` and square roots, in a fixed order, so the bits are the same on
//! every machine. Everything is `inline(always)`, so that callers that are compiled for vector
//! instructions get it compiled for them too.
//!
//! ```
//! use gs_model::math::{axes_product, eigen, quaternion, rotation};
//!
//! let r = rotation([0.9, 0.1, -0.2, 0.05]);
//! let covariance = axes_product(&r, [1.0, 4.0, 9.0]);
//! // As many matrices at once as the arrays are long.
//! let (variances, axes) = eigen(&covariance.map(|x| [x]));
//! assert!((variances[0][0] * variances[1][0] * variances[2][0] - 36.0).abs() < 1e-10);
//! let q = quaternion(&axes.map(|row| row.map(|[x]| x)));
//! assert!((q.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-12);
//! ```

mod eigen;
mod rotation;
#[cfg(feature = "formats")]
pub(crate) mod sh_basis;
#[cfg(feature = "formats")]
mod smallest;
mod solve;

pub use eigen::{eigen, eigen_of};
pub use rotation::{quaternion, quaternion_product, rotation, scaled_rotation, unit_quaternion};
#[cfg(feature = "formats")]
pub(crate) use smallest::{completed, smallest_three, unit};
pub use solve::solve;

/// Rows of a 3x3 matrix.
pub(crate) type Matrix<T = f64> = [[T; 3]; 3];

/// A symmetric 3x3 matrix as `[xx, yy, zz, xy, xz, yz]`.
pub type Symmetric<T = f64> = [T; 6];

/// The bits of a float as a number that ascends with the float, -0 before 0.
#[inline(always)]
#[must_use]
pub const fn ascending(bits: u32) -> u32 {
    if bits >> 31 == 1 { !bits } else { bits | 1 << 31 }
}

/// The inverse of [`ascending`].
#[inline(always)]
#[must_use]
pub const fn of_ascending(key: u32) -> u32 {
    if key >> 31 == 1 { key & !(1 << 31) } else { !key }
}

/// `R diag(d) R^T`: the symmetric matrix of which the columns of the rotation `R` are the axes
/// and `d` the eigenvalues.
#[inline(always)]
#[must_use]
pub fn axes_product(r: &Matrix, d: [f64; 3]) -> Symmetric {
    let at = |i: usize, j: usize| (0..3).map(|k| r[i][k] * d[k] * r[j][k]).sum::<f64>();
    [at(0, 0), at(1, 1), at(2, 2), at(0, 1), at(0, 2), at(1, 2)]
}
