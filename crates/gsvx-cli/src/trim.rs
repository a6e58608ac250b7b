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
