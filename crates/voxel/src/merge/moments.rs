//! Moment-matched merging.

use gs_model::Scene;

use super::Shape;
use crate::eigen::{jacobi, multiply, quaternion};
use crate::gaussian::{MAX_ALPHA, area, congruence, exp, logit, opacity, rotation, scales};

/// What is computed once of every member.
#[derive(Clone, Copy)]
pub(super) struct Look {
    scales: [f64; 3],
    pub(super) area: f64,
    pub(super) opacity: f64,
}

impl Look {
    pub(super) fn of(scene: &Scene, member: u32) -> Self {
        let i = member as usize;
        let scales = scales(scene.log_scales[i]);
        Self { scales, area: area(scales), opacity: opacity(scene.opacity_logits[i]) }
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
pub(super) fn shape(scene: &Scene, members: &[u32], looks: &[Look], weights: &[f64]) -> Shape {
    let total: f64 = weights.iter().sum();
    let first = scene.means[members[0] as usize].map(f64::from);
    let offset =
        |i: usize| -> [f64; 3] { std::array::from_fn(|k| f64::from(scene.means[i][k]) - first[k]) };
    let mut mean = [0.0; 3];
    let (mut dominant, mut dominant_weight) = (members[0] as usize, f64::NEG_INFINITY);
    for (&i, &w) in members.iter().zip(weights) {
        let d = offset(i as usize);
        for k in 0..3 {
            mean[k] += w * d[k] / total;
        }
        if w > dominant_weight {
            (dominant, dominant_weight) = (i as usize, w);
        }
    }
    // Second moments, in the frame of the dominant member.
    let frame = rotation(scene.rotations[dominant]);
    let mut covariance = [0.0; 6];
    let mut density = 0.0;
    for ((&i, look), &w) in members.iter().zip(looks).zip(weights) {
        let i = i as usize;
        let s = look.scales;
        let own = rotation(scene.rotations[i]);
        // frame^T own: columns are the member's axes in the dominant frame.
        let relative: [[f64; 3]; 3] = std::array::from_fn(|a| {
            std::array::from_fn(|b| (0..3).map(|k| frame[k][a] * own[k][b]).sum())
        });
        let d = offset(i);
        let d: [f64; 3] =
            std::array::from_fn(|a| (0..3).map(|k| frame[k][a] * (d[k] - mean[k])).sum());
        let c = congruence(&relative, s.map(|x| x * x));
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
    let dot: f64 = q.iter().zip(scene.rotations[dominant]).map(|(a, b)| a * f64::from(b)).sum();
    if dot < 0.0 {
        q = q.map(|x| -x);
    }
    let log_scale = variances.map(|v| 0.5 * libm::log(v.max(f64::MIN_POSITIVE)));
    // Optical depth times area is conserved: members on top of each other give
    // 1 - prod(1 - alpha), members side by side their mean.
    let merged_area = area(log_scale.map(exp));
    let alpha = -libm::expm1(-density / merged_area);
    Shape {
        rotation: q.map(|x| x as f32),
        log_scale: log_scale.map(|x| x as f32),
        opacity_logit: logit(alpha.clamp(1e-12, MAX_ALPHA)) as f32,
    }
}
