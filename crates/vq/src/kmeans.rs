//! Weighted k-means on covariance features: mini-batches, then full iterations. Centres that lose
//! all their points start again at other points.
//!
//! The mean of covariances of trace 1 has trace 1 and is positive semi-definite, so centres need no
//! projection. Only the assignment runs in parallel, and points do not depend on each other; sums
//! are taken in point order. So the result does not depend on the number of threads.

use rayon::prelude::*;

use crate::covariance::Feature;
use crate::nearest::{Hit, Nearest};
use crate::rng::SplitMix64;

/// Points handed to a thread at a time.
const CHUNK: usize = 4096;

/// How long to train; see the fields of the same name in [`crate::Options`].
pub(crate) struct Schedule {
    pub(crate) batch_size: usize,
    pub(crate) mini_batches: usize,
    pub(crate) full_iterations: usize,
    pub(crate) tolerance: f64,
}

/// Nearest centre of every point. `hints` (one centre a point) make it faster.
pub(crate) fn assign(points: &[Feature], centres: &[Feature], hints: Option<&[u32]>) -> Vec<Hit> {
    let tree = Nearest::new(centres);
    let mut hits = vec![Hit { id: 0, cost: 0.0 }; points.len()];
    hits.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
        let first = chunk * CHUNK;
        for (k, hit) in out.iter_mut().enumerate() {
            let hint = hints.map(|h| (h[first + k], &centres[h[first + k] as usize]));
            *hit = tree.find(&points[first + k], hint);
        }
    });
    hits
}

/// Sum of weight times cost.
pub(crate) fn weighted_cost(hits: &[Hit], weights: &[f32]) -> f64 {
    hits.iter().zip(weights).map(|(h, &w)| f64::from(w) * f64::from(h.cost)).sum()
}

/// Moves `centres` and returns the weighted distortion (divided by the total weight) before
/// each full iteration and after the last.
pub(crate) fn train(
    points: &[Feature],
    weights: &[f32],
    centres: &mut [Feature],
    schedule: &Schedule,
    rng: &mut SplitMix64,
) -> Vec<f64> {
    if points.is_empty() || centres.is_empty() {
        return Vec::new();
    }
    if points.len() > schedule.batch_size {
        mini_batches(points, weights, centres, schedule, rng);
    }
    let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
    let mut hits = assign(points, centres, None);
    let mut history = vec![weighted_cost(&hits, weights) / total];
    for _ in 0..schedule.full_iterations {
        let dead = move_to_means(points, weights, &hits, centres);
        revive(points, weights, &hits, centres, &dead);
        let hints: Vec<u32> = hits.iter().map(|h| h.id).collect();
        hits = assign(points, centres, Some(&hints));
        let before = history[history.len() - 1];
        let after = weighted_cost(&hits, weights) / total;
        history.push(after);
        if before - after <= schedule.tolerance * before && dead.is_empty() {
            break;
        }
    }
    history
}

/// Sculley's mini-batch k-means: every centre moves towards the batch's mean at a rate that
/// falls with the weight it has seen.
fn mini_batches(
    points: &[Feature],
    weights: &[f32],
    centres: &mut [Feature],
    schedule: &Schedule,
    rng: &mut SplitMix64,
) {
    let mut seen = vec![0.0f64; centres.len()];
    for _ in 0..schedule.mini_batches {
        let drawn: Vec<usize> = (0..schedule.batch_size).map(|_| rng.below(points.len())).collect();
        let batch: Vec<Feature> = drawn.iter().map(|&i| points[i]).collect();
        let batch_weights: Vec<f32> = drawn.iter().map(|&i| weights[i]).collect();
        let hits = assign(&batch, centres, None);
        let (sums, mass) = weighted_sums(&batch, &batch_weights, &hits, centres.len());
        for (c, centre) in centres.iter_mut().enumerate() {
            if mass[c] > 0.0 {
                seen[c] += mass[c];
                let rate = mass[c] / seen[c];
                for k in 0..6 {
                    let old = f64::from(centre[k]);
                    centre[k] = (old + rate * (sums[c][k] / mass[c] - old)) as f32;
                }
            }
        }
    }
}

