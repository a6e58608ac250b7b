//! Systems of linear equations.

/// Solves symmetric positive definite equations by Gaussian elimination, without pivots.
///
/// ```
/// assert_eq!(gs_model::math::solve(&[[4.0, 2.0], [2.0, 3.0]], [10.0, 9.0]), [1.5, 2.0]);
/// ```
#[must_use]
pub fn solve<const N: usize>(a: &[[f64; N]; N], mut b: [f64; N]) -> [f64; N] {
    let mut a = *a;
    for k in 0..N {
        for r in k + 1..N {
            let factor = a[r][k] / a[k][k];
            for c in k..N {
                a[r][c] -= factor * a[k][c];
            }
            b[r] -= factor * b[k];
        }
    }
    for r in (0..N).rev() {
        for c in r + 1..N {
            b[r] -= a[r][c] * b[c];
        }
        b[r] /= a[r][r];
    }
    b
}
