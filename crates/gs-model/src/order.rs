//! [`morton_order`]: Gaussians that are near each other in space follow each other.

use rayon::prelude::*;

use crate::scene::bounds_of;

/// The indices of points, sorted along a Morton curve of 2^21 steps along each axis of their bounds.
#[must_use]
pub fn morton_order(means: &[[f32; 3]]) -> Vec<usize> {
    const BITS: u32 = 21;
    let [low, high] = bounds_of(means.iter().copied()).map(|bound| bound.map(f64::from));
    let step = |k: usize, v: f64| {
        let part = if high[k] > low[k] { (v - low[k]) / (high[k] - low[k]) } else { 0.0 };
        let most = f64::from((1 << BITS) - 1);
        (part * most + 0.5).clamp(0.0, most) as u64
    };
    let key = |mean: &[f32; 3]| {
        let steps: [u64; 3] = std::array::from_fn(|k| step(k, mean[k].into()));
        let bit = |b: u32, k: usize| (steps[k] >> b & 1) << (3 * b + k as u32);
        (0..BITS).map(|b| bit(b, 0) | bit(b, 1) | bit(b, 2)).sum::<u64>()
    };
    let mut order: Vec<(u64, usize)> = means.par_iter().map(key).zip(0..means.len()).collect();
    order.par_sort_unstable();
    order.into_iter().map(|(_, i)| i).collect()
}
