//! Piecewise cubic Hermite interpolation with Fritsch and Butland's slopes (1984), as in SciPy
//! and Matlab: monotone where the data are.

use super::Curve;

pub(super) struct Pchip {
    xs: Vec<f64>,
    ys: Vec<f64>,
    slopes: Vec<f64>,
}

impl Pchip {
    /// Through points of strictly rising `xs`; `None` otherwise or for fewer than two.
    pub(super) fn through(xs: &[f64], ys: &[f64]) -> Option<Self> {
        if xs.len() < 2 || xs.windows(2).any(|w| w[0].is_nan() || w[1].is_nan() || w[1] <= w[0]) {
            return None;
        }
        Some(Self { xs: xs.to_vec(), ys: ys.to_vec(), slopes: slopes(xs, ys) })
    }

    /// Integral from the left end of piece `i` to `x` inside it.
    fn part(&self, i: usize, x: f64) -> f64 {
        let h = self.xs[i + 1] - self.xs[i];
        let t = (x - self.xs[i]) / h;
        let (t2, t3, t4) = (t * t, t * t * t, t * t * t * t);
        // Antiderivatives of the four Hermite basis functions.
        let h00 = t4 / 2.0 - t3 + t;
        let h10 = t4 / 4.0 - 2.0 * t3 / 3.0 + t2 / 2.0;
        let h01 = -t4 / 2.0 + t3;
        let h11 = t4 / 4.0 - t3 / 3.0;
        h * (self.ys[i] * h00
            + self.ys[i + 1] * h01
            + h * (self.slopes[i] * h10 + self.slopes[i + 1] * h11))
    }
}

impl Curve for Pchip {
    fn integral(&self, a: f64, b: f64) -> f64 {
        (0..self.xs.len() - 1)
            .map(|i| {
                let (low, high) = (a.max(self.xs[i]), b.min(self.xs[i + 1]));
                if low < high { self.part(i, high) - self.part(i, low) } else { 0.0 }
            })
            .sum()
    }
}

fn slopes(xs: &[f64], ys: &[f64]) -> Vec<f64> {
    let h: Vec<f64> = xs.windows(2).map(|w| w[1] - w[0]).collect();
    let d: Vec<f64> = ys.windows(2).zip(&h).map(|(w, h)| (w[1] - w[0]) / h).collect();
    let n = xs.len();
    if n == 2 {
        return vec![d[0]; 2];
    }
    let mut out = vec![0.0; n];
    for i in 1..n - 1 {
        if d[i - 1] * d[i] > 0.0 {
            let (w1, w2) = (2.0 * h[i] + h[i - 1], h[i] + 2.0 * h[i - 1]);
            out[i] = (w1 + w2) / (w1 / d[i - 1] + w2 / d[i]);
        }
    }
    out[0] = end_slope(h[0], h[1], d[0], d[1]);
    out[n - 1] = end_slope(h[n - 2], h[n - 3], d[n - 2], d[n - 3]);
    out
}

/// Three-point slope at an end, limited so that the piece stays monotone.
fn end_slope(h0: f64, h1: f64, d0: f64, d1: f64) -> f64 {
    let m = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1);
    if m * d0 <= 0.0 {
        0.0
    } else if d0 * d1 <= 0.0 && m.abs() > 3.0 * d0.abs() {
        3.0 * d0
    } else {
        m
    }
}
