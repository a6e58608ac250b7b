//! [`local_means`]: the mean of a value over the Gaussians around each Gaussian.
//!
//! It goes beyond the paper. Neighbours are found by number, not by distance, so nothing depends on the scale of a
//! part of the scene: a sky has neighbours in the sky, and what it surrounds has others.
//!
//! *Invariant:* sums run in Morton order, so no result depends on the number of threads.

use gpcc_lite::morton::MAX_DEPTH;
use gs_model::Scene;
use rayon::prelude::*;

use crate::cube::cube_of;
use crate::error::{Error, Result};
use crate::order::MortonOrder;
use gpcc_lite::Cube;

/// Members of a window whose distances say how compact it is.
const SAMPLES: usize = 4;

/// For each Gaussian, the mean of `values` over `width` Gaussians around it. `values` has one finite entry
/// per Gaussian.
///
/// Runs in Morton order stand for neighbourhoods. Where such a run leaves a cell it may jump to another part of
/// the scene, so the nearest of six counts: before, around and after the Gaussian, in the octrees of two
/// cubes that have no common faces.
///
/// # Errors
/// [`Error::NonFiniteMean`]; [`Error::Length`] if `values` does not fit the scene.
pub fn local_means(scene: &Scene, values: &[f64], width: usize) -> Result<Vec<f64>> {
    let len = scene.len();
    if values.len() != len {
        return Err(Error::Length { name: "values", got: values.len(), want: len });
    }
    let cube = cube_of(&scene.means)?;
    let shift = [0.5, 0.45, 0.4];
    let origin = std::array::from_fn(|k| cube.origin[k] - shift[k] * cube.side);
    let shifted = Cube { origin, side: 1.5 * cube.side };
    let mut nearest = vec![(f64::INFINITY, 0.0); len];
    for cube in [cube, shifted] {
        let order = MortonOrder::of(scene, &cube, MAX_DEPTH)?;
        let runs = Runs::new(scene, values, &order.members, width);
        let found: Vec<(f64, f64)> = (0..len).into_par_iter().map(|i| runs.nearest(i)).collect();
        for (&member, run) in order.members.iter().zip(found) {
            let best = &mut nearest[member as usize];
            if run.0 < best.0 {
                *best = run;
            }
        }
    }
    Ok(nearest.into_iter().map(|(_, mean)| mean).collect())
}

/// Runs of Gaussians in an order.
struct Runs {
    means: Vec<[f32; 3]>,
    /// Sums of the values before each place.
    sums: Vec<f64>,
    width: usize,
}

impl Runs {
    fn new(scene: &Scene, values: &[f64], members: &[u32], width: usize) -> Self {
        let means = members.iter().map(|&m| scene.means[m as usize]).collect();
        let mut sums = Vec::with_capacity(members.len() + 1);
        let mut sum = 0.0;
        sums.push(sum);
        for &member in members {
            sum += values[member as usize];
            sums.push(sum);
        }
        Self { means, sums, width: width.clamp(1, members.len().max(1)) }
    }

    /// The mean squared distance and the mean value of the nearest run with the Gaussian at `i`.
    fn nearest(&self, i: usize) -> (f64, f64) {
        let last = self.means.len() - self.width;
        let first = |before: usize| i.saturating_sub(before).min(last);
        let firsts = [first(0), first(self.width / 2), first(self.width - 1)];
        let runs = firsts.map(|first| {
            let sum = self.sums[first + self.width] - self.sums[first];
            (self.spread(i, first), sum / self.width as f64)
        });
        runs.into_iter().fold(runs[0], |a, b| if b.0 < a.0 { b } else { a })
    }

    /// Mean squared distance of some of the run from `first` on to the Gaussian at `i`.
    fn spread(&self, i: usize, first: usize) -> f64 {
        let square = |s: usize| {
            let other = self.means[first + (2 * s + 1) * self.width / (2 * SAMPLES)];
            (0..3)
                .map(|k| f64::from(other[k]) - f64::from(self.means[i][k]))
                .map(|d| d * d)
                .sum::<f64>()
        };
        (0..SAMPLES).map(square).sum::<f64>() / SAMPLES as f64
    }
}
