//! Least-squares cubic.

use super::Curve;

/// A cubic in the normalised variable `(x - middle) / half`, where `x` spans -1 to 1: the normal
/// equations of raw powers of PSNR would lose half the digits.
pub(super) struct Cubic {
    coefficients: [f64; 4],
    middle: f64,
    half: f64,
}

impl Cubic {
    /// Fits `ys` over `xs`; `None` for fewer than four distinct abscissae.
    pub(super) fn fit(xs: &[f64], ys: &[f64]) -> Option<Self> {
        let mut distinct = xs.to_vec();
        distinct.sort_by(f64::total_cmp);
        distinct.dedup();
        let (&low, &high) = (distinct.first()?, distinct.last()?);
        if distinct.len() < 4 || !(high - low).is_normal() {
            return None;
        }
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let mut rows = [[0.0; 5]; 4];
        for (&x, &y) in xs.iter().zip(ys) {
            let t = (x - middle) / half;
            let powers = [1.0, t, t * t, t * t * t];
            for (i, row) in rows.iter_mut().enumerate() {
                for (j, power) in powers.iter().enumerate() {
                    row[j] += powers[i] * power;
                }
                row[4] += powers[i] * y;
            }
        }
        Some(Self { coefficients: solve(rows)?, middle, half })
    }

    fn antiderivative(&self, x: f64) -> f64 {
        let t = (x - self.middle) / self.half;
        let [a, b, c, d] = self.coefficients;
        self.half * t * (a + t * (b / 2.0 + t * (c / 3.0 + t * d / 4.0)))
    }
}

impl Curve for Cubic {
    fn integral(&self, a: f64, b: f64) -> f64 {
        self.antiderivative(b) - self.antiderivative(a)
    }
}

/// Gaussian elimination with partial pivoting.
fn solve(mut rows: [[f64; 5]; 4]) -> Option<[f64; 4]> {
    for i in 0..4 {
        let pivot = (i..4).max_by(|&a, &b| rows[a][i].abs().total_cmp(&rows[b][i].abs()))?;
        rows.swap(i, pivot);
        if rows[i][i].abs() < 1e-12 {
            return None;
        }
        let upper = rows[i];
        for row in rows.iter_mut().skip(i + 1) {
            let factor = row[i] / upper[i];
            for (x, u) in row.iter_mut().zip(&upper) {
                *x -= factor * u;
            }
        }
    }
    let mut out = [0.0; 4];
    for i in (0..4).rev() {
        let known: f64 = (i + 1..4).map(|k| rows[i][k] * out[k]).sum();
        out[i] = (rows[i][4] - known) / rows[i][i];
    }
    Some(out)
}