/// Per centre, the weighted sum of its points and their weight, in point order.
fn weighted_sums(
    points: &[Feature],
    weights: &[f32],
    hits: &[Hit],
    centres: usize,
) -> (Vec<[f64; 6]>, Vec<f64>) {
    let mut sums = vec![[0.0f64; 6]; centres];
    let mut mass = vec![0.0f64; centres];
    for ((point, &weight), hit) in points.iter().zip(weights).zip(hits) {
        let (w, c) = (f64::from(weight), hit.id as usize);
        mass[c] += w;
        for k in 0..6 {
            sums[c][k] += w * f64::from(point[k]);
        }
    }
    (sums, mass)
}

/// Every centre becomes the weighted mean of its points; returns those that have none.
fn move_to_means(
    points: &[Feature],
    weights: &[f32],
    hits: &[Hit],
    centres: &mut [Feature],
) -> Vec<usize> {
    let (sums, mass) = weighted_sums(points, weights, hits, centres.len());
    let mut dead = Vec::new();
    for (c, centre) in centres.iter_mut().enumerate() {
        if mass[c] > 0.0 {
            *centre = sums[c].map(|s| (s / mass[c]) as f32);
        } else {
            dead.push(c);
        }
    }
    dead
}

/// Moves centres without points to the points that cost most, one each. This can only lower the
/// distortion.
fn revive(
    points: &[Feature],
    weights: &[f32],
    hits: &[Hit],
    centres: &mut [Feature],
    dead: &[usize],
) {
    if dead.is_empty() {
        return;
    }
    let cost = |i: u32| weights[i as usize] * hits[i as usize].cost;
    let mut costly: Vec<u32> = (0..points.len() as u32).filter(|&i| cost(i) > 0.0).collect();
    costly.sort_unstable_by(|&a, &b| cost(b).total_cmp(&cost(a)).then(a.cmp(&b)));
    for (&c, &i) in dead.iter().zip(&costly) {
        centres[c] = points[i as usize];
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn schedule(full_iterations: usize) -> Schedule {
        Schedule { batch_size: usize::MAX, mini_batches: 0, full_iterations, tolerance: 0.0 }
    }

    fn random(n: usize, seed: u64) -> (Vec<Feature>, Vec<f32>) {
        let mut rng = SplitMix64::new(seed);
        let points = (0..n).map(|_| [0; 6].map(|_: i32| rng.unit() as f32)).collect();
        let weights = (0..n).map(|_| (rng.unit() * rng.unit() * 10.0) as f32).collect();
        (points, weights)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn distortion_never_increases(seed: u64, n in 10usize..900, k in 1usize..60) {
            let (points, weights) = random(n, seed);
            // The worst start: all centres in one place, so nearly all are dead.
            let mut centres = vec![points[0]; k];
            let mut rng = SplitMix64::new(seed);
            let history = train(&points, &weights, &mut centres, &schedule(12), &mut rng);
            for pair in history.windows(2) {
                // Centres are rounded to f32.
                prop_assert!(pair[1] <= pair[0] * (1.0 + 1e-6) + 1e-12, "{history:?}");
            }
        }
    }

    #[test]
    fn one_centre_is_the_weighted_mean() {
        let (points, weights) = random(300, 3);
        let mut centres = vec![points[5]];
        train(&points, &weights, &mut centres, &schedule(1), &mut SplitMix64::new(0));
        let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
        for k in 0..6 {
            let sum: f64 =
                points.iter().zip(&weights).map(|(p, &w)| f64::from(p[k]) * f64::from(w)).sum();
            assert!((f64::from(centres[0][k]) - sum / total).abs() < 1e-6);
        }
    }

    #[test]
    fn dead_centres_come_back() {
        let (points, weights) = random(200, 8);
        // Far away, all on one spot: none is ever nearest but the first.
        let mut centres = vec![[9.0; 6]; 40];
        centres[0] = [0.5; 6];
        train(&points, &weights, &mut centres, &schedule(10), &mut SplitMix64::new(0));
        let mut used: Vec<u32> = assign(&points, &centres, None).iter().map(|h| h.id).collect();
        used.sort_unstable();
        used.dedup();
        assert_eq!(used.len(), 40);
    }

    #[test]
    fn mini_batches_help_before_full_iterations() {
        let (points, weights) = random(20_000, 4);
        let run = |mini_batches| {
            let mut centres: Vec<Feature> = points[..64].to_vec();
            let schedule =
                Schedule { batch_size: 2000, mini_batches, full_iterations: 0, tolerance: 0.0 };
            train(&points, &weights, &mut centres, &schedule, &mut SplitMix64::new(1))[0]
        };
        assert!(run(20) < 0.9 * run(0), "{} {}", run(20), run(0));
    }
}
