//! Principal axes of a merged covariance, kept close to those of its largest member.

/// Sweeps of the cyclic Jacobi method. Convergence is quadratic: 3x3 matrices take 4 to 6.
const MAX_SWEEPS: usize = 16;

/// Off-diagonal entries of at most this, squared and relative to the product of the two diagonal
/// ones, are gone after one more rotation each: what they leave is as their square.
const LAST: f64 = 1e-16;

/// ... and these are zero. Relative to the geometric mean of the diagonal entries: this keeps the
/// small axes of flat Gaussians to full relative accuracy.
const NEGLIGIBLE: f64 = 1e-30;

/// Matrices that are diagonalised together: roots and quotients of one alone are waited for.
pub(crate) const LANES: usize = 8;

/// One number of each of [`LANES`] matrices.
pub(crate) type Lanes = [f64; LANES];

/// Symmetric matrices on their way to diagonal ones, and the axes so far.
struct Jacobi {
    diagonal: [Lanes; 3],
    /// Entry `k` is that of the two indices other than `k`.
    off: [Lanes; 3],
    axes: [[Lanes; 3]; 3],
    /// What counts as zero: [`NEGLIGIBLE`], or infinity where the iteration has ended.
    limit: Lanes,
    /// Whether another sweep is needed, as 1 or 0.
    again: Lanes,
}

impl Jacobi {
    /// Makes entry `P`, `Q` zero; `R` is the third index.
    #[inline(always)]
    fn rotate<const P: usize, const Q: usize, const R: usize>(&mut self) {
        let (mut cos, mut sin) = ([0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            let (p, q, off) = (self.diagonal[P][l], self.diagonal[Q][l], self.off[R][l]);
            let product = (p * q).abs();
            let square = off * off;
            // tan of the smaller angle: t^2 + 2 t cot(2 angle) = 1.
            let difference = q - p;
            let hypotenuse = (difference * difference + 4.0 * square).sqrt();
            let t = 2.0 * off / (difference + hypotenuse.copysign(difference));
            let rotates = square > self.limit[l] * product;
            let t = if rotates { t } else { 0.0 };
            let more = rotates & (square > LAST * product);
            self.again[l] = if more { 1.0 } else { self.again[l] };
            cos[l] = 1.0 / (t * t + 1.0).sqrt();
            sin[l] = t * cos[l];
            self.diagonal[P][l] = p - t * off;
            self.diagonal[Q][l] = q + t * off;
            self.off[R][l] = if rotates { 0.0 } else { off };
        }
        let turn = |x: &mut f64, y: &mut f64, c: f64, s: f64| {
            (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
        };
        // Of row R: the entry beside P is the one that Q is absent from.
        for l in 0..LANES {
            let (mut x, mut y) = (self.off[Q][l], self.off[P][l]);
            turn(&mut x, &mut y, cos[l], sin[l]);
            (self.off[Q][l], self.off[P][l]) = (x, y);
        }
        for row in &mut self.axes {
            for l in 0..LANES {
                let (mut x, mut y) = (row[P][l], row[Q][l]);
                turn(&mut x, &mut y, cos[l], sin[l]);
                (row[P][l], row[Q][l]) = (x, y);
            }
        }
    }
}

/// Diagonalises each `a`, given entry by entry (zero where there are fewer matrices):
/// `a = v diag(d) v^T` with `v` a rotation, as `(d, v)`.
///
/// Cyclic Jacobi with the smaller of the two possible angles in every step, so a nearly
/// diagonal `a` gives a `v` near the identity: axes keep their order and signs. That is why
/// this is not a library's routine, which sorts eigenvalues: a merged Gaussian's rotation
/// should differ as little as possible from that of the member it mostly is. No matrix's result
/// depends on the others.
#[inline(always)]
pub(crate) fn jacobi(a: &[Lanes; 6]) -> ([Lanes; 3], [[Lanes; 3]; 3]) {
    let (zero, one) = ([0.0; LANES], [1.0; LANES]);
    let mut state = Jacobi {
        diagonal: [a[0], a[1], a[2]],
        off: [a[5], a[4], a[3]],
        axes: [[one, zero, zero], [zero, one, zero], [zero, zero, one]],
        limit: [NEGLIGIBLE; LANES],
        again: zero,
    };
    for _ in 0..MAX_SWEEPS {
        state.again = zero;
        state.rotate::<0, 1, 2>();
        state.rotate::<0, 2, 1>();
        state.rotate::<1, 2, 0>();
        for (limit, &again) in state.limit.iter_mut().zip(&state.again) {
            *limit = if again > 0.0 { *limit } else { f64::INFINITY };
        }
        if state.again == zero {
            break;
        }
    }
    (state.diagonal, state.axes)
}

/// The unit quaternion `[w, x, y, z]` of a rotation matrix near the identity or not.
#[inline(always)]
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
#[inline(always)]
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
            // Beside others, of which some take longer.
            let mut lanes = [[0.0; LANES]; 6];
            for l in 0..LANES {
                let other = congruence(&rotation([0.3, l as f32, 0.5, -0.7]), [l as f64, 1.0, 3.0]);
                (0..6).for_each(|k| lanes[k][l] = if l == 2 { a[k] } else { other[k] });
            }
            let (values, v) = jacobi(&lanes);
            let (values, v) = (values.map(|x| x[2]), v.map(|row| row.map(|x| x[2])));
            let mut alone = [[0.0; LANES]; 6];
            (0..6).for_each(|k| alone[k][5] = a[k]);
            let (values_alone, v_alone) = jacobi(&alone);
            assert_eq!(values_alone.map(|x| x[5]), values);
            assert_eq!(v_alone.map(|row| row.map(|x| x[5])), v);
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
