//! A scene voxelized by any strategy, where [`gsvx::prepare`] knows only its own.

use gs_model::Scene;
use gsvx::Prepared;
use voxel::{Importance, Merge, Strategy};

/// Voxelizes and merges. `importance` has one entry per Gaussian.
pub(crate) fn voxelized(
    scene: &Scene,
    strategy: &Strategy,
    importance: Vec<f32>,
) -> voxel::Result<Prepared> {
    let voxels = voxel::voxelize(scene, &voxel::cube_of(&scene.means)?, strategy)?;
    let of_leaves = voxels.sums(&importance);
    let weights = Importance::Given(importance);
    let merged = voxel::Merging::new(scene, &voxels, Merge::Moments, &weights)?.scene();
    Ok(Prepared { scene: merged, voxels, importance: of_leaves, outliers: None })
}
