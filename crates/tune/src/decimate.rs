//! [`decimate`]: fewer Gaussians by what cameras see.

use crate::encode::{CameraDoubt, CameraEvidence, EncodeEvent, go_on};
use crate::error::Result;
use finetune::doubted_loss;
use gs_model::{Camera, Scene, View};
use std::ops::ControlFlow;

/// A scene of fewer Gaussians.
#[derive(Debug)]
pub struct DecimateOutcome {
    /// The Gaussians.
    pub scene: Scene,
    /// Why the cameras may not be the model's own.
    pub doubts: Vec<CameraDoubt>,
}

/// Merges a scene to at most `most` Gaussians by [`gsvx::decimate`]. What the training `cameras` see, as pinholes, becomes
/// importance, unless the `photos` show something else, or the result shows well to the cameras and badly to views
/// that do not depend on them. `progress` ends the work where it breaks.
///
/// # Errors
/// Those of [`gsvx::decimate`]; [`crate::Error::NothingSeen`] if the cameras see nothing.
pub fn decimate(
    scene: &Scene,
    most: usize,
    cameras: Option<&[Camera]>,
    photos: &[View],
    mut progress: impl FnMut(EncodeEvent<'_>) -> ControlFlow<()>,
) -> Result<DecimateOutcome> {
    let mut tell = |event: EncodeEvent<'_>| go_on(progress(event));
    let CameraEvidence { importance, mut doubts, proven, .. } =
        CameraEvidence::of(scene, cameras, photos, false, &mut tell)?;
    let mut made = gsvx::decimate(scene, importance.as_deref(), most)?;
    if let Some(cameras) = cameras.filter(|_| importance.is_some() && !proven)
        && let Some(loss) = doubted_loss(scene, &made, cameras)
    {
        doubts.push(CameraDoubt::Misfit(loss));
        made = gsvx::decimate(scene, None, most)?;
    }
    Ok(DecimateOutcome { scene: made, doubts })
}
