//! Section 3: voxelization. Uniform (3.1) and adaptive (3.2) are strategies of the crate `voxel`, whose
//! `paper.rs` has the criteria; the merging by which the attributes of a voxel are initialised (3.3) is in
//! its `merge/paper.rs`.

use gs_model::Scene;
use voxel::{Merge, Strategy, Voxelization};

use crate::error::Result;

/// A voxelized scene: the paper's list of Gaussians at voxel centres.
#[derive(Clone, Debug)]
pub struct PaperVoxels {
    /// One Gaussian per leaf, in leaf order, at the leaf's centre. A fine-tune may change everything
    /// but the means.
    pub scene: Scene,
    /// The leaves of the octree.
    pub voxels: Voxelization,
}

/// Divides the bounding cube of the means by `strategy` and makes one Gaussian of those in each voxel:
/// SH coefficients and opacities are averaged, the covariance is that of the largest.
///
/// The paper's strategies are [`Strategy::Uniform`] and [`Strategy::paper`].
///
/// # Errors
/// [`Error::Voxelization`](crate::Error::Voxelization).
pub fn voxelize(scene: &Scene, strategy: &Strategy) -> Result<PaperVoxels> {
    let voxels = voxel::voxelize(scene, &voxel::cube_of(&scene.means)?, strategy)?;
    let scene = voxel::merge(scene, &voxels, Merge::Paper)?;
    Ok(PaperVoxels { scene, voxels })
}
