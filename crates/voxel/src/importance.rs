//! [`Importance`]: how much each Gaussian counts.

use gs_model::Scene;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::parallel::CHUNK;

/// How much each Gaussian counts in the distortion, and in the mean of a leaf.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Importance {
    /// Opacity times area. It stands for the part of the images that a Gaussian makes up, as if
    /// nothing hid it and all Gaussians were at one distance.
    #[default]
    OpacityArea,
    /// One entry per Gaussian, finite and not negative; only ratios count. Meant for the
    /// rasterizer's sum of squared blending weights over pixels and views, which takes distance
    /// and occlusion into account.
    Given(Vec<f32>),
}

impl Importance {
    /// Checks that there is one entry per Gaussian, each finite and not negative.
    pub(crate) fn validate(&self, scene: &Scene) -> Result<()> {
        let Self::Given(given) = self else { return Ok(()) };
        if given.len() != scene.len() {
            let (got, want) = (given.len(), scene.len());
            return Err(Error::Length { name: "importance", got, want });
        }
        let good = |w: f32| (0.0..f32::INFINITY).contains(&w);
        let first_bad = |chunk: &[f32]| {
            // This loop has no branch. The search runs only if it found something.
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
