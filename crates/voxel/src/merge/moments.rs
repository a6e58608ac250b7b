//! Moment-matched merging.

use gs_model::Scene;

use super::Shape;
use crate::eigen::{jacobi, multiply, quaternion};
use crate::gaussian::{MAX_ALPHA, area, congruence, exp, ln, logit, opacity, rotation, scale};

/// What is read and computed once of every member.
#[derive(Clone, Copy)]
pub(super) struct Look {
    mean: [f32; 3],
    rotation: [f32; 4],
    scales: [f64; 3],
    pub(super) area: f64,
    pub(super) opacity: f64,
}

/// Members whose exponentials are computed together, in vector instructions.
const LANES: usize = 8;

/// The looks of `members`, in their order.
pub(super) fn look(scene: &Scene, members: &[u32], looks: &mut Vec<Look>) {
    looks.clear();
    for members in members.chunks(LANES) {
        // What is beyond the last member is not kept.
        let (mut log_scales, mut logits) = ([[0.0f32; 3]; LANES], [0.0f32; LANES]);
        for ((log_scale, logit), &i) in log_scales.iter_mut().zip(&mut logits).zip(members) {
            *log_scale = scene.log_scales[i as usize];
            *logit = scene.opacity_logits[i as usize];
        }
        let mut scales = [[0.0; 3]; LANES];
        let flat = scales.as_flattened_mut().iter_mut();
        flat.zip(log_scales.as_flattened()).for_each(|(s, &l)| *s = scale(l));
        let opacities = logits.map(opacity);
        let mut areas = [0.0; LANES];
        areas.iter_mut().zip(&scales).for_each(|(a, s)| *a = area(*s));
        looks.extend(members.iter().enumerate().map(|(k, &i)| Look {
            mean: scene.means[i as usize],
            rotation: scene.rotations[i as usize],
            scales: scales[k],
            area: areas[k],
            opacity: opacities[k],
        }));
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
    let share = 1.0 / weights.iter().sum::<f64>();
    let first = looks[0].mean.map(f64::from);
    let offset =
        |look: &Look| -> [f64; 3] { std::array::from_fn(|k| f64::from(look.mean[k]) - first[k]) };
    let mut mean = [0.0; 3];
    let (mut dominant, mut dominant_weight) = (0, f64::NEG_INFINITY);
    for (i, (look, &w)) in looks.iter().zip(weights).enumerate() {
        let d = offset(look);
        for k in 0..3 {
            mean[k] += w * share * d[k];
        }
        if w > dominant_weight {
            (dominant, dominant_weight) = (i, w);
        }
    }
    // Second moments, in the frame of the dominant member.
    let frame = rotation(looks[dominant].rotation);
    let mut covariance = [0.0; 6];
    let mut density = 0.0;
    for (i, (look, &w)) in looks.iter().zip(weights).enumerate() {
        let squares = look.scales.map(|x| x * x);
        let c = if i == dominant {
            [squares[0], squares[1], squares[2], 0.0, 0.0, 0.0]
        } else {
            let own = rotation(look.rotation);
            // frame^T own: columns are the member's axes in the dominant frame.
            let relative: [[f64; 3]; 3] = std::array::from_fn(|a| {
                std::array::from_fn(|b| (0..3).map(|k| frame[k][a] * own[k][b]).sum())
            });
            congruence(&relative, squares)
        };
        let d = offset(look);
        let d: [f64; 3] =
            std::array::from_fn(|a| (0..3).map(|k| frame[k][a] * (d[k] - mean[k])).sum());
        for (e, (a, b)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].into_iter().enumerate()
        {
            covariance[e] += w * share * (c[e] + d[a] * d[b]);
        }
        density -= ln(1.0 - look.opacity.min(MAX_ALPHA)) * look.area;
    }
    let (variances, axes) = jacobi(covariance);
    let base = quaternion(&frame);
    let mut q = multiply(base, quaternion(&axes));
    // The sign of the dominant member's quaternion, so that neighbours stay comparable.
    let dot: f64 =
        q.iter().zip(looks[dominant].rotation).map(|(a, b)| a * f64::from(b)).sum();
    if dot < 0.0 {
        q = q.map(|x| -x);
    }
    let variances = variances.map(|v| v.max(f64::MIN_POSITIVE));
    // Optical depth times area is conserved: members on top of each other give
    // 1 - prod(1 - alpha), members side by side their mean.
    let merged_area = area(variances.map(f64::sqrt));
    let alpha = 1.0 - exp((-density / merged_area).max(-700.0));
    Shape {
        rotation: q.map(|x| x as f32),
        log_scale: variances.map(|v| (0.5 * ln(v)) as f32),
        opacity_logit: logit(alpha.clamp(1e-12, MAX_ALPHA)) as f32,
    }
}
