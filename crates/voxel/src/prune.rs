//! [`prune`]: Gaussians that no image needs, found before anything is voxelized.

use gs_model::Scene;

use crate::error::{Error, Result};
use crate::gaussian::opacity;

/// Rasterizers skip what covers less than this of a pixel, so a Gaussian whose opacity is
/// below it is never drawn (Inria's cut).
pub const ALPHA_CUT: f64 = 1.0 / 255.0;

/// Which Gaussians [`prune`] leaves out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Prune {
    /// Leave out Gaussians of an opacity below [`ALPHA_CUT`]. Changes no image.
    pub transparent: bool,
    /// Leave out Gaussians whose saliency (one entry each) is at most the threshold. With the
    /// rasterizer's saliency over all training views and threshold 0, no training view changes.
    pub saliency: Option<(Vec<f32>, f32)>,
}

/// What [`prune`] kept and why the rest went.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pruned {
    /// Ascending indices of the Gaussians to keep; for [`Scene::select`].
    pub kept: Vec<usize>,
    /// Number left out because they are transparent.
    pub transparent: usize,
    /// Number left out because of their saliency, of those that are not transparent.
    pub unseen: usize,
}

/// Finds the Gaussians worth keeping.
///
/// # Errors
/// [`Error::Length`] if the saliency does not fit the scene.
pub fn prune(scene: &Scene, options: &Prune) -> Result<Pruned> {
    if let Some((saliency, _)) = &options.saliency
        && saliency.len() != scene.len()
    {
        let (got, want) = (saliency.len(), scene.len());
        return Err(Error::Length { name: "saliency", got, want });
    }
    let mut out = Pruned::default();
    for (i, &logit) in scene.opacity_logits.iter().enumerate() {
        if options.transparent && opacity(logit) < ALPHA_CUT {
            out.transparent += 1;
        } else if options.saliency.as_ref().is_some_and(|(s, threshold)| s[i] <= *threshold) {
            out.unseen += 1;
        } else {
            out.kept.push(i);
        }
    }
    Ok(out)
}
