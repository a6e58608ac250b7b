//! The errors of a decoded Gaussian, over their bounds.

use crate::covariance::coordinates;
use crate::encoder::options::MaxError;
use gs_model::Scene;
use rayon::prelude::*;

/// Values that share a step: the mean, which has none, opacity, DC, SH degrees 1 to 3, shape.
pub(super) const GROUPS: usize = 7;
/// For each group the greatest error over its bound.
pub(super) type Ratios = [f32; GROUPS];

/// The standard deviation along a Gaussian's longest axis.
pub(super) fn longest_axis(scene: &Scene, i: usize) -> f64 {
    let size = scene.log_scales[i].iter().copied().fold(f32::NEG_INFINITY, f32::max);
    libm::exp(f64::from(size))
}

/// The distance of a mean from that of Gaussian `i`, in standard deviations along its longest axis.
pub(super) fn mean_error(scene: &Scene, i: usize, mean: [f32; 3]) -> f32 {
    let square = |k: usize| {
        let d = f64::from(mean[k]) - f64::from(scene.means[i][k]);
        d * d
    };
    // A Gaussian without size has no error if its mean is exact, and an infinite one otherwise.
    let distance = (square(0) + square(1) + square(2)).sqrt();
    if distance == 0.0 { 0.0 } else { (distance / longest_axis(scene, i)) as f32 }
}

fn alpha(logit: f32) -> f64 {
    1.0 / (1.0 + libm::exp(-f64::from(logit)))
}

/// Errors over their bounds: of Gaussian `k` of `decoded`, which stands for Gaussian `i` of `scene`.
fn measure(scene: &Scene, i: usize, decoded: &Scene, k: usize, bounds: &MaxError) -> Ratios {
    let opacity = alpha(scene.opacity_logits[i]) - alpha(decoded.opacity_logits[k]);
    let before = coordinates(scene.rotations[i], scene.log_scales[i]);
    let after = coordinates(decoded.rotations[k], decoded.log_scales[k]);
    let squares = before.iter().zip(after).map(|(a, b)| f64::from(a - b) * f64::from(a - b));
    let shape = squares.sum::<f64>().sqrt() as f32;
    let (mine, theirs) = (scene.sh_of(i), decoded.sh_of(k));
    let degree = |d: usize| {
        // A missing coefficient is 0.
        let at = |sh: &[[f32; 3]], c: usize, rgb: usize| sh.get(c).map_or(0.0, |v| v[rgb]);
        let each = (d * d..(d + 1) * (d + 1)).flat_map(|c| (0..3).map(move |rgb| (c, rgb)));
        let errors = each.map(|(c, rgb)| (at(mine, c, rgb) - at(theirs, c, rgb)).abs());
        errors.fold(0.0, larger) / bounds.sh
    };
    [
        mean_error(scene, i, decoded.means[k]) / bounds.mean,
        opacity.abs() as f32 / bounds.opacity,
        degree(0),
        degree(1),
        degree(2),
        degree(3),
        shape / bounds.shape,
    ]
}

/// For each Gaussian of `order`, its errors in `decoded` over their bounds.
pub(super) fn ratios(
    scene: &Scene,
    order: &[usize],
    decoded: &Scene,
    bounds: &MaxError,
) -> Vec<Ratios> {
    let each = order.par_iter().enumerate();
    each.map(|(k, &i)| measure(scene, i, decoded, k, bounds)).collect()
}

/// The larger number; NaN if one is.
fn larger(a: f32, b: f32) -> f32 {
    if b > a || b.is_nan() { b } else { a }
}

/// The largest ratio of each group over all Gaussians.
pub(super) fn largest_ratios(ratios: &[Ratios]) -> Ratios {
    let mut worst = [0.0; GROUPS];
    for ratio in ratios {
        worst.iter_mut().zip(ratio).for_each(|(w, &r)| *w = larger(*w, r));
    }
    worst
}

impl MaxError {
    /// The errors, from their ratios to these bounds.
    pub(super) fn times(&self, worst: &Ratios) -> Self {
        let [mean, opacity, dc, sh1, sh2, sh3, shape] = *worst;
        let sh = [dc, sh1, sh2, sh3].into_iter().fold(0.0, larger);
        Self {
            mean: self.mean * mean,
            opacity: self.opacity * opacity,
            shape: self.shape * shape,
            sh: self.sh * sh,
        }
    }
}
