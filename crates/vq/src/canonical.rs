//! One representative for each covariance.
//!
//! The covariance R S² Rᵀ of a Gaussian does not change when its axes are renamed or flipped. There
//! are 24 rotations of the cube and two signs of the quaternion, so 48 pairs (quaternion,
//! log-scales) stand for one ellipsoid, and training leaves an arbitrary one of them in the file.
//! The function here chooses the pair with the smallest rotation angle: at most 62.8 degrees, w >=
//! 0.853. The log-scales then belong to the axes that lie nearest to the world's x, y, z, in that
//! order.
//!
//! Invariant: the covariance stays the same up to the rounding of the quaternion to f32, and the
//! log-scales are permuted, never recomputed.

use crate::quaternion::{normalised, product};

const HALF: f64 = 0.5;
const DIAGONAL: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// An element of the rotation group of the cube: `quaternion`, and for each new axis the old
/// axis whose scale it takes.
struct CubeRotation {
    quaternion: [f64; 4],
    axis: [u8; 3],
}

const fn element(quaternion: [f64; 4], axis: [u8; 3]) -> CubeRotation {
    CubeRotation { quaternion, axis }
}

/// The 24 rotations of the cube, identity first, one of the two quaternion signs each.
/// `axis` is checked against the matrices by a test.
const CUBE: [CubeRotation; 24] = [
    element([1.0, 0.0, 0.0, 0.0], [0, 1, 2]),
    element([0.0, 1.0, 0.0, 0.0], [0, 1, 2]),
    element([0.0, 0.0, 1.0, 0.0], [0, 1, 2]),
    element([0.0, 0.0, 0.0, 1.0], [0, 1, 2]),
    element([DIAGONAL, DIAGONAL, 0.0, 0.0], [0, 2, 1]),
    element([DIAGONAL, -DIAGONAL, 0.0, 0.0], [0, 2, 1]),
    element([0.0, 0.0, DIAGONAL, DIAGONAL], [0, 2, 1]),
    element([0.0, 0.0, DIAGONAL, -DIAGONAL], [0, 2, 1]),
    element([DIAGONAL, 0.0, DIAGONAL, 0.0], [2, 1, 0]),
    element([DIAGONAL, 0.0, -DIAGONAL, 0.0], [2, 1, 0]),
    element([0.0, DIAGONAL, 0.0, DIAGONAL], [2, 1, 0]),
    element([0.0, DIAGONAL, 0.0, -DIAGONAL], [2, 1, 0]),
    element([DIAGONAL, 0.0, 0.0, DIAGONAL], [1, 0, 2]),
    element([DIAGONAL, 0.0, 0.0, -DIAGONAL], [1, 0, 2]),
    element([0.0, DIAGONAL, DIAGONAL, 0.0], [1, 0, 2]),
    element([0.0, DIAGONAL, -DIAGONAL, 0.0], [1, 0, 2]),
    element([HALF, HALF, HALF, HALF], [1, 2, 0]),
    element([HALF, HALF, -HALF, -HALF], [1, 2, 0]),
    element([HALF, -HALF, HALF, -HALF], [1, 2, 0]),
    element([HALF, -HALF, -HALF, HALF], [1, 2, 0]),
    element([HALF, -HALF, -HALF, -HALF], [2, 0, 1]),
    element([HALF, HALF, HALF, -HALF], [2, 0, 1]),
    element([HALF, HALF, -HALF, HALF], [2, 0, 1]),
    element([HALF, -HALF, HALF, HALF], [2, 0, 1]),
];

/// How much larger |w| must be before a representative other than the given one is taken.
/// Without it the rounding of the result to f32 could flip the choice on a second pass.
const MARGIN: f64 = 1e-6;

/// The representative of least rotation angle.
///
/// `quaternion` is (w, x, y, z) of any length; the result has unit length and w > 0. One that
/// is not finite or has no length counts as the identity.
pub(crate) fn canonicalise(quaternion: [f32; 4], log_scales: [f32; 3]) -> ([f32; 4], [f32; 3]) {
    let q = normalised(quaternion);
    let by = smallest_angle(q);
    let turned = product(q, by.quaternion);
    let sign = if turned[0] < 0.0 { -1.0 } else { 1.0 };
    // Adding zero turns -0.0 into 0.0: equal rotations should have equal bits.
    let turned = turned.map(|c| (sign * c) as f32 + 0.0);
    (turned, by.axis.map(|k| log_scales[usize::from(k)]))
}

/// The rotation of the cube that, applied on the right, leaves `q` with the largest |w|.
fn smallest_angle(q: [f64; 4]) -> &'static CubeRotation {
    let w = |e: &CubeRotation| {
        let p = e.quaternion;
        (q[0] * p[0] - q[1] * p[1] - q[2] * p[2] - q[3] * p[3]).abs()
    };
    let mut best = (0, w(&CUBE[0]) + MARGIN);
    for (k, candidate) in CUBE.iter().enumerate().skip(1) {
        let size = w(candidate);
        if size > best.1 {
            best = (k, size);
        }
    }
    &CUBE[best.0]
}

#[cfg(test)]
#[path = "canonical_tests.rs"]
mod tests;
