//! Eigendecomposition of a symmetric 3x3 matrix by cyclic Jacobi rotations.
//!
//! A fixed number of sweeps and only + - * / and sqrt: the result has the same bits on every
//! machine, which an encoder needs as much as a decoder (equal input, equal stream).

/// Jacobi converges quadratically; six sweeps reach rounding level for any 3x3 input, two more
/// cost nothing that shows.
const SWEEPS: usize = 8;

/// Eigenvalues and eigenvectors of the symmetric matrix with entries xx, xy, xz, yy, yz, zz.
/// `vectors[row][k]` is component `row` of the unit eigenvector of `values[k]`; the vectors form
/// a rotation (determinant +1). Values come in no particular order.
pub(crate) fn symmetric_eigen(entries: [f64; 6]) -> ([f64; 3], [[f64; 3]; 3]) {
    let [xx, xy, xz, yy, yz, zz] = entries;
    let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] != 0.0 {
                rotate(&mut a, &mut v, p, q);
            }
        }
    }
    ([a[0][0], a[1][1], a[2][2]], v)
}

/// One Jacobi rotation in the (p, q) plane: makes a[p][q] zero.
fn rotate(a: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) {
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    // The smaller root of t² + 2 theta t - 1: a rotation of at most 45 degrees. For an off-diagonal
    // entry so small that theta overflows, t is 0 and the entry is dropped below.
    let t = if theta < 0.0 { -1.0 } else { 1.0 } / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    let off = a[p][q];
    a[p][p] -= t * off;
    a[q][q] += t * off;
    a[p][q] = 0.0;
    a[q][p] = 0.0;
    let r = 3 - p - q;
    let (arp, arq) = (a[r][p], a[r][q]);
    a[r][p] = c * arp - s * arq;
    a[p][r] = a[r][p];
    a[r][q] = s * arp + c * arq;
    a[q][r] = a[r][q];
    for row in v.iter_mut() {
        let (vp, vq) = (row[p], row[q]);
        row[p] = c * vp - s * vq;
        row[q] = s * vp + c * vq;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn check(entries: [f64; 6]) {
        let [xx, xy, xz, yy, yz, zz] = entries;
        let m = nalgebra::Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let size = m.abs().max();
        let (values, vectors) = symmetric_eigen(entries);
        let v = nalgebra::Matrix3::from_fn(|i, j| vectors[i][j]);
        let d = nalgebra::Matrix3::from_diagonal(&nalgebra::Vector3::from(values));
        assert!((v * d * v.transpose() - m).abs().max() <= 1e-14 * size, "{entries:?}");
        assert!((v.transpose() * v - nalgebra::Matrix3::identity()).abs().max() < 1e-14);
        assert!((v.determinant() - 1.0).abs() < 1e-13);
        // The reference: nalgebra's QR iteration.
        let mut reference: Vec<f64> = m.symmetric_eigenvalues().iter().copied().collect();
        let mut values = values.to_vec();
        reference.sort_by(f64::total_cmp);
        values.sort_by(f64::total_cmp);
        for (a, b) in values.iter().zip(&reference) {
            assert!((a - b).abs() <= 1e-13 * size, "{values:?} {reference:?}");
        }
    }

    proptest! {
        #[test]
        fn agrees_with_nalgebra(m in prop::array::uniform6(-1.0f64..1.0)) {
            check(m);
        }

        #[test]
        fn agrees_on_nearly_degenerate_matrices(
            m in prop::array::uniform6(-1.0f64..1.0), tiny in 0usize..6,
        ) {
            let mut m = m.map(|c| (c * 3.0).round() / 3.0);
            m[tiny] += 1e-12;
            check(m);
        }
    }

    #[test]
    fn extreme_entries_stay_finite() {
        for e in [[0.0; 6], [1.0, 1e-300, 0.0, 1.0, 1e-310, 0.0], [1.0; 6]] {
            let (values, vectors) = symmetric_eigen(e);
            assert!(values.iter().chain(vectors.iter().flatten()).all(|c| c.is_finite()), "{e:?}");
        }
    }
}
