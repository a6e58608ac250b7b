//! [`Records`]: what the rate-distortion strategy needs of every Gaussian, computed once.
//!
//! *Invariant:* sums are added block by block, in the order of the scene, so no weight depends on
//! the number of threads.

use bytemuck::{Pod, Zeroable};
use gs_model::Scene;
use gs_model::math::{axes_product, rotation, scaled_rotation};
use multiversion::multiversion;
use rayon::prelude::*;

use crate::error::Result;
use crate::gaussian::{area, opacity, scale};
use crate::importance::Importance;
use crate::pages::Pages;
use crate::rate_distortion::RateDistortion;

/// One Gaussian, in one cache line: the members of a cell lie all over the scene, and reading each
/// of the scene's arrays would be another cache miss.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(crate) struct Record {
    /// Square root of the covariance in world units, with an error of about 1e-6 of the greatest
    /// scale.
    pub(crate) root: [f32; 6],
    pub(crate) mean: [f32; 3],
    /// DC coefficients.
    pub(crate) colour: [f32; 3],
    /// Weight of a squared displacement or change of shape.
    pub(crate) geometry: f64,
    /// Weight of a squared difference of colours.
    pub(crate) importance: f64,
}

/// Gaussians per block. Fixed, because the sums are added block by block.
const BLOCK: usize = 64;

/// Standard deviations count as at most this in `root`, whose entries are `f32`.
const WIDEST: f64 = 1e37;

/// The records of a scene, and the sums that scale their weights to units of the mean importance.
#[derive(Debug)]
pub(crate) struct Records {
    records: Pages<Record>,
    sums: WeightSums,
}

/// What scales the weights of Gaussians: sums over the scene, or over a sample of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WeightSums {
    /// Gaussians.
    pub count: u64,
    /// Of importances.
    pub importance: f64,
    /// Of geometry times area.
    pub geometry: f64,
}

impl WeightSums {
    /// Of one scene, for [`voxelize_tile`](crate::voxelize_tile).
    ///
    /// # Errors
    /// As [`voxelize`](crate::voxelize), for the importances.
    pub fn of(scene: &Scene, options: &RateDistortion) -> Result<Self> {
        Ok(Records::of(scene, &options.importance, options.size_exponent)?.sums)
    }

    /// Adds those of more Gaussians.
    pub fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.importance += other.importance;
        self.geometry += other.geometry;
    }
}

impl Records {
    /// With importance I, area A and `size_exponent` p, `geometry` is `I / A^p`. A displacement by
    /// d changes about `I d^2 / A` of the images, which is p = 1. The weights are scaled so that
    /// the sum of importances is the number of Gaussians, and so is the sum of geometry times
    /// area.
    pub(crate) fn of(scene: &Scene, importance: &Importance, size_exponent: f64) -> Result<Self> {
        importance.validate(scene)?;
        let len = scene.len();
        let mut records = Pages::<Record>::zeroed(len);
        let sums: Vec<[f64; 2]> = records
            .par_chunks_mut(BLOCK)
            .with_min_len(16)
            .enumerate()
            .map(|(b, records)| fill(records, scene, importance, size_exponent, b * BLOCK))
            .collect();
        let sums = sums.iter().fold([0.0; 2], |s, b| [s[0] + b[0], s[1] + b[1]]);
        let sums = WeightSums { count: len as u64, importance: sums[0], geometry: sums[1] };
        Ok(Self { records, sums })
    }

    /// Scales weights by the sums of a scene of which this one is a part, if there is one.
    pub(crate) fn scaled_by(self, sums: Option<WeightSums>) -> Self {
        Self { sums: sums.unwrap_or(self.sums), ..self }
    }

    /// The record of Gaussian `i`, its weights in units of the mean importance.
    pub(crate) fn get(&self, i: u32) -> Record {
        let Self { records, sums } = self;
        let scale = |sum: f64| if sum > 0.0 { sums.count as f64 / sum } else { 1.0 };
        let mut record = records[i as usize];
        record.geometry *= scale(sums.geometry);
        record.importance *= scale(sums.importance);
        record
    }
}

