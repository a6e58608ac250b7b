//! Moment-matched merging.

use gs_model::Scene;

use super::Shape;
use crate::eigen::{jacobi, multiply, quaternion};
use crate::gaussian::{MAX_ALPHA, area, congruence, logit, opacity, rotation, scales};

/// What is read and computed once of every member.
#[derive(Clone, Copy)]
pub(super) struct Look {
    mean: [f32; 3],
    rotation: [f32; 4],
    scales: [f64; 3],
    pub(super) area: f64,
    pub(super) opacity: f64,
}

impl Look {
    pub(super) fn of(scene: &Scene, member: u32) -> Self {
        let i = member as usize;
        let scales = scales(scene.log_scales[i]);
        Self {
            mean: scene.means[i],
            rotation: scene.rotations[i],
            scales,
            area: area(scales),
            opacity: opacity(scene.opacity_logits[i]),
        }
    }
}

/// Divides the weights of a leaf by the greatest.
pub(super) fn normalise(weights: &mut [f64]) {
    let greatest = weights.iter().fold(0.0, |m: f64, &w| m.max(w));
    for w in weights {
        // Invisible members only: all count alike. (Also the way out for NaN.)
        *w = if greatest > 0.0 { *w / greatest } else { 1.0 };
    }
}

/// Covariance and opacity of the merged Gaussian.
pub(super) fn shape(looks: &[Look], weights: &[f64]) -> Shape {
    let total: f64 = weights.iter().sum();
    let first = looks[0].mean.map(f64::from);
    let offset =
        |look: &Look| -> [f64; 3] { std::array::from_fn(|k| f64::from(look.mean[k]) - first[k]) };
    let mut mean = [0.0; 3];
    let (mut dominant, mut dominant_weight) = (&looks[0], f64::NEG_INFINITY);
    for (look, &w) in looks.iter().zip(weights) {
        let d = offset(look);
        for k in 0..3 {
            mean[k] += w * d[k] / total;
        }
        if w > dominant_weight {
            (dominant, dominant_weight) = (look, w);
        }
    }
    // Second moments, in the frame of the dominant member.
    let frame = rotation(dominant.rotation);
    let mut covariance = [0.0; 6];
    let mut density = 0.0;
    for (look, &w) in looks.iter().zip(weights) {
        let own = rotation(look.rotation);
        // frame^T own: columns are the member's axes in the dominant frame.
        let relative: [[f64; 3]; 3] = std::array::from_fn(|a| {
            std::array::from_fn(|b| (0..3).map(|k| frame[k][a] * own[k][b]).sum())
        });
        let d = offset(look);
        let d: [f64; 3] =
            std::array::from_fn(|a| (0..3).map(|k| frame[k][a] * (d[k] - mean[k])).sum());
        let c = congruence(&relative, look.scales.map(|x| x * x));
        for (e, (a, b)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].into_iter().enumerate()
        {
            covariance[e] += w / total * (c[e] + d[a] * d[b]);
        }
        density -= libm::log1p(-look.opacity.min(MAX_ALPHA)) * look.area;
    }
    let (variances, axes) = jacobi(covariance);
    let base = quaternion(&frame);
    let mut q = multiply(base, quaternion(&axes));
    // The sign of the dominant member's quaternion, so that neighbours stay comparable.
    let dot: f64 = q.iter().zip(dominant.rotation).map(|(a, b)| a * f64::from(b)).sum();
    if dot < 0.0 {
        q = q.map(|x| -x);
    }
    let log_scale = variances.map(|v| 0.5 * libm::log(v.max(f64::MIN_POSITIVE)));
    // Optical depth times area is conserved: members on top of each other give
    // 1 - prod(1 - alpha), members side by side their mean.
    let merged_area = area(log_scale.map(libm::exp));
    let alpha = -libm::expm1(-density / merged_area);
    Shape {
        rotation: q.map(|x| x as f32),
        log_scale: log_scale.map(|x| x as f32),
        opacity_logit: logit(alpha.clamp(1e-12, MAX_ALPHA)) as f32,
    }
}
