//! Least squares for the encoder's choice of predictor weights.
//!
//! The weights are rounded to integers and sent, so nothing here has to agree between machines
//! for a stream to decode; only + - * / on f64 in a fixed order is used all the same.

use super::layout::MEANS;
use super::neighbours::NEIGHBOURS;
use super::predictor::{ColumnPredictor, MAX_SHIFT, NEIGHBOUR_BITS};

/// Rows the weights are fitted to, at most.
const SAMPLE: usize = 5000;
/// Reweighted least-squares rounds; the last weights rows by 1/|error|, for code length rather
/// than energy.
const ROUNDS: usize = 2;

/// Evenly spread Gaussians with their neighbours: all that is held of the scene's cells at a time.
pub(super) struct Sample {
    /// Columns.
    width: usize,
    /// Bit patterns, one row of all columns per Gaussian.
    bits: Vec<u32>,
    /// Cell indices: per Gaussian its row and those of its neighbours.
    q: Vec<i32>,
}

/// Gaussians per one that is in the sample.
pub(super) fn stride(total: usize) -> usize {
    (total / SAMPLE).max(1)
}

impl Sample {
    pub(super) fn new(width: usize) -> Self {
        Self { width, bits: Vec::new(), q: Vec::new() }
    }

    /// Adds a Gaussian: its bits, and the cells of its row and of its neighbours' rows.
    pub(super) fn push(&mut self, bits: &[u32], cells: impl IntoIterator<Item = i32>) {
        self.bits.extend_from_slice(bits);
        self.q.extend(cells);
    }

    /// Adds those of a later chunk.
    pub(super) fn append(&mut self, other: Self) {
        self.bits.extend(other.bits);
        self.q.extend(other.q);
    }

    fn len(&self) -> usize {
        self.bits.len() / self.width
    }

    /// The first cells of Gaussian `i` (`place` 0) or of its neighbour `place - 1`.
    fn row(&self, i: usize, place: usize, columns: usize) -> &[i32] {
        &self.q[(i * (1 + NEIGHBOURS) + place) * self.width..][..columns]
    }
}

/// Fits the predictor of column `c`, and the mean level of its remainders; `skip` tells values
/// coded otherwise.
pub(super) fn fit(
    gaussians: &Sample,
    c: usize,
    skip: impl Fn(u32) -> bool,
) -> (ColumnPredictor, u8) {
    let rows: Vec<usize> =
        (0..gaussians.len()).filter(|&i| !skip(gaussians.bits[i * gaussians.width + c])).collect();
    let mut predictor = ColumnPredictor { shift: 0, ..Default::default() };
    if rows.len() < 64 {
        return (predictor, 0);
    }
    fit_own(&mut predictor, gaussians, &rows, c);
    let centre = fit_neighbours(&mut predictor, gaussians, &rows, c);
    (predictor, centre)
}

/// Fits the weights of the Gaussian's own earlier columns.
fn fit_own(predictor: &mut ColumnPredictor, gaussians: &Sample, rows: &[usize], c: usize) {
    // The last column of the sample is the target, the one before it the constant.
    let inputs: Vec<usize> = (MEANS..c).collect();
    let n = inputs.len() + 1;
    let mut sample = Vec::with_capacity(rows.len() * (n + 1));
    for &i in rows {
        let q = gaussians.row(i, 0, c + 1);
        sample.extend(inputs.iter().map(|&j| f64::from(q[j])));
        sample.push(1.0);
        sample.push(f64::from(q[c]));
    }
    let scale = normalise(&mut sample, n + 1);
    let mut weights: Vec<f64> = sample
        .chunks_exact(n + 1)
        .map(|row| 1.0 / (0.25 + row.iter().map(|v| v.abs()).sum::<f64>() / (n + 1) as f64))
        .collect();
    let mut solution = vec![0.0; n];
    for round in 0..ROUNDS {
        solution = solve(&sample, &weights, n);
        if round + 1 < ROUNDS {
            let errors: Vec<f64> =
                sample.chunks_exact(n + 1).map(|row| error(row, &solution).abs()).collect();
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            for (w, e) in weights.iter_mut().zip(errors) {
                *w = 1.0 / (e + 0.1 * mean + 1e-12);
            }
        }
    }
    quantise(predictor, &inputs, &solution, &scale);
}

/// Divides each column by its mean magnitude, and returns those.
fn normalise(sample: &mut [f64], width: usize) -> Vec<f64> {
    let rows = sample.len() / width;
    let mut scale = vec![0.0f64; width];
    for row in sample.chunks_exact(width) {
        for (s, v) in scale.iter_mut().zip(row) {
            *s += v.abs();
        }
    }
    for s in &mut scale {
        *s = (*s / rows as f64).max(1e-9);
    }
    for row in sample.chunks_exact_mut(width) {
        for (s, v) in scale.iter().zip(row) {
            *v /= s;
        }
    }
    scale
}

