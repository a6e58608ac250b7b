//! Which Gaussians lossy coding can hold.

use crate::error::{Error, Result};
use gs_model::Scene;
use gs_model::validate::LARGEST;

/// Checks that Gaussians are what lossy coding can hold; `first` is the number of the first, for the error.
pub(crate) fn check(scene: &Scene, first: usize) -> Result<()> {
    let each = |field: &'static str, bad: &dyn Fn(usize) -> bool| match (0..scene.len())
        .find(|&i| bad(i))
    {
        Some(i) => Err(Error::NonFinite { index: first + i, field }),
        None => Ok(()),
    };
    each("mean", &|i| !scene.means[i].iter().all(|v| v.is_finite()))?;
    each("opacity", &|i| !scene.opacity_logits[i].is_finite())?;
    each("rotation", &|i| !scene.rotations[i].iter().all(|v| v.is_finite()))?;
    if let Some(i) = scene.rotations.iter().position(|&q| q == [0.0; 4]) {
        return Err(Error::ZeroRotation { index: first + i });
    }
    each("log-scale", &|i| !scene.log_scales[i].iter().all(|v| v.is_finite()))?;
    let fits = |field, values: &dyn Fn(usize) -> Vec<f32>| {
        for i in 0..scene.len() {
            if let Some(&value) = values(i).iter().find(|v| v.abs() > LARGEST) {
                return Err(Error::TooLarge { index: first + i, field, value, limit: LARGEST });
            }
        }
        Ok(())
    };
    fits("log-scale", &|i| scene.log_scales[i].to_vec())?;
    check_sh(&scene.sh, scene.sh_len(), first)
}

/// Checks that SH coefficients, `each` per Gaussian, are what lossy coding can hold.
pub(crate) fn check_sh(sh: &[[f32; 3]], each: usize, first: usize) -> Result<()> {
    let field = "SH coefficient";
    for (i, sh) in sh.chunks_exact(each).enumerate() {
        let index = first + i;
        for &value in sh.as_flattened() {
            if !value.is_finite() {
                return Err(Error::NonFinite { index, field });
            }
            if value.abs() > LARGEST {
                return Err(Error::TooLarge { index, field, value, limit: LARGEST });
            }
        }
    }
    Ok(())
}
