//! Eigenvalues and eigenvectors of symmetric 3x3 matrices, by cyclic Jacobi rotations.

use super::{Matrix, Symmetric};

/// Sweeps of the cyclic Jacobi method. Convergence is quadratic: 3x3 matrices take 4 to 6.
const MAX_SWEEPS: usize = 16;

/// Off-diagonal entries whose square is at most this, relative to the product of the two diagonal
/// entries, vanish with one more rotation: an entry that is left afterwards is of the order of
/// their square.
const LAST: f64 = 1e-16;

/// Off-diagonal entries whose square is at most this, relative to the same product, count as zero.
/// The bound is relative to the geometric mean of the diagonal entries, so the small axes of flat
/// Gaussians keep their full relative accuracy.
const NEGLIGIBLE: f64 = 1e-30;

/// `N` symmetric matrices on their way to diagonal ones, and the axes so far. Each number is an
/// array with one entry per matrix.
struct Jacobi<const N: usize> {
    diagonal: [[f64; N]; 3],
    /// Entry `k` is that of the two indices other than `k`.
    off_diagonal: [[f64; N]; 3],
    axes: Matrix<[f64; N]>,
    /// What counts as zero: [`NEGLIGIBLE`], or infinity for a matrix that is finished.
    limit: [f64; N],
    /// Whether another sweep is needed, as 1 or 0.
    again: [f64; N],
}

impl<const N: usize> Jacobi<N> {
    /// Makes entry `P`, `Q` zero; `R` is the third index.
    #[inline(always)]
    fn rotate<const P: usize, const Q: usize, const R: usize>(&mut self) {
        let (mut cos, mut sin) = ([0.0; N], [0.0; N]);
        for l in 0..N {
            let (p, q, off) = (self.diagonal[P][l], self.diagonal[Q][l], self.off_diagonal[R][l]);
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
            self.off_diagonal[R][l] = if rotates { 0.0 } else { off };
        }
        let turn = |x: &mut f64, y: &mut f64, c: f64, s: f64| {
            (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
        };
        // The entries of row R: the one in column P has the index Q, and the reverse.
        for l in 0..N {
            let (mut x, mut y) = (self.off_diagonal[Q][l], self.off_diagonal[P][l]);
            turn(&mut x, &mut y, cos[l], sin[l]);
            (self.off_diagonal[Q][l], self.off_diagonal[P][l]) = (x, y);
        }
        for row in &mut self.axes {
            for l in 0..N {
                let (mut x, mut y) = (row[P][l], row[Q][l]);
                turn(&mut x, &mut y, cos[l], sin[l]);
                (row[P][l], row[Q][l]) = (x, y);
            }
        }
    }
}

/// Diagonalises `N` matrices together: each is `v diag(d) v^T` with `v` a rotation, and `(d, v)`
/// is returned. Every number is an array with one entry per matrix, so that loops over them
/// become vector instructions, and the latencies of roots and quotients overlap. No matrix's
/// result depends on the others.
///
/// Each step takes the smaller of the two possible angles, so a nearly diagonal matrix gives a
/// `v` near the identity: axes keep their order and signs. A library routine would sort the
/// eigenvalues.
///
/// Entries must be below 1e150 in magnitude.
#[inline(always)]
#[must_use]
pub fn eigen<const N: usize>(a: &Symmetric<[f64; N]>) -> ([[f64; N]; 3], Matrix<[f64; N]>) {
    let (zero, one) = ([0.0; N], [1.0; N]);
    let mut state = Jacobi {
        diagonal: [a[0], a[1], a[2]],
        off_diagonal: [a[5], a[4], a[3]],
        axes: [[one, zero, zero], [zero, one, zero], [zero, zero, one]],
        limit: [NEGLIGIBLE; N],
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

/// [`eigen`] of one matrix, with the same bits.
#[inline(always)]
#[must_use]
pub fn eigen_of(a: &Symmetric) -> ([f64; 3], Matrix) {
    let (values, axes) = eigen(&a.map(|x| [x]));
    (values.map(|[x]| x), axes.map(|row| row.map(|[x]| x)))
}

#[cfg(test)]
mod tests {
    use super::super::{axes_product, rotation};
    use super::*;

    fn check(a: Symmetric) {
        let (values, v) = eigen_of(&a);
        let scale = a.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        for (x, y) in a.iter().zip(axes_product(&v, values)) {
            assert!((x - y).abs() <= 1e-14 * scale, "{a:?} {values:?} {v:?}");
        }
        for i in 0..3 {
            for j in 0..3 {
                let dot: f64 = (0..3).map(|k| v[k][i] * v[k][j]).sum();
                assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-14, "{v:?}");
            }
        }
        let [x, y, z] = [0, 1, 2].map(|k| v.map(|row| row[k]));
        let cross =
            [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
        let determinant: f64 = cross.iter().zip(z).map(|(c, z)| c * z).sum();
        assert!((determinant - 1.0).abs() < 1e-13, "{v:?}");
    }

    /// Definite, indefinite, singular, repeated and extreme.
    #[test]
    fn axes_and_values_give_the_matrix_back() {
        for q in [[0.9f32, 0.1, -0.2, 0.05], [0.3, -0.5, 0.5, 0.7], [0.0, 1.0, 2.0, 3.0]] {
            for d in [
                [1.0, 2.0, 3.0],
                [5.0, 5.0, 5.0],
                [1.0, 1.0, 1e-12],
                [-3.0, 2.0, 0.0],
                [-1.0, -1.0, 4.0],
                [0.0, 0.0, 1.0],
                [1e120, 1.0, 1e-120],
                [1e-140, 3e-140, 2e-140],
            ] {
                check(axes_product(&rotation(q), d));
            }
        }
        check([0.0; 6]);
        check([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        check([1.0; 6]);
        check([1.0, 1.0, 1.0, 1e-300, 0.0, 1e-310]);
    }

    #[test]
    fn a_matrix_has_the_same_bits_beside_others() {
        for d in [[1.0, 2.0, 3.0], [1e-12, 1.0, 4.0], [5.0, 5.0, 5.0], [1e100, 1.0, 1e-100]] {
            let a = axes_product(&rotation([0.9, 0.1, -0.2, 0.05]), d);
            let mut together = [[0.0; 8]; 6];
            for l in 0..8 {
                // Some of the other lanes take more sweeps.
                let q = [0.3, l as f32, 0.5, -0.7];
                let other = axes_product(&rotation(q), [l as f64, 1.0, 3.0]);
                (0..6).for_each(|k| together[k][l] = if l == 2 { a[k] } else { other[k] });
            }
            let (values, v) = eigen(&together);
            assert_eq!(eigen_of(&a), (values.map(|x| x[2]), v.map(|row| row.map(|x| x[2]))));
        }
    }

    #[test]
    fn axes_keep_their_order() {
        let r = rotation([0.9, 0.1, -0.2, 0.05]);
        for d in [[1.0, 2.0, 3.0], [1e-12, 1.0, 4.0], [5.0, 5.0, 5.0], [1e100, 1.0, 1e-100]] {
            let (_, v) = eigen_of(&axes_product(&r, d));
            assert!((0..3).all(|k| v[k][k] > 0.7), "{v:?}");
        }
    }
}
