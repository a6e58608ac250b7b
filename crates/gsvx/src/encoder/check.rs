//! What the encoder refuses before it begins.

use crate::chunk;
use crate::error::{Error, Result};
use crate::head::Steps;
use gpcc_lite::Octree;
use gs_model::Scene;
use rayon::prelude::*;

/// Refuses a number of things that is not the one needed.
pub(crate) fn check_length(what: &'static str, found: usize, expected: usize) -> Result<()> {
    if found == expected { Ok(()) } else { Err(Error::Length { what, found, expected }) }
}

/// All arrays of a scene have the lengths that its number of Gaussians and its SH degree ask for.
pub(crate) fn check_lengths(scene: &Scene) -> Result<()> {
    let n = scene.len();
    if scene.sh_degree > 3 {
        let value = f64::from(scene.sh_degree);
        return Err(Error::Option { option: "SH degree", value, range: "0 to 3" });
    }
    if let Some(&value) = scene.origin.iter().find(|v| !v.is_finite()) {
        return Err(Error::Option { option: "the origin", value, range: "finite" });
    }
    check_length("opacity logits", scene.opacity_logits.len(), n)?;
    check_length("log-scales", scene.log_scales.len(), n)?;
    check_length("rotations", scene.rotations.len(), n)?;
    check_length("SH coefficients", scene.sh.len(), n * scene.sh_len())
}

/// There is one Gaussian for each leaf, at its centre.
pub(crate) fn check_centres(scene: &Scene, octree: &Octree) -> Result<()> {
    check_length("Gaussians of the leaves", scene.len(), octree.len())?;
    let off_centre = |(leaf, mean): (usize, &[f32; 3])| octree.centre(leaf) != *mean;
    let pairs = scene.means.par_iter().enumerate().with_min_len(4096);
    match pairs.position_first(off_centre) {
        Some(index) => Err(Error::OffCentre { index }),
        None => Ok(()),
    }
}

/// Checks that lossy coding can hold the values of a scene, of its SH up to a degree. `first` is the number of its first
/// Gaussian, for the error.
///
/// # Errors
/// [`Error::NonFinite`], [`Error::ZeroRotation`], [`Error::TooLarge`]; [`Error::Length`] for arrays that do not fit.
pub fn check_values(scene: &Scene, max_sh_degree: u8, first: usize) -> Result<()> {
    check_lengths(scene)?;
    if scene.sh_degree <= max_sh_degree {
        return chunk::check(scene, first);
    }
    let mut cut = scene.clone();
    cut.cut_sh(max_sh_degree);
    chunk::check(&cut, first)
}

/// The error of coding, which sorts and merges, about the Gaussian of the input that is at fault.
pub(crate) fn about_input(error: Error, scene: &Scene, max_sh_degree: u8) -> Error {
    match error {
        Error::NonFinite { .. }
        | Error::ZeroRotation { .. }
        | Error::TooLarge { .. }
        | Error::InvalidOutlier { .. } => {
            check_values(scene, max_sh_degree, 0).err().unwrap_or(error)
        }
        other => other,
    }
}

/// Steps that a decoder accepts.
pub(crate) fn check_steps(steps: &Steps) -> Result<()> {
    match steps.all().into_iter().find(|&step| !Steps::is_valid(step)) {
        Some(step) => Err(Error::Option {
            option: "quantisation step",
            value: step.into(),
            range: "above 1.2e-38 and below 1e9",
        }),
        None => Ok(()),
    }
}

/// Outliers that fit leaves of this SH degree; `None` if there are none.
pub(crate) fn checked_outliers(outliers: Option<&Scene>, sh_degree: u8) -> Result<Option<&Scene>> {
    let Some(outliers) = outliers.filter(|o| !o.is_empty()) else { return Ok(None) };
    if outliers.sh_degree > sh_degree {
        return Err(Error::Option {
            option: "SH degree of the outliers",
            value: outliers.sh_degree.into(),
            range: "at most that of the leaves",
        });
    }
    check_lengths(outliers)?;
    match outliers.invalid() {
        Some(first) => Err(Error::InvalidOutlier { index: first.index, field: first.field }),
        None => Ok(Some(outliers)),
    }
}

/// The highest degree, up to `most`, with a coefficient that is not zero.
pub(crate) fn used_degree(scene: &Scene, most: u8) -> u8 {
    let mut degree = scene.sh_degree.min(most);
    if scene.is_empty() {
        return degree;
    }
    let zero = |v: &[f32; 3]| v.iter().all(|&x| x == 0.0);
    while degree > 0 {
        let d = usize::from(degree);
        let own = |sh: &[[f32; 3]]| sh[d * d..(d + 1) * (d + 1)].iter().all(zero);
        if !scene.sh.par_chunks(scene.sh_len()).all(own) {
            break;
        }
        degree -= 1;
    }
    degree
}