/// Writes the records of up to [`BLOCK`] Gaussians from `first` on. Returns the sum of their
/// importances, and that of geometry times area.
#[multiversion(targets("x86_64+avx2"))]
fn fill(
    records: &mut [Record],
    scene: &Scene,
    importance: &Importance,
    size_exponent: f64,
    first: usize,
) -> [f64; 2] {
    let n = records.len();
    let range = first..first + n;
    let sh_len = scene.sh_len();
    // Loops over plain arrays, which the compiler turns into vector instructions.
    let mut l = [[0.0f32; BLOCK]; 3];
    for (i, log_scale) in scene.log_scales[range.clone()].iter().enumerate() {
        (0..3).for_each(|k| l[k][i] = log_scale[k]);
    }
    let mut s = [[0.0f64; BLOCK]; 3];
    for k in 0..3 {
        for i in 0..BLOCK {
            s[k][i] = scale(l[k][i]);
        }
    }
    let mut areas = [1.0f64; BLOCK];
    for i in 0..BLOCK {
        areas[i] = area([s[0][i], s[1][i], s[2][i]]);
    }
    areas[n..].fill(1.0);
    let mut weight = [0.0f64; BLOCK];
    match importance {
        Importance::OpacityArea => {
            let mut logits = [0.0; BLOCK];
            logits[..n].copy_from_slice(&scene.opacity_logits[range.clone()]);
            for i in 0..BLOCK {
                weight[i] = opacity(logits[i]) * areas[i];
            }
        }
        Importance::Given(given) => {
            for (w, &g) in weight.iter_mut().zip(&given[range.clone()]) {
                *w = f64::from(g);
            }
        }
    }
    let mut geometry = areas;
    power(&mut geometry, size_exponent);
    geometry.iter_mut().zip(&weight).for_each(|(g, w)| *g *= w);
    let roots = roots(&scene.rotations[range], &s);
    let mut sums = [0.0; 2];
    for (i, record) in records.iter_mut().enumerate() {
        sums[0] += weight[i];
        sums[1] += geometry[i] * areas[i];
        *record = Record {
            root: std::array::from_fn(|e| roots[e][i]),
            mean: scene.means[first + i],
            colour: scene.sh[(first + i) * sh_len],
            geometry: geometry[i],
            importance: weight[i],
        };
    }
    sums
}

/// `R diag(s) R^T` of up to [`BLOCK`] rotations and scales. It is computed in `f32`, for more
/// Gaussians per vector instruction; the differences between the members of a leaf are far above
/// its rounding.
#[inline(always)]
fn roots(rotations: &[[f32; 4]], scales: &[[f64; BLOCK]; 3]) -> [[f32; BLOCK]; 6] {
    let mut q = [[0.0f32; BLOCK]; 4];
    let mut s = [[0.0f32; BLOCK]; 3];
    for (i, rotation) in rotations.iter().enumerate() {
        (0..4).for_each(|k| q[k][i] = rotation[k]);
    }
    for k in 0..3 {
        for i in 0..BLOCK {
            s[k][i] = scales[k][i].min(WIDEST) as f32;
        }
    }
    let mut roots = [[0.0f32; BLOCK]; 6];
    let mut norms = [0.0f32; BLOCK];
    for i in 0..BLOCK {
        let [w, x, y, z] = [0, 1, 2, 3].map(|k| q[k][i]);
        norms[i] = w * w + x * x + y * y + z * z;
        let r = scaled_rotation([w, x, y, z], 2.0 / norms[i]);
        for (e, (a, b)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].into_iter().enumerate()
        {
            roots[e][i] = r[a][0] * s[0][i] * r[b][0]
                + r[a][1] * s[1][i] * r[b][1]
                + r[a][2] * s[2][i] * r[b][2];
        }
    }
    // Zero quaternions, and those whose squared norm is outside the range of f32.
    for (i, q) in rotations.iter().enumerate() {
        if !(1e-20..1e20).contains(&norms[i]) {
            let s = [0, 1, 2].map(|k| scales[k][i].min(WIDEST));
            let root = axes_product(&rotation(*q), s);
            (0..6).for_each(|e| roots[e][i] = root[e] as f32);
        }
    }
    roots
}

/// Raises areas to the power of `-p`. The common exponents need square roots only.
#[inline(always)]
fn power(areas: &mut [f64], p: f64) {
    match p {
        0.0 => areas.fill(1.0),
        1.0 => areas.iter_mut().for_each(|a| *a = a.recip()),
        0.75 => areas.iter_mut().for_each(|a| *a = (*a * a.sqrt()).sqrt().recip()),
        1.5 => areas.iter_mut().for_each(|a| *a = (*a * a.sqrt()).recip()),
        _ => areas.iter_mut().for_each(|a| *a = libm::pow(*a, -p)),
    }
}
