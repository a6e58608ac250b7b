//! Quaternions `[w, x, y, z]` and rotation matrices.

use std::ops::{Add, Mul, Sub};

use super::Matrix;

/// Rotation matrix of a quaternion of any norm; the identity for a zero or non-finite one. The
/// columns are the principal axes of a Gaussian of that rotation.
#[inline(always)]
#[must_use]
pub fn rotation(q: [f32; 4]) -> Matrix {
    let q = q.map(f64::from);
    let norm_squared = q.iter().map(|x| x * x).sum::<f64>();
    if norm_squared > 0.0 && norm_squared.is_finite() {
        scaled_rotation(q, 2.0 / norm_squared)
    } else {
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    }
}

/// Rotation matrix of a quaternion, in `f32` or `f64`, where `s` is two divided by the squared
/// norm: 2 for a unit quaternion.
#[inline(always)]
#[must_use]
pub fn scaled_rotation<T>(q: [T; 4], s: T) -> Matrix<T>
where
    T: Copy + From<u8> + Add<Output = T> + Sub<Output = T> + Mul<Output = T>,
{
    let one = T::from(1);
    let [w, x, y, z] = q;
    [
        [one - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
        [s * (x * y + w * z), one - s * (x * x + z * z), s * (y * z - w * x)],
        [s * (x * z - w * y), s * (y * z + w * x), one - s * (x * x + y * y)],
    ]
}

/// A unit quaternion of a rotation matrix. Its sign makes the component of largest magnitude
/// positive.
#[inline(always)]
#[must_use]
pub fn quaternion(r: &Matrix) -> [f64; 4] {
    // Shepperd's method: divide by the largest component.
    let trace = r[0][0] + r[1][1] + r[2][2];
    let q = if trace >= r[0][0] && trace >= r[1][1] && trace >= r[2][2] {
        [1.0 + trace, r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]]
    } else if r[0][0] >= r[1][1] && r[0][0] >= r[2][2] {
        [r[2][1] - r[1][2], 1.0 + 2.0 * r[0][0] - trace, r[0][1] + r[1][0], r[0][2] + r[2][0]]
    } else if r[1][1] >= r[2][2] {
        [r[0][2] - r[2][0], r[0][1] + r[1][0], 1.0 + 2.0 * r[1][1] - trace, r[1][2] + r[2][1]]
    } else {
        [r[1][0] - r[0][1], r[0][2] + r[2][0], r[1][2] + r[2][1], 1.0 + 2.0 * r[2][2] - trace]
    };
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    q.map(|x| x / norm)
}

/// A quaternion of any norm scaled to unit norm; the identity for a zero or non-finite one.
#[inline(always)]
#[must_use]
pub fn unit_quaternion(q: [f64; 4]) -> [f64; 4] {
    let largest = q.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    if largest == 0.0 || q.iter().any(|x| !x.is_finite()) {
        return [1.0, 0.0, 0.0, 0.0];
    }
    // Relative to the largest, because squares of others may be out of range.
    let q = q.map(|x| x / largest);
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    q.map(|x| x / norm)
}

/// Hamilton product: the rotation `b`, then the rotation `a`.
#[inline(always)]
#[must_use]
pub fn quaternion_product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUATERNIONS: [[f32; 4]; 6] = [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.1, 0.2, -0.9, 0.3],
        [-0.2, 0.1, 0.3, 0.9],
        [3.0, -4.0, 0.5, 2.0],
        [1e-18, 2e-18, -1e-18, 0.0],
    ];

    #[test]
    fn quaternion_inverts_rotation() {
        for q in QUATERNIONS {
            let r = rotation(q);
            let back = quaternion(&r);
            let norm = q.iter().map(|&x| f64::from(x) * f64::from(x)).sum::<f64>().sqrt();
            let dot: f64 = (0..4).map(|k| f64::from(q[k]) / norm * back[k]).sum();
            assert!((dot.abs() - 1.0).abs() < 1e-14, "{q:?} {back:?}");
            let largest = back.iter().fold(0.0, |m: f64, x| if x.abs() > m.abs() { *x } else { m });
            assert!(largest > 0.0, "{back:?}");
        }
    }

    #[test]
    fn product_of_quaternions_is_product_of_matrices() {
        for a in QUATERNIONS {
            for b in QUATERNIONS {
                let (ra, rb) = (rotation(a), rotation(b));
                let product = quaternion_product(quaternion(&ra), quaternion(&rb));
                let r = scaled_rotation(product, 2.0);
                for i in 0..3 {
                    for j in 0..3 {
                        let sum: f64 = (0..3).map(|k| ra[i][k] * rb[k][j]).sum();
                        assert!((sum - r[i][j]).abs() < 1e-14);
                    }
                }
            }
        }
    }

    #[test]
    fn both_precisions_agree() {
        for q in QUATERNIONS {
            let norm = q.iter().map(|x| x * x).sum::<f32>();
            if norm < 1e-20 {
                continue;
            }
            let (single, double) = (scaled_rotation(q, 2.0 / norm), rotation(q));
            for (a, b) in single.as_flattened().iter().zip(double.as_flattened()) {
                assert!((f64::from(*a) - b).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_quaternion_without_direction_gives_the_identity() {
        let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for q in [[0.0; 4], [f32::NAN, 0.0, 0.0, 1.0], [f32::INFINITY, 0.0, 0.0, 0.0]] {
            assert_eq!(rotation(q), identity);
            assert_eq!(unit_quaternion(q.map(f64::from)), [1.0, 0.0, 0.0, 0.0]);
        }
        for length in [f64::MIN_POSITIVE, 2.0, f64::MAX] {
            assert_eq!(unit_quaternion([0.0, -length, 0.0, 0.0]), [0.0, -1.0, 0.0, 0.0]);
        }
    }
}
