//! Adam, for the attributes of a scene ([`SceneOptimiser`]) and for rows of any other parameters ([`AdamMoments`]),
//! and the order of views.

mod rows;
mod scene;
mod unseen;

pub use crate::shuffle::{SplitMix, permutation};
pub use rows::{Flat, RowChunk};
#[cfg(feature = "gpu")]
pub(crate) use rows::{rows_of, set_rows};
pub use scene::{SceneOptimiser, Shrinkage};

use crate::stages::finite;
use multiversion::multiversion;
use rayon::prelude::*;

pub(crate) const BETA1: f32 = 0.9;
pub(crate) const BETA2: f32 = 0.999;
pub(crate) const EPSILON: f32 = 1.0e-15;

/// Rows that lie together in memory.
const CHUNK: usize = 256;
/// Most chunks of a task. Those that a view shows may follow each other; larger tasks would leave them to one thread.
const TASK: usize = 8;
/// Rows that Adam moves at once: a row alone is too short for wide registers.
const BLOCK: usize = 16;

/// The part of a step that all parameters share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adam {
    /// The inverse of the first bias correction; a rate is multiplied by it.
    inverse_bias1: f32,
    inv_sqrt_bias2: f32,
}

impl Adam {
    /// `step` counts from 1.
    #[must_use]
    pub fn new(step: u64) -> Self {
        let t = step.clamp(1, 1 << 30) as f64;
        let bias = |beta: f32| 1.0 - libm::pow(f64::from(beta), t);
        Self {
            inverse_bias1: (1.0 / bias(BETA1)) as f32,
            inv_sqrt_bias2: (1.0 / bias(BETA2).sqrt()) as f32,
        }
    }

    /// The factors of a rate and of the root of the second moment.
    #[cfg(feature = "gpu")]
    pub(crate) fn corrections(&self) -> (f32, f32) {
        (self.inverse_bias1, self.inv_sqrt_bias2)
    }
}

/// Moves parameters against their gradient. `moments` are the first and the second, zero before the
/// first step. A gradient that is not finite counts as zero, so that one bad pixel does not end a run of thousands of
/// steps.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn update(
    adam: Adam,
    parameters: &mut [f32],
    moments: [&mut [f32]; 2],
    gradient: &[f32],
    rates: &[f32],
) {
    let [m, v] = moments;
    for ((((p, m), v), &g), &rate) in parameters.iter_mut().zip(m).zip(v).zip(gradient).zip(rates) {
        let g = if finite(g) { g } else { 0.0 };
        let m0 = *m * BETA1;
        let m1 = g * (1.0 - BETA1);
        *m = m0 + m1;
        let gg = g * g;
        let v0 = *v * BETA2;
        let v1 = gg * (1.0 - BETA2);
        *v = v0 + v1;
        let root = v.sqrt() * adam.inv_sqrt_bias2;
        let ratio = *m / (root + EPSILON);
        let move_by = ratio * (rate * adam.inverse_bias1);
        *p -= move_by;
    }
}

/// Adam's two moments of rows of parameters.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AdamMoments {
    /// Of the gradient.
    pub first: Vec<f32>,
    /// Of its square.
    pub second: Vec<f32>,
}

impl AdamMoments {
    /// Those before the first step.
    #[must_use]
    pub fn zeros(len: usize) -> Self {
        Self { first: vec![0.0; len], second: vec![0.0; len] }
    }

    /// Moves the rows of `rates.len()` parameters that are `due`. `gradient` gets the number of a row and its
    /// parameters, and fills in its gradient, which begins with zeros. `after` may put a row back into its range.
    pub fn step<C: RowChunk>(
        &mut self,
        adam: Adam,
        rates: &[f32],
        chunks: impl IndexedParallelIterator<Item = C>,
        due: impl Fn(usize) -> bool + Sync,
        gradient: impl Fn(usize, &[f32], &mut [f32]) + Sync,
        after: impl Fn(&mut [f32]) + Sync,
    ) {
        let stride = rates.len();
        let first = self.first.par_chunks_mut(CHUNK * stride);
        let second = self.second.par_chunks_mut(CHUNK * stride);
        let rates = rates.repeat(BLOCK);
        let all = chunks.zip(first).zip(second).enumerate().with_max_len(TASK);
        all.for_each(|(c, ((mut chunk, m), v))| {
            let mut rows = [vec![0.0; BLOCK * stride], vec![0.0; BLOCK * stride]];
            let len = m.len() / stride;
            let due = |i: usize| i < len && due(c * CHUNK + i);
            let mut next = 0;
            while next < len {
                let start = next;
                while next < start + BLOCK && due(next) {
                    next += 1;
                }
                let block = start * stride..next * stride;
                let [p, g] = rows.each_mut().map(|rows| &mut rows[..block.len()]);
                g.fill(0.0);
                let pairs = p.chunks_exact_mut(stride).zip(g.chunks_exact_mut(stride));
                for (i, (p, g)) in (start..).zip(pairs) {
                    chunk.load(i, p);
                    gradient(c * CHUNK + i, p, g);
                }
                update(adam, p, [&mut m[block.clone()], &mut v[block]], g, &rates);
                for (i, p) in (start..).zip(p.chunks_exact_mut(stride)) {
                    after(p);
                    chunk.store(i, p);
                }
                while next < len && !due(next) {
                    next += 1;
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_descended() {
        let (mut p, mut m, mut v) = ([3.0f32, -2.0], [0.0; 2], [0.0; 2]);
        for step in 1..=2000 {
            let gradient = p.map(|p| 2.0 * p);
            let rate = 0.05 * (1.0 - step as f32 / 2000.0);
            update(Adam::new(step), &mut p, [&mut m, &mut v], &gradient, &[rate; 2]);
        }
        assert!(p.iter().all(|p| p.abs() < 1e-2), "{p:?}");
        update(Adam::new(1), &mut p, [&mut m, &mut v], &[f32::NAN, 0.0], &[1e-3; 2]);
        assert!(p.iter().all(|p| p.is_finite()));
    }
}
