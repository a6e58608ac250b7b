//! [`voxelize`]: from Gaussians and a strategy to the leaves of a pruned octree (the paper's
//! sections 3.1 and 3.2).

use gs_model::Scene;

use crate::cube::check_cube;
use crate::error::Result;
use crate::order::MortonOrder;
use crate::paper;
use crate::pruning::prune;
use crate::released::released;
use crate::strategy::Strategy;
use crate::voxelization::Voxelization;
use gpcc_lite::Cube;

/// Divides `cube` by `strategy` and assigns every Gaussian of `scene` to the leaf that
/// contains its mean.
///
/// The time is that of one sort, plus a part that is linear in the number of Gaussians times
/// the number of depths. The result does not depend on the number of threads. An empty scene gives
/// no leaf.
///
/// # Errors
/// [`Error::OutsideCube`](crate::Error::OutsideCube) and
/// [`Error::NonFiniteMean`](crate::Error::NonFiniteMean) give the index of the first such
/// Gaussian; other errors name the parameter that is out of range.
pub fn voxelize(scene: &Scene, cube: &Cube, strategy: &Strategy) -> Result<Voxelization> {
    strategy.validate()?;
    check_cube(cube)?;
    // One scope for all parallel loops, so that the threads wake up once.
    rayon::scope(|_| match strategy {
        &Strategy::Uniform { depth } => {
            let order = MortonOrder::of(scene, cube, depth)?;
            Voxelization::from_depths(*cube, depth, order, vec![depth; scene.len()])
        }
        &Strategy::Paper { large_percent, j_low, j_high, tau1, tau2 } => {
            let order = MortonOrder::of(scene, cube, j_high)?;
            let large = paper::large(scene, large_percent);
            let rule = paper::PaperRule { scene, cube, large: &large, j_low, j_high, tau1, tau2 };
            let depths = rule.depths(&order);
            Voxelization::from_depths(*cube, j_high, order, depths)
        }
        Strategy::Released(options) => released(scene, options),
        Strategy::RateDistortion(options) => prune(scene, cube, options, &(0..u64::MAX), None),
    })
}
