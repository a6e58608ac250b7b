//! [`Records`]: what the rate-distortion strategy needs of every Gaussian, computed once.

use gs_model::Scene;
use rayon::prelude::*;

use crate::error::Result;
use crate::gaussian::{area, congruence, opacity, rotation, scale};
use crate::importance::Importance;

/// Length of the feature vector of a Gaussian: its DC colour.
pub(crate) const FEATURES: usize = 3;

/// One Gaussian. A cache line: the members of a cell lie all over the scene, and each of the
/// scene's arrays would be another miss.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(crate) struct Record {
    /// Square root of the covariance, world units.
    pub(crate) root: [f32; 6],
    pub(crate) mean: [f32; 3],
    pub(crate) dc: [f32; FEATURES],
    /// What a squared length of displacement or change of shape counts.
    pub(crate) geometry: f64,
    /// What a squared difference of the features counts.
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
        let mut weight = [0.0f64; BLOCK];
        match importance {
            Importance::OpacityArea => {
                for (w, &logit) in weight.iter_mut().zip(&scene.opacity_logits[range.clone()]) {
                    *w = opacity(logit);
                }
                for (w, s) in weight.iter_mut().zip(&s) {
                    *w *= area(*s);
                }
            }
            Importance::Given(given) => {
                for (w, &g) in weight.iter_mut().zip(&given[range.clone()]) {
                    *w = f64::from(g);
                }
            }
        }
        let mut out = Self { records: [Record::default(); BLOCK], sums: [0.0; 2] };
        for (i, record) in out.records[..n].iter_mut().enumerate() {
            let area = area(s[i]);
            let geometry = weight[i] * power(area, size_exponent);
            out.sums[0] += weight[i];
            out.sums[1] += geometry * area;
            *record = Record {
                root: congruence(
                    &rotation(scene.rotations[first + i]),
                    s[i].map(|x| x.min(WIDEST)),
                )
                .map(|x| x as f32),
                mean: scene.means[first + i],
                dc: scene.sh[(first + i) * sh_len],
                geometry,
                importance: weight[i],
            };
        }
        out
    }
}

/// `area^-p`, without the detour through logarithms for the common exponents.
fn power(area: f64, p: f64) -> f64 {
    match p {
        0.0 => 1.0,
        1.0 => area.recip(),
        0.75 => (area * area.sqrt()).sqrt().recip(),
        1.5 => (area * area.sqrt()).recip(),
        _ => libm::pow(area, -p),
    }
}
