//! `--trim`: floaters so far away that everyone else would lose octree levels.

use anyhow::{Context, Result};
use gs_model::Scene;

/// What becomes of floaters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Trim {
    /// Coded exactly where that is cheaper.
    Auto,
    /// Kept in the octree.
    Off,
}

impl Trim {
    /// Takes the floaters out of `scene`, and out of the importances `seen`; `None` if there are
    /// none.
    pub(crate) fn split(
        self,
        scene: &mut Scene,
        seen: Option<&mut Vec<f32>>,
        name: impl FnOnce() -> String,
    ) -> Result<Option<Scene>> {
        let split = match self {
            Self::Auto => gsvx::split_outliers(scene).with_context(name)?,
            Self::Off => None,
        };
        Ok(split.map(|split| {
            if let Some(seen) = seen {
                *seen = split.inside.iter().map(|&i| seen[i]).collect();
            }
            let outliers = scene.select(&split.outliers);
            *scene = scene.select(&split.inside);
            outliers
        }))
    }
}

/// Adds the floaters after the Gaussians of the leaves.
pub(crate) fn append(scene: &mut Scene, outliers: &Scene) {
    scene.means.extend_from_slice(&outliers.means);
    scene.rotations.extend_from_slice(&outliers.rotations);
    scene.log_scales.extend_from_slice(&outliers.log_scales);
    scene.opacity_logits.extend_from_slice(&outliers.opacity_logits);
    scene.sh.extend_from_slice(&outliers.sh);
}

/// Undoes [`append`]: the Gaussians from `leaves` on.
pub(crate) fn take_off(scene: &mut Scene, leaves: usize) -> Option<Scene> {
    if leaves >= scene.len() {
        return None;
    }
    let outliers = scene.select(&(leaves..scene.len()).collect::<Vec<_>>());
    *scene = scene.select(&(0..leaves).collect::<Vec<_>>());
    Some(outliers)
}
