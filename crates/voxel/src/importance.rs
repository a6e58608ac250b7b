//! [`Importance`]: what each Gaussian counts.

use gs_model::Scene;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::gaussian::{area, opacity, scales};
use crate::order::CHUNK;
use crate::stats::Weights;

/// What each Gaussian counts in the distortion.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Importance {
    /// Opacity times area: the image energy where nothing covers it, at equal distances.
    #[default]
    OpacityArea,
    /// One entry per Gaussian, finite and not negative; in any one unit. Meant for the
    /// rasterizer's sum of squared blending weights over pixels and views, which knows distance
    /// and occlusion.
    Given(Vec<f32>),
}

impl Importance {
    /// Importance of Gaussian `i`.
    pub(crate) fn of(&self, scene: &Scene, i: usize) -> f64 {
        match self {
            Self::OpacityArea => {
                opacity(scene.opacity_logits[i]) * area(scales(scene.log_scales[i]))
            }
            Self::Given(given) => f64::from(given[i]),
        }
    }

    /// Checks that there is one finite entry, not negative, per Gaussian.
    pub(crate) fn validate(&self, scene: &Scene) -> Result<()> {
        let Self::Given(given) = self else { return Ok(()) };
        if given.len() != scene.len() {
            let (got, want) = (given.len(), scene.len());
            return Err(Error::Length { name: "importance", got, want });
        }
        match given.iter().find(|w| !(w.is_finite() && **w >= 0.0)) {
            Some(&bad) => Err(Error::Parameter {
                name: "importance",
                value: f64::from(bad),
                range: "0 upwards, finite",
            }),
            None => Ok(()),
        }
    }
}

/// Weights of every Gaussian, such that `geometry * area + feature`-type sums are in units of
/// the mean importance.
///
/// `size_exponent` p turns importance I into `geometry = I / area^p`. A displacement by d of a
/// Gaussian of area A on the screen changes about `I d^2 / A` of the image, which is p = 1.
pub(crate) fn weights(
    scene: &Scene,
    importance: &Importance,
    size_exponent: f64,
) -> Result<Vec<Weights>> {
    let len = scene.len();
    importance.validate(scene)?;
    let mut out = vec![Weights::default(); len];
    // Sums per fixed chunk, added in order: they must not depend on the threads.
    let sums: Vec<(f64, f64)> = out
        .par_chunks_mut(CHUNK)
        .enumerate()
        .map(|(chunk, out)| {
            let mut sums = (0.0, 0.0);
            for (i, w) in out.iter_mut().enumerate() {
                let i = chunk * CHUNK + i;
                let area = area(scales(scene.log_scales[i]));
                let importance = match importance {
                    Importance::OpacityArea => opacity(scene.opacity_logits[i]) * area,
                    Importance::Given(given) => f64::from(given[i]),
                };
                let geometry = importance * power(area, size_exponent);
                *w = Weights { geometry, feature: importance };
                sums.0 += importance;
                sums.1 += geometry * area;
            }
            sums
        })
        .collect();
    let (total, energy) = sums.iter().fold((0.0, 0.0), |(a, b), s| (a + s.0, b + s.1));
    let scale = |sum: f64| if sum > 0.0 { len as f64 / sum } else { 1.0 };
    let (per_feature, per_geometry) = (scale(total), scale(energy));
    out.par_iter_mut().for_each(|w| {
        w.feature *= per_feature;
        w.geometry *= per_geometry;
    });
    Ok(out)
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
