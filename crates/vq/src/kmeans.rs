//! Weighted k-means on covariance features. Centres that lose all their points start again at other
//! points.
//!
//! A mean of positive semi-definite matrices is one too, so centres need no projection. Only the assignment runs in parallel, and points do not depend on each other; sums
//! are taken in point order. So the result does not depend on the number of threads.

use rayon::prelude::*;

use crate::covariance::Feature;
use crate::nearest::{CHUNK, Hit, Nearest};

/// Most iterations.
const ITERATIONS: usize = 8;
/// Training ends when an iteration lowers the distortion by less than this part of it.
const TOLERANCE: f64 = 2e-3;

/// Nearest centre of every point. `hints` (one centre a point) make it faster.
fn assign(points: &[Feature], centres: &[Feature], hints: Option<&[u32]>) -> Vec<Hit> {
    let tree = Nearest::new(centres);
    let hint = |i: usize| hints.map(|hints| (hints[i], &centres[hints[i] as usize]));
    let points = points.par_iter().enumerate().with_min_len(CHUNK);
    points.map(|(i, point)| tree.find(point, hint(i))).collect()
}

/// Sum of weight times cost.
fn weighted_cost(hits: &[Hit], weights: &[f32]) -> f64 {
    hits.iter().zip(weights).map(|(h, &w)| f64::from(w) * f64::from(h.cost)).sum()
}

/// Moves `centres` until moving them helps little.
pub(crate) fn train(points: &[Feature], weights: &[f32], centres: &mut [Feature]) {
    let mut hits = assign(points, centres, None);
    for _ in 0..ITERATIONS {
        let before = weighted_cost(&hits, weights);
        let all_used = iterate(points, weights, centres, &mut hits);
        if before - weighted_cost(&hits, weights) <= TOLERANCE * before && all_used {
            break;
        }
    }
}

/// Moves centres to means, and assigns the points again. Returns whether every centre had points.
fn iterate(
    points: &[Feature],
    weights: &[f32],
    centres: &mut [Feature],
    hits: &mut Vec<Hit>,
) -> bool {
    let dead = move_to_means(points, weights, hits, centres);
    revive(points, weights, hits, centres, &dead);
    let hints: Vec<u32> = hits.iter().map(|h| h.id).collect();
    *hits = assign(points, centres, Some(&hints));
    dead.is_empty()
}

/// Every centre becomes the weighted mean of its points, summed in point order; returns those that
/// have none.
fn move_to_means(
    points: &[Feature],
    weights: &[f32],
    hits: &[Hit],
    centres: &mut [Feature],
) -> Vec<usize> {
    let mut sums = vec![[0.0f64; 6]; centres.len()];
    let mut mass = vec![0.0f64; centres.len()];
    for ((point, &weight), hit) in points.iter().zip(weights).zip(hits) {
        let (w, c) = (f64::from(weight), hit.id as usize);
        mass[c] += w;
        for k in 0..6 {
            sums[c][k] += w * f64::from(point[k]);
        }
    }
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
    use crate::rng::random_points;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn distortion_never_increases(seed: u64, n in 10usize..900, k in 1usize..60) {
            let (points, weights) = random_points(n, seed);
            // The worst start: all centres in one place, so nearly all are dead.
            let mut centres = vec![points[0]; k];
            let mut hits = assign(&points, &centres, None);
            for _ in 0..12 {
                let before = weighted_cost(&hits, &weights);
                iterate(&points, &weights, &mut centres, &mut hits);
                // Centres are rounded to f32.
                prop_assert!(weighted_cost(&hits, &weights) <= before * (1.0 + 1e-6) + 1e-9);
            }
        }
    }

    #[test]
    fn one_centre_is_the_weighted_mean() {
        let (points, weights) = random_points(300, 3);
        let mut centres = vec![points[5]];
        train(&points, &weights, &mut centres);
        let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
        for k in 0..6 {
            let sum: f64 =
                points.iter().zip(&weights).map(|(p, &w)| f64::from(p[k]) * f64::from(w)).sum();
            assert!((f64::from(centres[0][k]) - sum / total).abs() < 1e-6);
        }
    }

    #[test]
    fn dead_centres_come_back() {
        let (points, weights) = random_points(200, 8);
        // All centres but the first lie on one far spot, so that no point is nearest to them.
        let mut centres = vec![[9.0; 6]; 40];
        centres[0] = [0.5; 6];
        train(&points, &weights, &mut centres);
        let mut used: Vec<u32> = assign(&points, &centres, None).iter().map(|h| h.id).collect();
        used.sort_unstable();
        used.dedup();
        assert_eq!(used.len(), 40);
    }
}
