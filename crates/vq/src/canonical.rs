//! One representative per covariance.
//!
//! The covariance R S² Rᵀ of a Gaussian does not change when its axes are renamed or flipped:
//! 24 proper rotations of the cube times the sign of the quaternion, 48 pairs (quaternion,
//! log-scales) for one ellipsoid. Training leaves an arbitrary one of them in the file; coded as
//! it stands, neighbours of equal shape look unrelated ("PRAS" in KISS: -0.11 dB at equal rate
//! without this step). The functions here choose the representative and touch nothing else:
//! the covariance stays the same up to the rounding of the quaternion to f32, and the log-scales
//! are permuted, never recomputed.
//!
//! ```
//! use vq::canonical::{Form, canonicalise, canonicalise_as};
//!
//! // A quarter turn about z exchanges the first two axes: the same ellipsoid, unrotated.
//! let half = 0.5f32.sqrt();
//! let (q, log_scales) = canonicalise([half, 0.0, 0.0, half], [-1.0, -2.0, -3.0]);
//! assert_eq!((q, log_scales), ([1.0, 0.0, 0.0, 0.0], [-2.0, -1.0, -3.0]));
//!
//! // Sorted form: largest axis first.
//! let (_, sorted) = canonicalise_as([1.0, 0.0, 0.0, 0.0], [-3.0, -1.0, -2.0], Form::Sorted);
//! assert_eq!(sorted, [-1.0, -2.0, -3.0]);
//! ```

use crate::quaternion::{normalised, product};

/// Which representative of the 48 is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Form {
    /// The smallest rotation angle: at most 62.8 degrees, w >= 0.853. The log-scales belong to
    /// the axes that lie nearest to the world's x, y, z, in that order.
    #[default]
    NearestIdentity,
    /// Log-scales in descending order, then the smallest rotation angle among the four flips
    /// that are left: at most 120 degrees, w >= 0.5.
    Sorted,
}

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

/// The representative of least rotation angle, [`Form::NearestIdentity`].
///
/// `quaternion` is (w, x, y, z) of any length; the result has unit length and w > 0. One that
/// is not finite or has no length counts as the identity.
pub fn canonicalise(quaternion: [f32; 4], log_scales: [f32; 3]) -> ([f32; 4], [f32; 3]) {
    canonicalise_as(quaternion, log_scales, Form::NearestIdentity)
}

/// The representative in the given [`Form`]; see [`canonicalise`].
pub fn canonicalise_as(
    quaternion: [f32; 4],
    log_scales: [f32; 3],
    form: Form,
) -> ([f32; 4], [f32; 3]) {
    let q = normalised(quaternion);
    let chosen = match form {
        Form::NearestIdentity => smallest_angle(q, &CUBE),
        Form::Sorted => {
            // Four rotations of the group do the same permutation; they differ by flips.
            let order = descending(log_scales);
            let first = CUBE.iter().position(|e| e.axis == order).unwrap_or(0);
            smallest_angle(q, &CUBE[first..first + 4])
        }
    };
    apply(q, log_scales, chosen)
}

/// The representative that lies nearest to a reference, for an encoder that wants neighbours to
/// look alike: the distance is the squared difference of the log-scales times
/// `log_scale_weight` plus that of the quaternions, over all 48 pairs.
///
/// `reference` should itself be a result of this module, a decoded neighbour or any unit
/// quaternion. A decoder needs no knowledge of the choice. The quaternion's sign follows the
/// reference: w may be negative.
pub fn canonicalise_near(
    quaternion: [f32; 4],
    log_scales: [f32; 3],
    reference: ([f32; 4], [f32; 3]),
    log_scale_weight: f64,
) -> ([f32; 4], [f32; 3]) {
    let q = normalised(quaternion);
    let near = normalised(reference.0);
    let mut best = (&CUBE[0], f64::INFINITY, 1.0);
    for candidate in &CUBE {
        let turned = product(q, candidate.quaternion);
        let dot =
            turned[0] * near[0] + turned[1] * near[1] + turned[2] * near[2] + turned[3] * near[3];
        let mut distance = 2.0 - 2.0 * dot.abs();
        for k in 0..3 {
            let d =
                f64::from(log_scales[usize::from(candidate.axis[k])]) - f64::from(reference.1[k]);
            distance += log_scale_weight * d * d;
        }
        if distance < best.1 {
            best = (candidate, distance, if dot < 0.0 { -1.0 } else { 1.0 });
        }
    }
    let turned = product(q, best.0.quaternion).map(|c| (c * best.2) as f32);
    (turned, best.0.axis.map(|k| log_scales[usize::from(k)]))
}

/// The rotation of `group` that, applied on the right, leaves `q` with the largest |w|.
/// `group` holds the choice that keeps `q` as it is, if at all, in its first place.
fn smallest_angle(q: [f64; 4], group: &'static [CubeRotation]) -> &'static CubeRotation {
    let w = |e: &CubeRotation| {
        let p = e.quaternion;
        (q[0] * p[0] - q[1] * p[1] - q[2] * p[2] - q[3] * p[3]).abs()
    };
    let mut best = (0, w(&group[0]) + MARGIN);
    for (k, candidate) in group.iter().enumerate().skip(1) {
        let size = w(candidate);
        if size > best.1 {
            best = (k, size);
        }
    }
    &group[best.0]
}

fn apply(q: [f64; 4], log_scales: [f32; 3], by: &CubeRotation) -> ([f32; 4], [f32; 3]) {
    let turned = product(q, by.quaternion);
    let sign = if turned[0] < 0.0 { -1.0 } else { 1.0 };
    // Adding zero turns -0.0 into 0.0: equal rotations should have equal bits.
    let turned = turned.map(|c| (sign * c) as f32 + 0.0);
    (turned, by.axis.map(|k| log_scales[usize::from(k)]))
}

/// Axes by descending log-scale; equal ones keep their order.
fn descending(log_scales: [f32; 3]) -> [u8; 3] {
    let mut order = [0u8, 1, 2];
    order.sort_by(|&a, &b| {
        let (a, b) = (log_scales[usize::from(a)], log_scales[usize::from(b)]);
        b.total_cmp(&a)
    });
    order
}

#[cfg(test)]
#[path = "canonical_tests.rs"]
mod tests;
