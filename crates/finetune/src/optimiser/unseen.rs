//! Adam on the rows that a view shows: a step costs what is seen, not the size of the model.
//!
//! Without a gradient, Adam still moves a row by its momentum, less and less, and its moments fade. Both follow from
//! the number of steps alone. So a row is left alone while no view shows it, and catches up before a view does.
//!
//! Two simpler ways end worse, trained in 2500 steps and compared with held-out photos. If a row waits with its
//! momentum until it is shown again, bonsai loses 0.25 dB. If it takes all that its momentum is worth at once, office
//! loses 0.2 dB.

use rayon::prelude::*;

use super::{AdamMoments, BETA1, BETA2, CHUNK, EPSILON, RowChunk, TASK};

/// Makes the steps that rows have missed up to step `made`, for the rows that are `due`. `last` has for each row the
/// step that it is up to date with, 0 at first; for the rows that are due it becomes `mark`. `rates` are
/// those of now: a few steps before they were nearly the same.
pub(super) fn catch_up<C: RowChunk>(
    [made, mark]: [u32; 2],
    rates: &[f32],
    chunks: impl IndexedParallelIterator<Item = C>,
    moments: &mut AdamMoments,
    last: &mut [u32],
    due: impl Fn(usize) -> bool + Sync,
) {
    let n = rates.len();
    let missed = UnseenSteps::since_each(made);
    let first = moments.first.par_chunks_mut(CHUNK * n);
    let second = moments.second.par_chunks_mut(CHUNK * n);
    let all = chunks.zip(first).zip(second).zip(last.par_chunks_mut(CHUNK));
    all.enumerate().with_max_len(TASK).for_each(|(c, (((mut chunk, first), second), last))| {
        let mut row = vec![0.0; n];
        for (i, last) in last.iter_mut().enumerate() {
            if *last == mark || !due(c * CHUNK + i) {
                continue;
            }
            if *last > 0
                && let Some(missed) = missed.get(*last as usize)
            {
                let at = i * n..(i + 1) * n;
                chunk.load(i, &mut row);
                missed.make(rates, &mut row, &mut first[at.clone()], &mut second[at]);
                chunk.store(i, &row);
            }
            *last = mark;
        }
    });
}

/// The steps without a gradient after a step. Each moves a parameter `BETA1 / sqrt(BETA2)` times as far as the one
/// before, but for Adam's corrections.
#[derive(Clone, Copy, Default)]
struct UnseenSteps {
    /// All movements, over the rate and the first moment over the root of the second.
    movement: f32,
    /// The factors of the moments.
    fade: [f32; 2],
}

impl UnseenSteps {
    /// The steps up to `made` after each earlier step.
    fn since_each(made: u32) -> Vec<Self> {
        let betas = [BETA1, BETA2].map(f64::from);
        let ratio = betas[0] / betas[1].sqrt();
        let times = |powers: [f64; 2]| [powers[0] * betas[0], powers[1] * betas[1]];
        let mut powers = [1.0; 2];
        // Of the steps 1, 2, ..
        let corrections = |_| {
            powers = times(powers);
            (1.0 - powers[1]).sqrt() / (1.0 - powers[0])
        };
        let corrections: Vec<f64> = (0..made).map(corrections).collect();
        let (mut movement, mut fade) = (0.0, [1.0; 2]);
        let mut all = vec![Self::default(); made as usize];
        for (missed, correction) in all.iter_mut().zip(corrections).rev() {
            (movement, fade) = (ratio * (correction + movement), times(fade));
            *missed = Self { movement: movement as f32, fade: fade.map(|f| f as f32) };
        }
        all
    }

    fn make(&self, rates: &[f32], row: &mut [f32], first: &mut [f32], second: &mut [f32]) {
        for (((p, m), v), rate) in row.iter_mut().zip(first).zip(second).zip(rates) {
            *p -= *m / (v.sqrt() + EPSILON) * (rate * self.movement);
            *m *= self.fade[0];
            *v *= self.fade[1];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimiser::{Adam, Flat};

    /// Steps with the gradients of some rows, all rows at each step or only those that have one.
    fn run(steps: u32, sparse: bool) -> (Vec<f32>, AdamMoments) {
        const ROWS: usize = 600;
        let mut random = testing::Rng::seeded(5);
        let mut values: Vec<f32> = (0..3 * ROWS).map(|_| random.range_f32(-1.0, 1.0)).collect();
        let mut moments = AdamMoments::zeros(values.len());
        let mut last = vec![0; ROWS];
        let rates = [1e-3, 2e-3, 0.0];
        // A row has gradients at a few of the first steps.
        let shown = |step: u32, i: usize| step < 100 && (7 * step + i as u32).is_multiple_of(11);
        for step in 1..=steps {
            let adam = Adam::new(step.into());
            let due = |i: usize| !sparse || shown(step, i);
            let gradient = |i: usize, _: &[f32], row: &mut [f32]| {
                if shown(step, i) {
                    row.fill(0.1 + (i % 5) as f32);
                }
            };
            if sparse {
                let rows = Flat::chunks(&mut values, 3);
                catch_up([step - 1, step], &rates, rows, &mut moments, &mut last, due);
            }
            moments.step(adam, &rates, Flat::chunks(&mut values, 3), due, gradient, |_| ());
        }
        let rows = Flat::chunks(&mut values, 3);
        catch_up([steps; 2], &rates, rows, &mut moments, &mut last, |_| sparse);
        (values, moments)
    }

    #[test]
    fn rows_that_catch_up_are_where_all_steps_would_have_put_them() {
        for steps in [99, 130] {
            let (dense, sparse) = (run(steps, false), run(steps, true));
            let start = run(0, true).0;
            let moved = |values: &[f32]| -> Vec<f32> {
                values.iter().zip(&start).map(|(a, b)| a - b).collect()
            };
            for (a, b) in moved(&dense.0).iter().zip(moved(&sparse.0)) {
                assert!((a - b).abs() <= 1e-3 * a.abs() + 1e-6, "{steps}: {a} {b}");
            }
            for (a, b) in dense.1.second.iter().zip(&sparse.1.second) {
                assert!((a - b).abs() <= 1e-4 * a.abs(), "{steps}: {a} {b}");
            }
        }
    }
}
