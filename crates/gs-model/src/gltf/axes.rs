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
    use crate::math::{axes_product, rotation, sh_basis};

    #[test]
    fn signs_are_those_of_the_basis_functions() {
        assert_eq!(sh_basis::signs_under([-1.0, -1.0, 1.0]), SH_SIGNS);
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
