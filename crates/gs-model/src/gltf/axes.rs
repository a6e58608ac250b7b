//! Half a turn about z, which leads from the axes of PLY files to glTF's and back.

/// Sign of each basis function under `(x, y, z) -> (-x, -y, z)`, degrees 0 to 3.
pub(super) const SH_SIGNS: [f32; 16] =
    [1., -1., 1., -1., 1., -1., 1., -1., 1., -1., 1., -1., 1., -1., 1., -1.];

/// A mean, turned.
pub(super) fn turned([x, y, z]: [f32; 3]) -> [f32; 3] {
    [-x, -y, z]
}

/// A quaternion `[w, x, y, z]`, turned. The axes of its Gaussian keep their names: each of them changes
/// its sign at most, and a Gaussian is symmetric.
pub(super) fn turned_rotation([w, x, y, z]: [f32; 4]) -> [f32; 4] {
    [w, -x, -y, z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{axes_product, rotation};

    #[test]
    fn signs_are_those_of_the_basis_functions() {
        // The polynomials of the real spherical harmonics, in 3DGS order, without constants.
        let basis: [fn(f64, f64, f64) -> f64; 16] = [
            |_, _, _| 1.0,
            |_, y, _| y,
            |_, _, z| z,
            |x, _, _| x,
            |x, y, _| x * y,
            |_, y, z| y * z,
            |x, y, z| 2.0 * z * z - x * x - y * y,
            |x, _, z| x * z,
            |x, y, _| x * x - y * y,
            |x, y, _| y * (3.0 * x * x - y * y),
            |x, y, z| x * y * z,
            |x, y, z| y * (4.0 * z * z - x * x - y * y),
            |x, y, z| z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y),
            |x, y, z| x * (4.0 * z * z - x * x - y * y),
            |x, y, z| z * (x * x - y * y),
            |x, y, _| x * (x * x - 3.0 * y * y),
        ];
        for (f, sign) in basis.iter().zip(SH_SIGNS) {
            assert_eq!(f(-0.3, -0.6, 0.5), f64::from(sign) * f(0.3, 0.6, 0.5));
        }
    }

    #[test]
    fn a_covariance_is_turned_as_points_are() {
        let q = [0.8, 0.3, -0.4, 0.2];
        let variances = [1.0, 4.0, 9.0];
        let before = axes_product(&rotation(q), variances);
        let after = axes_product(&rotation(turned_rotation(q)), variances);
        // xx, yy, zz, xy, xz, yz: x and y change sign, z does not.
        for (k, sign) in [1.0, 1.0, 1.0, 1.0, -1.0, -1.0].into_iter().enumerate() {
            assert!((after[k] - sign * before[k]).abs() < 1e-12, "{k}");
        }
    }
}
