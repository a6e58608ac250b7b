//! [`Bulk`]: where the detail of a scene is.

use glam::DVec3;
use gs_model::Scene;
use rayon::prelude::*;

/// A sphere that holds nearly all of the detail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bulk {
    pub(super) centre: DVec3,
    pub(super) radius: f64,
}

/// The smallest Gaussians, by this share, weigh no more than the largest of them. Otherwise a few specks would
/// outweigh the rest.
const SPECKS: f64 = 0.05;
/// The share of the weight whose distance from the median stands for the size of the subject; what is
/// further than `FAR` times that is background.
const CORE: f64 = 0.8;
const FAR: f64 = 2.0;
/// Weighted quantiles that a box around the subject lies between, and of the distance from its centre.
const EDGE: f64 = 0.01;
const WITHIN: f64 = 0.99;

/// Least radius of the bulk, in standard deviations of a typical Gaussian: all means may be equal.
const SIZES: f64 = 2.0;
const LEAST_RADIUS: f64 = 1e-9;

impl Bulk {
    /// The bulk of a scene; `None` if it holds no Gaussian.
    pub(super) fn of(scene: &Scene, weigh: Weigh) -> Option<Self> {
        let weights = weights(scene, weigh);
        let all: Vec<usize> = (0..scene.len()).filter(|&i| weights[i] > 0.0).collect();
        let at = |i: usize| DVec3::from_array(scene.means[i].map(f64::from));
        let share_of = |chosen: &[usize], share: f64, value: &dyn Fn(usize) -> f64| {
            quantile(chosen.iter().map(|&i| (value(i), weights[i])).collect(), share)
        };
        let along = |chosen: &[usize], k: usize, share| share_of(chosen, share, &|i| at(i)[k]);
        if all.is_empty() {
            return None;
        }
        let median = DVec3::from_array([0, 1, 2].map(|k| along(&all, k, 0.5)));
        let reach = FAR * share_of(&all, CORE, &|i| at(i).distance(median));
        let near: Vec<usize> =
            all.iter().copied().filter(|&i| at(i).distance(median) <= reach).collect();
        let near = if near.is_empty() { all } else { near };
        let middle = |k: usize| 0.5 * (along(&near, k, EDGE) + along(&near, k, 1.0 - EDGE));
        let centre = DVec3::from_array([0, 1, 2].map(middle));
        let largest = |l: &[f32; 3]| l.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let typical = share_of(&near, 0.5, &|i| largest(&scene.log_scales[i]).into());
        let least = SIZES * libm::exp(typical);
        let radius = share_of(&near, WITHIN, &|i| at(i).distance(centre)).max(least);
        // The radius must be a positive f32.
        Some(Self { centre, radius: radius.clamp(LEAST_RADIUS, f64::from(f32::MAX)) })
    }
}

/// What a Gaussian weighs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Weigh {
    /// Its opacity divided by its area.
    Detail,
    /// Its opacity.
    Alike,
}

/// The weight of each Gaussian.
pub(super) fn weights(scene: &Scene, weigh: Weigh) -> Vec<f64> {
    let areas: Vec<f64> = scene.log_scales.par_iter().map(area).collect();
    let least = quantile(areas.iter().map(|&a| (a, 1.0)).collect(), SPECKS).max(f64::MIN_POSITIVE);
    let small = |a: f64| if weigh == Weigh::Detail { least / a.max(least) } else { 1.0 };
    let opacity = |logit: f32| 1.0 / (1.0 + libm::exp(-f64::from(logit)));
    areas.iter().zip(&scene.opacity_logits).map(|(&a, &o)| opacity(o) * small(a)).collect()
}

/// Product of the two largest standard deviations.
fn area(log_scale: &[f32; 3]) -> f64 {
    let sum: f32 = log_scale.iter().sum();
    let least = log_scale.iter().copied().fold(f32::INFINITY, f32::min);
    libm::exp(f64::from(sum - least))
}

/// The value below which the given share of the weight lies; 0 of nothing.
pub(super) fn quantile(mut values: Vec<(f64, f64)>, share: f64) -> f64 {
    // Ties are broken, so that the sums do not depend on the number of threads.
    values.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let total: f64 = values.iter().map(|v| v.1).sum();
    let mut sum = 0.0;
    for &(value, weight) in &values {
        sum += weight;
        if sum >= share * total {
            return value;
        }
    }
    values.last().map_or(0.0, |v| v.0)
}