/// Fits the weights of the neighbours to what the own columns leave; returns the mean level of what
/// both leave.
fn fit_neighbours(
    predictor: &mut ColumnPredictor,
    gaussians: &Sample,
    rows: &[usize],
    c: usize,
) -> u8 {
    let rest = |i: usize, place: usize| {
        let q = gaussians.row(i, place, c + 1);
        f64::from(q[c] - predictor.own(q))
    };
    let m = NEIGHBOURS;
    let mut sample = Vec::with_capacity(rows.len() * (m + 1));
    for &i in rows {
        sample.extend((1..=m).map(|place| rest(i, place)));
        sample.push(rest(i, 0));
    }
    let mut weights: Vec<f64> = sample
        .chunks_exact(m + 1)
        .map(|row| 1.0 / (1.0 + row.iter().map(|v| v.abs()).sum::<f64>()))
        .collect();
    let mut solution = vec![0.0; m];
    for _ in 0..ROUNDS {
        solution = solve(&sample, &weights, m);
        for (w, row) in weights.iter_mut().zip(sample.chunks_exact(m + 1)) {
            let typical = row.iter().map(|v| v.abs()).sum::<f64>() / (m + 1) as f64;
            *w = 1.0 / (error(row, &solution).abs() + 0.1 * typical + 1.0);
        }
    }
    let one = f64::from(1u32 << NEIGHBOUR_BITS);
    for (near, w) in predictor.near.iter_mut().zip(&solution) {
        *near = (w.clamp(-2.0, 2.0) * one).round() as i32;
    }
    let levels: u64 = sample
        .chunks_exact(m + 1)
        .map(|row| super::residual::level(error(row, &solution).abs().min(3e7) as u32) as u64)
        .sum();
    (levels / rows.len() as u64) as u8
}

fn error(row: &[f64], solution: &[f64]) -> f64 {
    let mut e = row[solution.len()];
    for (v, w) in row.iter().zip(solution) {
        e -= v * w;
    }
    e
}

/// Weighted least squares of the last of `n + 1` columns on the others, slightly ridged.
fn solve(sample: &[f64], weights: &[f64], n: usize) -> Vec<f64> {
    let width = n + 1;
    let mut gram = vec![0.0f64; width * width];
    for (row, &w) in sample.chunks_exact(width).zip(weights) {
        for i in 0..width {
            let v = w * row[i];
            for (g, r) in gram[i * width..i * width + i + 1].iter_mut().zip(row) {
                *g += v * r;
            }
        }
    }
    // Cholesky of the leading n x n block, row by row; the target is the last row.
    for i in 0..n {
        gram[i * width + i] = gram[i * width + i] * (1.0 + 1e-5) + 1e-12;
    }
    for i in 0..width {
        for j in 0..=i.min(n - 1) {
            let mut s = gram[i * width + j];
            for k in 0..j {
                s -= gram[i * width + k] * gram[j * width + k];
            }
            gram[i * width + j] =
                if i == j { s.max(1e-12).sqrt() } else { s / gram[j * width + j] };
        }
    }
    let mut x = vec![0.0; n];
    for i in (0..n).rev() {
        let mut s = gram[n * width + i];
        for k in i + 1..n {
            s -= gram[k * width + i] * x[k];
        }
        x[i] = s / gram[i * width + i];
    }
    x
}

/// Rounds weights in units of the columns to integers with a common number of fraction bits.
fn quantise(predictor: &mut ColumnPredictor, inputs: &[usize], solution: &[f64], scale: &[f64]) {
    let n = inputs.len();
    let target = scale[n + 1];
    // Weights that move the prediction by less than 2 % of its size are left out: time, not bits.
    let kept: Vec<(u8, f64)> = inputs
        .iter()
        .zip(solution)
        .zip(scale)
        .filter(|((_, w), _)| w.abs() > 2e-2)
        .map(|((&j, w), s)| (j as u8, w * target / s))
        .collect();
    let bias = solution[n] * target / scale[n];
    let largest = kept.iter().fold(1e-9f64, |m, (_, w)| m.max(w.abs()));
    let mut shift = 0u8;
    while shift < MAX_SHIFT && largest * ((1u64 << (shift + 1)) as f64) < f64::from(1 << 26) {
        shift += 1;
    }
    let one = (1u64 << shift) as f64;
    predictor.shift = shift;
    predictor.bias = (bias.clamp(-1.7e7, 1.7e7) * one).round() as i64;
    predictor.own = kept
        .into_iter()
        .map(|(j, w)| (j, (w * one).clamp(-2e9, 2e9).round() as i32))
        .filter(|&(_, w)| w != 0)
        .collect();
}
