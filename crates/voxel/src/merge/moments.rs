//! Moment-matched merging.

use gs_model::Scene;

use super::Shape;
use crate::eigen::{LANES, Lanes, jacobi, multiply, quaternion};
use crate::gaussian::{MAX_ALPHA, area, congruence, exp, ln, opacity, rotation, scale};

/// What is read and computed once of every member.
#[derive(Clone, Copy)]
pub(super) struct Look {
    mean: [f32; 3],
    rotation: [f32; 4],
    scales: [f64; 3],
    pub(super) area: f64,
    pub(super) opacity: f64,
    /// Optical depth: `-ln(1 - opacity)`, of an opacity a rasterizer would use.
    depth: f64,
}

/// The looks of `members`, in their order. [`LANES`] at a time, because exponentials and logarithms
/// become vector instructions.
#[inline(always)]
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
        let depths = opacities.map(|o| -ln(1.0 - o.min(MAX_ALPHA)));
        looks.extend(members.iter().enumerate().map(|(k, &i)| Look {
            mean: scene.means[i as usize],
            rotation: scene.rotations[i as usize],
            scales: scales[k],
            area: areas[k],
            opacity: opacities[k],
            depth: depths[k],
        }));
    }
}

/// Divides the weights of a leaf by the greatest.
#[inline(always)]
pub(super) fn normalise(weights: &mut [f64]) {
    let greatest = weights.iter().fold(0.0, |m: f64, &w| m.max(w));
    for w in weights {
        // Invisible members only: all count alike. (Also the way out for NaN.)
        *w = if greatest > 0.0 { *w / greatest } else { 1.0 };
    }
}

/// Up to [`LANES`] leaves on their way to a merged Gaussian each.
#[derive(Default)]
pub(super) struct Shapes {
    len: usize,
    /// Rotations of the dominant members,
    rotations: [[f32; 4]; LANES],
    /// ... and covariances in their frames, entry by entry.
    covariances: [Lanes; 6],
    /// Sums of optical depth times area.
    densities: Lanes,
}

impl Shapes {
    /// Takes in a leaf; true if there is room for no more.
    #[inline(always)]
    pub(super) fn push(&mut self, looks: &[Look], weights: &[f64]) -> bool {
        let share = 1.0 / weights.iter().sum::<f64>();
        let first = looks[0].mean.map(f64::from);
        let offset = |look: &Look| -> [f64; 3] {
            std::array::from_fn(|k| f64::from(look.mean[k]) - first[k])
        };
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
            const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
            for (e, (a, b)) in PAIRS.into_iter().enumerate() {
                covariance[e] += w * share * (c[e] + d[a] * d[b]);
            }
            density += look.depth * look.area;
        }
        let l = self.len;
        self.rotations[l] = looks[dominant].rotation;
        self.covariances.iter_mut().zip(covariance).for_each(|(all, c)| all[l] = c);
        self.densities[l] = density;
        self.len += 1;
        self.len == LANES
    }

    /// Gives the merged Gaussians out, beside the next of `leaves` each, and makes room.
    #[inline(always)]
    pub(super) fn finish<'a>(
        &mut self,
        leaves: &mut impl Iterator<Item = &'a usize>,
        put: &mut impl FnMut(usize, Shape),
    ) {
        if self.len == 0 {
            return;
        }
        let (variances, axes) = jacobi(&self.covariances);
        let variances = variances.map(|v| v.map(|v| v.max(f64::MIN_POSITIVE)));
        let log_scales = variances.map(|v| v.map(|v| (0.5 * ln(v)) as f32));
        let mut logits = [0.0f32; LANES];
        for (l, (logit, density)) in logits.iter_mut().zip(self.densities).enumerate() {
            // Optical depth times area is conserved: members on top of each other give
            // 1 - prod(1 - alpha), members side by side their mean.
            let merged_area = area([0, 1, 2].map(|k| variances[k][l].sqrt()));
            let alpha = 1.0 - exp((-density / merged_area).max(-700.0));
            *logit = crate::gaussian::logit(alpha.clamp(1e-12, MAX_ALPHA)) as f32;
        }
        for (l, &leaf) in (0..self.len).zip(leaves) {
            // Of a unit quaternion; the dominant member's own need not be one.
            let base = quaternion(&rotation(self.rotations[l]));
            let mut q = multiply(base, quaternion(&axes.map(|row| row.map(|lanes| lanes[l]))));
            // The sign of the dominant member's quaternion, so that neighbours stay comparable.
            let dot: f64 = q.iter().zip(self.rotations[l]).map(|(a, b)| a * f64::from(b)).sum();
            if dot < 0.0 {
                q = q.map(|x| -x);
            }
            let shape = Shape {
                rotation: q.map(|x| x as f32),
                log_scale: log_scales.map(|lanes| lanes[l]),
                opacity_logit: logits[l],
            };
            put(leaf, shape);
        }
        *self = Self::default();
    }
}
