//! Consecutive Gaussians of a scene, to be filled in.

use crate::error::{Error, Result};
use gs_model::Scene;

/// The arrays of some Gaussians.
pub(crate) struct GaussiansMut<'a> {
    pub(crate) means: &'a mut [[f32; 3]],
    pub(crate) rotations: &'a mut [[f32; 4]],
    pub(crate) log_scales: &'a mut [[f32; 3]],
    pub(crate) opacity_logits: &'a mut [f32],
    /// The same number of coefficients for each.
    pub(crate) sh: &'a mut [[f32; 3]],
}

impl<'a> GaussiansMut<'a> {
    /// All Gaussians of a scene.
    pub(crate) fn of(scene: &'a mut Scene) -> Self {
        let Scene { means, rotations, log_scales, opacity_logits, sh, .. } = scene;
        Self { means, rotations, log_scales, opacity_logits, sh }
    }

    pub(crate) fn len(&self) -> usize {
        self.means.len()
    }

    /// The first `n` and the others.
    #[cfg(feature = "encode")]
    pub(crate) fn split_at(self, n: usize) -> (Self, Self) {
        let sh_len = self.sh.len() / self.means.len().max(1);
        let (means, means_rest) = self.means.split_at_mut(n);
        let (rotations, rotations_rest) = self.rotations.split_at_mut(n);
        let (log_scales, log_scales_rest) = self.log_scales.split_at_mut(n);
        let (opacity_logits, opacity_logits_rest) = self.opacity_logits.split_at_mut(n);
        let (sh, sh_rest) = self.sh.split_at_mut(n * sh_len);
        let rest = Self {
            means: means_rest,
            rotations: rotations_rest,
            log_scales: log_scales_rest,
            opacity_logits: opacity_logits_rest,
            sh: sh_rest,
        };
        (Self { means, rotations, log_scales, opacity_logits, sh }, rest)
    }

    /// Copies as many Gaussians from `first` on; coefficients beyond those of `scene` become 0.
    pub(crate) fn copy_from(&mut self, scene: &Scene, first: usize) {
        let range = first..first + self.len();
        self.means.copy_from_slice(&scene.means[range.clone()]);
        self.rotations.copy_from_slice(&scene.rotations[range.clone()]);
        self.log_scales.copy_from_slice(&scene.log_scales[range.clone()]);
        self.opacity_logits.copy_from_slice(&scene.opacity_logits[range.clone()]);
        let sh_len = self.sh.len() / self.len().max(1);
        for (out, i) in self.sh.chunks_exact_mut(sh_len.max(1)).zip(range) {
            let from = scene.sh_of(i);
            let common = from.len().min(sh_len);
            out[..common].copy_from_slice(&from[..common]);
            out[common..].fill([0.0; 3]);
        }
    }
}

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
