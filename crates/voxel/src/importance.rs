//! [`Importance`]: what each Gaussian counts.

use gs_model::Scene;
use rayon::prelude::*;

use crate::error::{Error, Result};

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
        match given.par_iter().find_first(|w| !(w.is_finite() && **w >= 0.0)) {
            Some(&bad) => Err(Error::Parameter {
                name: "importance",
                value: f64::from(bad),
                range: "0 upwards, finite",
            }),
            None => Ok(()),
        }
    }
}
