//! Principal axes of a merged covariance, kept close to those of its largest member.

use crate::gaussian::Symmetric;

/// Sweeps of the cyclic Jacobi method. Convergence is quadratic: 3x3 matrices take 4 to 6.
const MAX_SWEEPS: usize = 16;

/// Off-diagonal entries of at most this, squared and relative to the product of the two diagonal
/// ones, are gone after one more rotation each: what they leave is as their square.
const LAST: f64 = 1e-16;

/// ... and these are zero. Relative to the geometric mean of the diagonal entries: this keeps the
/// small axes of flat Gaussians to full relative accuracy.
const NEGLIGIBLE: f64 = 1e-30;

/// A symmetric matrix on its way to a diagonal one, and the axes so far.
struct Jacobi {
    m: [[f64; 3]; 3],
    v: [[f64; 3]; 3],
}

impl Jacobi {
    /// Makes entry `P`, `Q` zero; `R` is the third index. True if another sweep is needed.
    #[inline(always)]
    fn rotate<const P: usize, const Q: usize, const R: usize>(&mut self) -> bool {
        let (m, v) = (&mut self.m, &mut self.v);
        let off = m[P][Q];
        let product = (m[P][P] * m[Q][Q]).abs();
        let square = off * off;
        if square <= NEGLIGIBLE * product {
            return false;
        }
        // tan of the smaller angle: t^2 + 2 t cot(2 angle) = 1.
        let difference = m[Q][Q] - m[P][P];
        let hypotenuse = (difference * difference + 4.0 * square).sqrt();
        let t = 2.0 * off / (difference + hypotenuse.copysign(difference));
        let c = 1.0 / (t * t + 1.0).sqrt();
        let s = t * c;
        m[P][P] -= t * off;
        m[Q][Q] += t * off;
        m[P][Q] = 0.0;
        m[Q][P] = 0.0;
        let (x, y) = (m[R][P], m[R][Q]);
        m[R][P] = c * x - s * y;
        m[P][R] = m[R][P];
        m[R][Q] = s * x + c * y;
        m[Q][R] = m[R][Q];
        for row in v {
            let (x, y) = (row[P], row[Q]);
            row[P] = c * x - s * y;
            row[Q] = s * x + c * y;
        }
        square > LAST * product
    }
}

/// Diagonalises `a`: `a = v diag(d) v^T` with `v` a rotation, as `(d, v)`.
///
/// Cyclic Jacobi with the smaller of the two possible angles in every step, so a nearly
/// diagonal `a` gives a `v` near the identity: axes keep their order and signs. That is why
/// this is not a library's routine, which sorts eigenvalues: a merged Gaussian's rotation
/// should differ as little as possible from that of the member it mostly is.
pub(crate) fn jacobi(a: Symmetric) -> ([f64; 3], [[f64; 3]; 3]) {
    let mut state = Jacobi {
        m: [[a[0], a[3], a[4]], [a[3], a[1], a[5]], [a[4], a[5], a[2]]],
        v: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    };
    for _ in 0..MAX_SWEEPS {
        let again = [
            state.rotate::<0, 1, 2>(),
            state.rotate::<0, 2, 1>(),
            state.rotate::<1, 2, 0>(),
        ];
        if again == [false; 3] {
            break;
        }
    }
    let Jacobi { m, v } = state;
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
