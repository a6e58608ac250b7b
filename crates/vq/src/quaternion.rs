//! Quaternion arithmetic in f64 with + - * / and sqrt only, so that every machine agrees on the
//! last bit. Order of components: (w, x, y, z), as in 3DGS PLY files.

/// The rotation that changes nothing.
pub(crate) const IDENTITY: [f64; 4] = [1.0, 0.0, 0.0, 0.0];

/// `q` scaled to unit length. A quaternion that is not finite or has no length becomes the
/// identity: trained scenes contain all-zero rows, and a decoder must still hand out a rotation.
pub(crate) fn normalised(q: [f32; 4]) -> [f64; 4] {
    normalised_f64(q.map(f64::from))
}

/// [`normalised`] for f64 components.
pub(crate) fn normalised_f64(q: [f64; 4]) -> [f64; 4] {
    let largest = q.iter().fold(0.0f64, |m, c| if c.abs() > m { c.abs() } else { m });
    if q.iter().any(|c| !c.is_finite()) || largest == 0.0 {
        return IDENTITY;
    }
    // Scaled by the largest component first: squares of f32 denormals would underflow to zero.
    let q = q.map(|c| c / largest);
    let norm = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    q.map(|c| c / norm)
}

/// Hamilton product: the rotation `b` followed by the rotation `a`.
pub(crate) fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// Rotation matrix of a unit quaternion, `m[row][column]`; column `k` is the world direction of
/// the Gaussian's axis `k`.
pub(crate) fn to_matrix(q: [f64; 4]) -> [[f64; 3]; 3] {
    let [w, x, y, z] = q;
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Unit quaternion of a rotation matrix (determinant +1), by Shepperd's choice of the largest
/// component as the divisor.
pub(crate) fn from_matrix(m: [[f64; 3]; 3]) -> [f64; 4] {
    // Four times the squares of w, x, y, z.
    let squares = [
        1.0 + m[0][0] + m[1][1] + m[2][2],
        1.0 + m[0][0] - m[1][1] - m[2][2],
        1.0 - m[0][0] + m[1][1] - m[2][2],
        1.0 - m[0][0] - m[1][1] + m[2][2],
    ];
    let mut largest = 0;
    for k in 1..4 {
        if squares[k] > squares[largest] {
            largest = k;
        }
    }
    let s = squares[largest];
    let (zy, xz, yx) = (m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]);
    let (xy, zx, yz) = (m[1][0] + m[0][1], m[0][2] + m[2][0], m[2][1] + m[1][2]);
    normalised_f64(match largest {
        0 => [s, zy, xz, yx],
        1 => [zy, s, xy, zx],
        2 => [xz, xy, s, yz],
        _ => [yx, zx, yz, s],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrix_round_trip_and_product_agree() {
        let mut rng = crate::rng::SplitMix64::new(7);
        for _ in 0..2000 {
            let mut random = || normalised_f64([0; 4].map(|_: i32| rng.unit() - 0.5));
            let (a, b) = (random(), random());
            let back = from_matrix(to_matrix(a));
            let dot: f64 = (0..4).map(|k| a[k] * back[k]).sum();
            assert!((dot.abs() - 1.0).abs() < 1e-14, "{a:?} {back:?}");

            let (ma, mb, mab) = (to_matrix(a), to_matrix(b), to_matrix(product(a, b)));
            for i in 0..3 {
                for j in 0..3 {
                    let sum: f64 = (0..3).map(|k| ma[i][k] * mb[k][j]).sum();
                    assert!((sum - mab[i][j]).abs() < 1e-14);
                }
            }
        }
    }

    #[test]
    fn degenerate_quaternions_become_the_identity() {
        assert_eq!(normalised([0.0; 4]), IDENTITY);
        assert_eq!(normalised([f32::NAN, 0.0, 0.0, 1.0]), IDENTITY);
        assert_eq!(normalised([f32::INFINITY, 0.0, 0.0, 1.0]), IDENTITY);
        let tiny = f32::from_bits(1);
        assert_eq!(normalised([0.0, tiny, 0.0, 0.0]), [0.0, 1.0, 0.0, 0.0]);
    }
}
