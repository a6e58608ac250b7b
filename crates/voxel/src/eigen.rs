//! Principal axes of a merged covariance, kept close to those of its largest member.

use crate::gaussian::Symmetric;

/// Sweeps of the cyclic Jacobi method. Convergence is quadratic: 3x3 matrices take 4 to 6.
const MAX_SWEEPS: usize = 16;

/// Diagonalises `a`: `a = v diag(d) v^T` with `v` a rotation, as `(d, v)`.
///
/// Cyclic Jacobi with the smaller of the two possible angles in every step, so a nearly
/// diagonal `a` gives a `v` near the identity: axes keep their order and signs. That is why
/// this is not a library's routine, which sorts eigenvalues: a merged Gaussian's rotation
/// should differ as little as possible from that of the member it mostly is.
pub(crate) fn jacobi(a: Symmetric) -> ([f64; 3], [[f64; 3]; 3]) {
    let mut m = [[a[0], a[3], a[4]], [a[3], a[1], a[5]], [a[4], a[5], a[2]]];
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..MAX_SWEEPS {
        let mut rotated = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = m[p][q];
            // Negligible against the geometric mean of the two diagonal entries: this keeps
            // the small axes of flat Gaussians to full relative accuracy.
            let scale = (m[p][p].abs() * m[q][q].abs()).sqrt();
            if off == 0.0 || off.abs() <= 1e-15 * scale {
                continue;
            }
            rotated = true;
            let theta = (m[q][q] - m[p][p]) / (2.0 * off);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            m[p][p] -= t * off;
            m[q][q] += t * off;
            m[p][q] = 0.0;
            m[q][p] = 0.0;
            let r = 3 - p - q;
            let (x, y) = (m[r][p], m[r][q]);
            m[r][p] = c * x - s * y;
            m[p][r] = m[r][p];
            m[r][q] = s * x + c * y;
            m[q][r] = m[r][q];
            for row in &mut v {
                let (x, y) = (row[p], row[q]);
                row[p] = c * x - s * y;
                row[q] = s * x + c * y;
            }
        }
        if !rotated {
            break;
        }
    }
    ([m[0][0], m[1][1], m[2][2]], v)
}

/// The unit quaternion `[w, x, y, z]` of a rotation matrix near the identity or not.
pub(crate) fn quaternion(r: &[[f64; 3]; 3]) -> [f64; 4] {
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

/// Hamilton product.
pub(crate) fn multiply(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
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
    use crate::gaussian::{congruence, rotation};

    #[test]
    fn diagonalises_and_keeps_axes() {
        let q = [0.9f32, 0.1, -0.2, 0.05];
        for d in [[1.0, 2.0, 3.0], [1e-12, 1.0, 4.0], [5.0, 5.0, 5.0], [1e100, 1.0, 1e-100]] {
            let a = congruence(&rotation(q), d);
            let (values, v) = jacobi(a);
            let back = congruence(&v, values);
            let scale = d.iter().fold(0.0, |m: f64, x| m.max(*x));
            for (x, y) in a.iter().zip(back) {
                assert!((x - y).abs() <= 1e-13 * scale, "{a:?} {back:?}");
            }
            // Axes stay in order: each column is within 45 degrees of its own axis.
            assert!((0..3).all(|k| v[k][k] > 0.7), "{v:?}");
        }
    }

    #[test]
    fn quaternion_inverts_rotation() {
        for q in [[1.0f32, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.1, 0.2, -0.9, 0.3]] {
            let r = rotation(q);
            let back = rotation(quaternion(&r).map(|x| x as f32));
            for i in 0..9 {
                assert!((r[i / 3][i % 3] - back[i / 3][i % 3]).abs() < 1e-6);
            }
        }
    }
}
