//! Parameters of many Gaussians, row after row, and Adam on them.

use finetune::optimiser::Adam;
use rayon::prelude::*;

/// Rows of a task.
const CHUNK: usize = 256;

/// Adam's two moments of rows of parameters.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Moments {
    pub(crate) first: Vec<f32>,
    pub(crate) second: Vec<f32>,
}

impl Moments {
    pub(crate) fn zeros(len: usize) -> Self {
        Self { first: vec![0.0; len], second: vec![0.0; len] }
    }

    /// Moves rows of `rates.len()` parameters. `gradient` fills in the gradient of one row; it begins
    /// with zeros. `after` may put a row back into its range.
    pub(crate) fn step(
        &mut self,
        adam: Adam,
        rates: &[f32],
        parameters: &mut [f32],
        gradient: impl Fn(usize, &mut [f32]) + Sync,
        after: impl Fn(&mut [f32]) + Sync,
    ) {
        let stride = rates.len();
        let first = self.first.par_chunks_mut(CHUNK * stride);
        let second = self.second.par_chunks_mut(CHUNK * stride);
        let chunks = parameters.par_chunks_mut(CHUNK * stride).zip(first).zip(second);
        chunks.enumerate().for_each(|(c, ((p, m), v))| {
            let mut g = vec![0.0; stride];
            let rows = p.chunks_exact_mut(stride);
            let rows = rows.zip(m.chunks_exact_mut(stride)).zip(v.chunks_exact_mut(stride));
            for (j, ((p, m), v)) in rows.enumerate() {
                g.fill(0.0);
                gradient(c * CHUNK + j, &mut g);
                adam.update(p, [m, v], &g, rates);
                after(p);
            }
        });
    }
}
