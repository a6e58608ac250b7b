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

use gs_model::math::{quaternion_product, unit_quaternion};

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
    let q = unit_quaternion(quaternion.map(f64::from));
    let by = smallest_angle(q);
    let turned = quaternion_product(q, by.quaternion);
    let sign = if turned[0] < 0.0 { -1.0 } else { 1.0 };
    // Adding zero turns -0.0 into 0.0: equal rotations should have equal bits.
    let turned = turned.map(|c| (sign * c) as f32 + 0.0);
    (turned, by.axis.map(|k| log_scales[usize::from(k)]))
}

/// The rotation of the cube that, applied on the right, leaves `q` with the largest |w|.
fn smallest_angle(q: [f64; 4]) -> &'static CubeRotation {
    let w = |e: &CubeRotation| quaternion_product(q, e.quaternion)[0].abs();
    let mut best = (&CUBE[0], w(&CUBE[0]) + MARGIN);
    for candidate in &CUBE[1..] {
        let size = w(candidate);
        if size > best.1 {
            best = (candidate, size);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use gs_model::math::{axes_product, rotation, scaled_rotation};
    use proptest::prelude::*;

    use super::*;

    fn gaussian() -> impl Strategy<Value = ([f32; 4], [f32; 3])> {
        (prop::array::uniform4(-1.0f32..1.0), prop::array::uniform3(-8.0f32..2.0))
            .prop_filter("some length", |(q, _)| q.iter().map(|c| c * c).sum::<f32>() > 1e-6)
    }

    fn covariance(q: [f32; 4], log_scales: [f32; 3]) -> [f64; 6] {
        axes_product(&rotation(q), log_scales.map(|l| libm::exp(2.0 * f64::from(l))))
    }

    #[test]
    fn the_table_is_the_group_of_the_cube() {
        for (n, e) in CUBE.iter().enumerate() {
            let m = scaled_rotation(e.quaternion, 2.0);
            for column in 0..3 {
                for row in 0..3 {
                    let wanted = f64::from(u8::from(e.axis[column] as usize == row));
                    assert!((m[row][column].abs() - wanted).abs() < 1e-15, "element {n}: {m:?}");
                }
            }
            for other in &CUBE[..n] {
                let dot: f64 = (0..4).map(|k| e.quaternion[k] * other.quaternion[k]).sum();
                assert!(dot.abs() < 0.9, "element {n} twice");
            }
        }
    }

    proptest! {
        #[test]
        fn the_covariance_is_kept_and_the_angle_is_small(g in gaussian()) {
            let (q, s) = canonicalise(g.0, g.1);
            prop_assert!(q[0] >= 0.8535, "{q:?}");
            let (a, b) = (covariance(g.0, g.1), covariance(q, s));
            let size = a[0] + a[1] + a[2];
            prop_assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * size), "{a:?} {b:?}");
        }

        #[test]
        fn every_representative_gives_the_same_result(g in gaussian(), n in 0usize..24, flip: bool) {
            let sign = if flip { -1.0 } else { 1.0 };
            let q = unit_quaternion(g.0.map(f64::from));
            let other = quaternion_product(q, CUBE[n].quaternion).map(|c| (sign * c) as f32);
            let (qa, sa) = canonicalise(g.0, g.1);
            let (qb, sb) = canonicalise(other, CUBE[n].axis.map(|k| g.1[usize::from(k)]));
            prop_assert!((qa[0] - qb[0]).abs() < 2e-6);
            // On the border between two representatives either is right.
            let mut sizes = CUBE.each_ref().map(|e| quaternion_product(q, e.quaternion)[0].abs());
            sizes.sort_by(|a, b| b.total_cmp(a));
            let dot: f64 = (0..4).map(|k| f64::from(qa[k]) * f64::from(qb[k])).sum();
            prop_assert!(dot > 1.0 - 1e-5 && sa == sb || sizes[0] - sizes[1] < 2e-6);
        }

        #[test]
        fn a_second_pass_changes_nothing(g in gaussian()) {
            let (q, s) = canonicalise(g.0, g.1);
            let (again, scales) = canonicalise(q, s);
            prop_assert_eq!(s, scales);
            prop_assert!((0..4).all(|k| (q[k] - again[k]).abs() <= 1.2e-7));
        }
    }

    #[test]
    fn degenerate_input_is_the_identity() {
        for q in [[0.0; 4], [f32::NAN; 4]] {
            assert_eq!(canonicalise(q, [1.0, 2.0, 3.0]), ([1.0, 0.0, 0.0, 0.0], [1.0, 2.0, 3.0]));
        }
    }
}
