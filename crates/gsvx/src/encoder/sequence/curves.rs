//! The curves of a chunk: the fewest functions of time that tell how its values change, most first.
//!
//! They are the eigenvectors of the frames' products, weighted as the values are coded (Karhunen-Loeve). What is known
//! of the static stream predicts their coefficients by a linear map: a scene that turns as a whole costs next to
//! nothing, and one whose Gaussians move by polynomials as much as their coefficients.

use crate::sequence::motion::{Curve, GREATEST, UNIT};
use gpcc_lite::raht::Rows;
use gs_model::math::solve;

/// Sweeps of the Jacobi iteration at most.
const SWEEPS: usize = 30;

impl Curve {
    /// The coefficients of values, frame by frame.
    pub(super) fn project(&self, delta: &[f32], out: &mut [f32]) {
        out.fill(0.0);
        let mut square = 0.0;
        for (frame, values) in delta.chunks_exact(out.len()).enumerate() {
            let at = self.at(frame);
            square += at * at;
            out.iter_mut().zip(values).for_each(|(c, v)| *c += at * v);
        }
        out.iter_mut().for_each(|c| *c /= square);
    }
}

/// The curves of leaves whose values are given leaf by leaf, frame by frame. Each has a mean square of 1; those whose
/// coefficients have a weighted energy below `least` are left out.
pub(super) fn curves_of(
    deltas: &[f32],
    weights: &[f64],
    frames: usize,
    channels: usize,
    least: f64,
) -> Vec<Curve> {
    let mut products = vec![0.0; frames * frames];
    for (leaf, weight) in deltas.chunks_exact(frames * channels).zip(weights) {
        for (a, row) in leaf.chunks_exact(channels).zip(products.chunks_exact_mut(frames)) {
            for (b, sum) in leaf.chunks_exact(channels).zip(row) {
                let product = a.iter().zip(b).fold(0.0, |sum, (x, y)| sum + x * y);
                *sum += weight * f64::from(product);
            }
        }
    }
    let vectors = eigen(&mut products, frames);
    let mut order: Vec<(f64, usize)> = (0..frames).map(|k| (products[k * frames + k], k)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let large = order.iter().take_while(|(energy, _)| energy / frames as f64 >= least);
    let unit = f64::from(UNIT) * (frames as f64).sqrt();
    let curve = |k: usize| {
        let values = vectors.iter().skip(k).step_by(frames).map(|v| (v * unit).round() as i16);
        Curve { values: values.collect(), factors: Vec::new() }
    };
    large.map(|&(_, k)| curve(k)).collect()
}

/// Jacobi rotations: `a` becomes diagonal; the columns of what is returned are its eigenvectors.
fn eigen(a: &mut [f64], n: usize) -> Vec<f64> {
    let mut vectors = vec![0.0; n * n];
    (0..n).for_each(|i| vectors[i * n + i] = 1.0);
    let trace: f64 = (0..n).map(|i| a[i * n + i]).sum();
    for _ in 0..SWEEPS {
        let mut off = 0.0;
        for p in 0..n {
            for q in p + 1..n {
                let apq = a[p * n + q];
                off += apq.abs();
                if apq.abs() <= 1e-15 * trace {
                    continue;
                }
                let theta = (a[q * n + q] - a[p * n + p]) / (2.0 * apq);
                let t = 1.0f64.copysign(theta) / (theta.abs() + (theta * theta + 1.0).sqrt());
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for k in 0..n {
                    let (x, y) = (a[k * n + p], a[k * n + q]);
                    (a[k * n + p], a[k * n + q]) = (c * x - s * y, s * x + c * y);
                }
                for k in 0..n {
                    let (x, y) = (a[p * n + k], a[q * n + k]);
                    (a[p * n + k], a[q * n + k]) = (c * x - s * y, s * x + c * y);
                    let (x, y) = (vectors[k * n + p], vectors[k * n + q]);
                    (vectors[k * n + p], vectors[k * n + q]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
        if off <= 1e-12 * trace {
            break;
        }
    }
    vectors
}

/// The linear map from values of the static stream to coefficients, where it saves more bits than it takes.
pub(super) fn fit(base: &Rows, rows: &Rows, weights: &[f64], unit: f64) -> Vec<f32> {
    match rows.channels() {
        1 => fitted::<1>(base, rows, weights, unit),
        3 => fitted::<3>(base, rows, weights, unit),
        6 => fitted::<6>(base, rows, weights, unit),
        _ => Vec::new(),
    }
}

fn fitted<const N: usize>(base: &Rows, rows: &Rows, weights: &[f64], unit: f64) -> Vec<f32> {
    let total: f64 = weights.iter().sum();
    let mean = |of: &Rows| -> [f64; N] {
        std::array::from_fn(|k| {
            let each = weights.iter().enumerate().map(|(i, w)| w * f64::from(of.row(i)[k]));
            each.sum::<f64>() / total
        })
    };
    let (middle, centre) = (mean(base), mean(rows));
    let (mut a, mut b, mut before) = ([[0.0; N]; N], [[0.0; N]; N], 0.0);
    for (i, w) in weights.iter().enumerate() {
        let x: [f64; N] = std::array::from_fn(|k| f64::from(base.row(i)[k]) - middle[k]);
        let y: [f64; N] = std::array::from_fn(|k| f64::from(rows.row(i)[k]) - centre[k]);
        for p in 0..N {
            before += w * y[p] * y[p];
            for q in 0..N {
                a[p][q] += w * x[p] * x[q];
                b[p][q] += w * y[p] * x[q];
            }
        }
    }
    let ridge = 1e-9 * (0..N).map(|k| a[k][k]).sum::<f64>();
    (0..N).for_each(|k| a[k][k] += ridge);
    let factors = b.map(|row| solve(&a, row));
    let explained: f64 =
        factors.iter().zip(&b).flat_map(|(f, b)| f.iter().zip(b)).map(|(f, b)| f * b).sum();
    // Bits of a coefficient, about, of which there is one per leaf and channel.
    let bits = |energy: f64| {
        let per = energy.max(0.0) / (weights.len() * N) as f64 / (unit * unit);
        0.5 * (weights.len() * N) as f64 * libm::log2(1.0 + 6.0 * per)
    };
    let pays = bits(before) - bits(before - explained) > (64 * N * N) as f64;
    let factors: Vec<f32> = factors.as_flattened().iter().map(|&f| f as f32).collect();
    if pays && factors.iter().all(|f| f.abs() <= GREATEST) { factors } else { Vec::new() }
}
