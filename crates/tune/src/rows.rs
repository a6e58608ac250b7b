//! Parameters of many Gaussians, row after row, and Adam on them.

use finetune::optimiser::Adam;
use rayon::prelude::*;

/// Rows of a task.
const CHUNK: usize = 256;
/// Rows that Adam moves at once: a row alone is too short for wide registers.
const BLOCK: usize = 16;

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
        let rates = rates.repeat(BLOCK);
        chunks.enumerate().for_each(|(c, ((p, m), v))| {
            let mut g = vec![0.0; BLOCK * stride];
            let blocks = p.chunks_mut(BLOCK * stride);
            let blocks = blocks.zip(m.chunks_mut(BLOCK * stride)).zip(v.chunks_mut(BLOCK * stride));
            for (b, ((p, m), v)) in blocks.enumerate() {
                let g = &mut g[..p.len()];
                g.fill(0.0);
                let first = c * CHUNK + b * BLOCK;
                let rows = g.chunks_exact_mut(stride).enumerate();
                rows.for_each(|(j, row)| gradient(first + j, row));
                adam.update(p, [m, v], g, &rates);
                p.chunks_exact_mut(stride).for_each(&after);
            }
        });
    }
}
