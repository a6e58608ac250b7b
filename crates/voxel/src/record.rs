//! [`Records`]: what the rate-distortion strategy needs of every Gaussian, computed once.

use gs_model::Scene;
use rayon::prelude::*;

use crate::error::Result;
use crate::gaussian::{area, congruence, opacity, rotation, scale};
use crate::importance::Importance;

/// One Gaussian. A cache line: the members of a cell lie all over the scene, and each of the
/// scene's arrays would be another miss. (Roots and colours are asked of one Gaussian in four
/// only, but to fetch those from the scene takes longer than to compute all of them in its order.)
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(crate) struct Record {
    /// Square root of the covariance, world units, to some 1e-6 of the greatest scale.
    pub(crate) root: [f32; 6],
    pub(crate) mean: [f32; 3],
    /// DC coefficients.
    pub(crate) colour: [f32; 3],
    /// What a squared length of displacement or change of shape counts.
    pub(crate) geometry: f64,
    /// What a squared difference of colours counts.
    pub(crate) importance: f64,
}

/// Gaussians per block. Fixed: the sums are added block by block.
const BLOCK: usize = 64;

/// Standard deviations count as at most this in `root`, whose entries are `f32`.
const WIDEST: f64 = 1e37;

#[derive(Clone, Debug)]
struct Block {
    records: [Record; BLOCK],
    /// Sum of importances; sum of geometry times area.
    sums: [f64; 2],
}

/// The records of a scene, and the factors that bring their weights to units of the mean
/// importance.
#[derive(Clone, Debug)]
pub(crate) struct Records {
    blocks: Vec<Block>,
    per_importance: f64,
    per_geometry: f64,
}

impl Records {
    /// `size_exponent` p turns importance I into `geometry = I / area^p`. A displacement by d of
    /// a Gaussian of area A on the screen changes about `I d^2 / A` of the image, which is
    /// p = 1. Weights come out such that the sum of importances, and that of geometry times
    /// area, is the number of Gaussians.
    pub(crate) fn of(scene: &Scene, importance: &Importance, size_exponent: f64) -> Result<Self> {
        importance.validate(scene)?;
        let len = scene.len();
        let blocks: Vec<Block> = (0..len.div_ceil(BLOCK))
            .into_par_iter()
            .map(|b| Block::of(scene, importance, size_exponent, b * BLOCK))
            .collect();
        let sums = blocks.iter().fold([0.0; 2], |s, b| [s[0] + b.sums[0], s[1] + b.sums[1]]);
        let scale = |sum: f64| if sum > 0.0 { len as f64 / sum } else { 1.0 };
        Ok(Self { blocks, per_importance: scale(sums[0]), per_geometry: scale(sums[1]) })
    }

    pub(crate) fn get(&self, i: u32) -> Record {
        let mut record = self.blocks[i as usize / BLOCK].records[i as usize % BLOCK];
        record.geometry *= self.per_geometry;
        record.importance *= self.per_importance;
        record
    }
}

impl Block {
    /// The records of up to [`BLOCK`] Gaussians from `first` on.
    fn of(scene: &Scene, importance: &Importance, size_exponent: f64, first: usize) -> Self {
        let range = first..scene.len().min(first + BLOCK);
        let n = range.len();
        let sh_len = scene.sh_len();
        // In loops over plain arrays, which the compiler turns into vector instructions.
        let mut s = [[0.0f64; 3]; BLOCK];
        let log_scales = scene.log_scales[range.clone()].as_flattened();
        for (s, &l) in s.as_flattened_mut().iter_mut().zip(log_scales) {
            *s = scale(l);
        }
        let mut areas = [1.0f64; BLOCK];
        areas[..n].iter_mut().zip(&s).for_each(|(a, s)| *a = area(*s));
        let mut weight = [0.0f64; BLOCK];
        match importance {
            Importance::OpacityArea => {
                for (w, &logit) in weight.iter_mut().zip(&scene.opacity_logits[range.clone()]) {
                    *w = opacity(logit);
                }
                weight[..n].iter_mut().zip(&areas).for_each(|(w, a)| *w *= a);
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
        let mut out = Self { records: [Record::default(); BLOCK], sums: [0.0; 2] };
        for i in 0..n {
            out.sums[0] += weight[i];
            out.sums[1] += geometry[i] * areas[i];
            out.records[i] = Record {
                root: roots[i],
                mean: scene.means[first + i],
                colour: scene.sh[(first + i) * sh_len],
                geometry: geometry[i],
                importance: weight[i],
            };
        }
        out
    }
}

/// `R diag(s) R^T` of up to [`BLOCK`] rotations and scales, in `f32` and for four at a time in
/// vector instructions: what differs between the members of a leaf is far above its rounding.
fn roots(rotations: &[[f32; 4]], scales: &[[f64; 3]; BLOCK]) -> [[f32; 6]; BLOCK] {
    let mut q = [[0.0f32; BLOCK]; 4];
    let mut s = [[0.0f32; BLOCK]; 3];
    for (i, rotation) in rotations.iter().enumerate() {
        (0..4).for_each(|k| q[k][i] = rotation[k]);
        (0..3).for_each(|k| s[k][i] = scales[i][k].min(WIDEST) as f32);
    }
    let mut roots = [[0.0f32; BLOCK]; 6];
    for i in 0..BLOCK {
        let [w, x, y, z] = [q[0][i], q[1][i], q[2][i], q[3][i]];
        let two = 2.0 / (w * w + x * x + y * y + z * z);
        let r = [
            [1.0 - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
            [two * (x * y + w * z), 1.0 - two * (x * x + z * z), two * (y * z - w * x)],
            [two * (x * z - w * y), two * (y * z + w * x), 1.0 - two * (x * x + y * y)],
        ];
        for (e, (a, b)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].into_iter().enumerate()
        {
            roots[e][i] = r[a][0] * s[0][i] * r[b][0]
                + r[a][1] * s[1][i] * r[b][1]
                + r[a][2] * s[2][i] * r[b][2];
        }
    }
    let mut out: [[f32; 6]; BLOCK] = std::array::from_fn(|i| roots.map(|root| root[i]));
    // Quaternions whose norm is no f32, and the zero one.
    for ((out, q), s) in out.iter_mut().zip(rotations).zip(scales) {
        let norm: f32 = q.iter().map(|x| x * x).sum();
        if !(1e-20..1e20).contains(&norm) {
            *out = congruence(&rotation(*q), s.map(|x| x.min(WIDEST))).map(|x| x as f32);
        }
    }
    out
}

/// Raises areas to the power of `-p`, without the detour through logarithms for the common
/// exponents.
fn power(areas: &mut [f64], p: f64) {
    match p {
        0.0 => areas.fill(1.0),
        1.0 => areas.iter_mut().for_each(|a| *a = a.recip()),
        0.75 => areas.iter_mut().for_each(|a| *a = (*a * a.sqrt()).sqrt().recip()),
        1.5 => areas.iter_mut().for_each(|a| *a = (*a * a.sqrt()).recip()),
        _ => areas.iter_mut().for_each(|a| *a = libm::pow(*a, -p)),
    }
}
