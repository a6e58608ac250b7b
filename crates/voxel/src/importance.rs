//! [`Importance`]: how much each Gaussian counts.

use gs_model::Scene;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::order::CHUNK;

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
        check_length(given, scene)?;
        let first_bad = |chunk: &[f32]| {
            // This loop has no branch. The search runs only if it found something.
            let all = chunk.iter().fold(true, |all, &w| all & is_good(w));
            if all { None } else { chunk.iter().copied().find(|&w| !is_good(w)) }
        };
        refuse(given.par_chunks(CHUNK).find_map_first(first_bad))
    }

    /// Checks the length, and the entries of `members` only. All of them are Gaussians of the scene.
    pub(crate) fn check_members(&self, scene: &Scene, members: &[u32]) -> Result<()> {
        let Self::Given(given) = self else { return Ok(()) };
        check_length(given, scene)?;
        let weights = members.par_iter().map(|&m| given[m as usize]);
        refuse(weights.find_first(|&w| !is_good(w)))
    }
}

fn is_good(weight: f32) -> bool {
    (0.0..f32::INFINITY).contains(&weight)
}

fn check_length(given: &[f32], scene: &Scene) -> Result<()> {
    let (got, want) = (given.len(), scene.len());
    if got == want { Ok(()) } else { Err(Error::Length { name: "importance", got, want }) }
}

fn refuse(bad: Option<f32>) -> Result<()> {
    let Some(bad) = bad else { return Ok(()) };
    let (name, value, range) = ("importance", f64::from(bad), "0 upwards, finite");
    Err(Error::Parameter { name, value, range })
}
