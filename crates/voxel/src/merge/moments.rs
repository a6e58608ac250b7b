//! Merging by moments: [`Merge::Moments`](crate::Merge::Moments).
//!
//! The paper (section 3.3) keeps the shape of the largest member. Here the merged Gaussian has the
//! members' second moments, and an opacity that conserves optical depth times area.
//!
//! *Invariant:* leaves are finished [`LANES`] at a time, and no leaf's result depends on the
//! others.

use gs_model::Scene;
use gs_model::math::{Symmetric, axes_product, eigen, quaternion, quaternion_product, rotation};

use super::Shape;
use crate::gaussian::{MAX_ALPHA, area, exp, ln, opacity, scale};

/// Leaves that are finished together, and members whose properties are computed together: loops
/// over them become vector instructions.
const LANES: usize = 8;

/// One number of each of [`LANES`] leaves.
type Lanes = [f64; LANES];

/// What the merging reads and computes once of every member.
#[derive(Clone, Copy)]
pub(super) struct MemberProperties {
    mean: [f32; 3],
    rotation: [f32; 4],
    scales: [f64; 3],
    pub(super) area: f64,
    pub(super) opacity: f64,
    /// `-ln(1 - opacity)`, with the opacity at most [`MAX_ALPHA`].
    optical_depth: f64,
}

/// Fills `properties` with those of `members`, in their order.
#[inline(always)]
pub(super) fn read_properties(
    scene: &Scene,
    members: &[u32],
    properties: &mut Vec<MemberProperties>,
) {
    properties.clear();
    for members in members.chunks(LANES) {
        // The lanes beyond the last member are computed and not kept.
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
        let optical_depths = opacities.map(|o| -ln(1.0 - o.min(MAX_ALPHA)));
        properties.extend(members.iter().enumerate().map(|(k, &i)| MemberProperties {
            mean: scene.means[i as usize],
            rotation: scene.rotations[i as usize],
            scales: scales[k],
            area: areas[k],
            opacity: opacities[k],
            optical_depth: optical_depths[k],
        }));
    }
}

/// Divides the weights of a leaf by the greatest. If none is positive, all members count alike.
#[inline(always)]
pub(super) fn normalise(weights: &mut [f64]) {
    let greatest = weights.iter().fold(0.0, |m: f64, &w| m.max(w));
    for w in weights {
        // `max` ignores NaN, so weights that are all NaN give 1 too.
        *w = if greatest > 0.0 { *w / greatest } else { 1.0 };
    }
}

/// The weighted mean of the means of a leaf's members.
pub(super) fn mean(scene: &Scene, members: &[u32], weights: &[f64]) -> [f32; 3] {
    let share = 1.0 / weights.iter().sum::<f64>();
    let first = scene.means[members[0] as usize].map(f64::from);
    let offset = |k: usize| -> f64 {
        let of =
            |(&m, &w): (&u32, &f64)| w * share * (f64::from(scene.means[m as usize][k]) - first[k]);
        members.iter().zip(weights).map(of).sum()
    };
    std::array::from_fn(|k| (first[k] + offset(k)) as f32)
}

/// Up to [`LANES`] leaves whose moments are summed and whose shapes are not computed yet.
#[derive(Default)]
pub(super) struct PendingLeaves {
    len: usize,
    /// Rotation of the dominant member, the one of the greatest weight.
    rotations: [[f32; 4]; LANES],
    /// Covariance in the frame of the dominant member, entry by entry.
    covariances: Symmetric<Lanes>,
    /// Sum of optical depth times area.
    densities: Lanes,
    /// Sum of optical depths: that of all members on top of each other.
    stacked: Lanes,
}

impl PendingLeaves {
    /// Adds the moments of a leaf. Returns true if there is no room for another one.
    #[inline(always)]
    pub(super) fn push(&mut self, members: &[MemberProperties], weights: &[f64]) -> bool {
        let share = 1.0 / weights.iter().sum::<f64>();
        let first = members[0].mean.map(f64::from);
        let offset = |member: &MemberProperties| -> [f64; 3] {
            std::array::from_fn(|k| f64::from(member.mean[k]) - first[k])
        };
        let mut mean = [0.0; 3];
        let (mut dominant, mut dominant_weight) = (0, f64::NEG_INFINITY);
        for (i, (member, &w)) in members.iter().zip(weights).enumerate() {
            let d = offset(member);
            for k in 0..3 {
                mean[k] += w * share * d[k];
            }
            if w > dominant_weight {
                (dominant, dominant_weight) = (i, w);
            }
        }
        // Second moments, in the frame of the dominant member.
        let frame = rotation(members[dominant].rotation);
        let mut covariance = [0.0; 6];
        let (mut density, mut stacked) = (0.0, 0.0);
        for (i, (member, &w)) in members.iter().zip(weights).enumerate() {
            let squares = member.scales.map(|x| x * x);
            let c = if i == dominant {
                [squares[0], squares[1], squares[2], 0.0, 0.0, 0.0]
            } else {
                let axes = rotation(member.rotation);
                // frame^T axes: the columns are the member's axes in the dominant frame.
                let relative: [[f64; 3]; 3] = std::array::from_fn(|a| {
                    std::array::from_fn(|b| (0..3).map(|k| frame[k][a] * axes[k][b]).sum())
                });
                axes_product(&relative, squares)
            };
            let d = offset(member);
            let d: [f64; 3] =
                std::array::from_fn(|a| (0..3).map(|k| frame[k][a] * (d[k] - mean[k])).sum());
            const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
            for (e, (a, b)) in PAIRS.into_iter().enumerate() {
                covariance[e] += w * share * (c[e] + d[a] * d[b]);
            }
            density += member.optical_depth * member.area;
            stacked += member.optical_depth;
        }
        let l = self.len;
        self.rotations[l] = members[dominant].rotation;
        self.covariances.iter_mut().zip(covariance).for_each(|(all, c)| all[l] = c);
        self.densities[l] = density;
        self.stacked[l] = stacked;
        self.len += 1;
        self.len == LANES
    }

    /// Computes the shapes of the leaves, calls `put` with each and its index from `leaves`, and
    /// empties the list.
    #[inline(always)]
    pub(super) fn finish<'a>(
        &mut self,
        leaves: &mut impl Iterator<Item = &'a usize>,
        put: &mut impl FnMut(usize, Shape),
    ) {
        if self.len == 0 {
            return;
        }
        let (variances, axes) = eigen(&self.covariances);
        let variances = variances.map(|v| v.map(|v| v.max(f64::MIN_POSITIVE)));
        let log_scales = variances.map(|v| v.map(|v| (0.5 * ln(v)) as f32));
        let mut logits = [0.0f32; LANES];
        for (l, (logit, density)) in logits.iter_mut().zip(self.densities).enumerate() {
            // Optical depth times area is conserved: members on top of each other give
            // 1 - prod(1 - alpha), members side by side their mean.
            let merged_area = area([0, 1, 2].map(|k| variances[k][l].sqrt()));
            let depth = (density / merged_area).min(self.stacked[l]);
            let alpha = 1.0 - exp((-depth).max(-700.0));
            *logit = crate::gaussian::logit(alpha.clamp(1e-12, MAX_ALPHA)) as f32;
        }
        for (l, &leaf) in (0..self.len).zip(leaves) {
            // The dominant member's quaternion need not be of unit norm; this one is.
            let base = quaternion(&rotation(self.rotations[l]));
            let mut q =
                quaternion_product(base, quaternion(&axes.map(|row| row.map(|lanes| lanes[l]))));
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
