//! [`Importance`]: what each Gaussian counts.

use gs_model::Scene;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::order::CHUNK;

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
    /// Checks that there is one finite entry, not negative, per Gaussian.
    pub(crate) fn validate(&self, scene: &Scene) -> Result<()> {
        let Self::Given(given) = self else { return Ok(()) };
        if given.len() != scene.len() {
            let (got, want) = (given.len(), scene.len());
            return Err(Error::Length { name: "importance", got, want });
        }
        let good = |w: f32| (0.0..f32::INFINITY).contains(&w);
        let first_bad = |chunk: &[f32]| {
            // No branch in the loop that nearly always is the only one.
            let all = chunk.iter().fold(true, |all, &w| all & good(w));
            if all { None } else { chunk.iter().copied().find(|&w| !good(w)) }
        };
        match given.par_chunks(CHUNK).find_map_first(first_bad) {
            Some(bad) => Err(Error::Parameter {
                name: "importance",
                value: f64::from(bad),
                range: "0 upwards, finite",
            }),
            None => Ok(()),
        }
    }
}
