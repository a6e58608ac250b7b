//! The memory of Gaussians, and derivatives by them.

use crate::error::{Error, Result};
use gs_model::Scene;

/// Gives a scene `n` Gaussians whose values are unspecified.
///
/// # Errors
/// [`Error::Memory`].
pub(crate) fn resize(scene: &mut Scene, n: usize) -> Result<()> {
    scene.try_reserve(n.saturating_sub(scene.len())).map_err(|_| Error::memory(n))?;
    let sh = n * scene.sh_len();
    scene.means.resize(n, [0.0; 3]);
    scene.rotations.resize(n, [0.0; 4]);
    scene.log_scales.resize(n, [0.0; 3]);
    scene.opacity_logits.resize(n, 0.0);
    scene.sh.resize(sh, [0.0; 3]);
    Ok(())
}

/// Derivatives of a loss by the arrays of one Gaussian of a scene.
#[cfg(feature = "encode")]
#[derive(Clone, Copy, Debug)]
pub struct GaussianGradient<'a> {
    /// By its opacity logit.
    pub opacity_logit: f32,
    /// By its SH coefficients.
    pub sh: &'a [[f32; 3]],
    /// By its log-scales.
    pub log_scale: [f32; 3],
    /// By its quaternion.
    pub rotation: [f32; 4],
}
