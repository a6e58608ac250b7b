//! [`voxelize`]: from Gaussians and a strategy to the leaves of a pruned octree (the paper's
//! sections 3.1 and 3.2).

use gs_model::Scene;
use std::ops::Range;

use crate::check::check_cube;
use crate::error::Result;
use crate::order::MortonOrder;
use crate::paper;
use crate::pruning::prune;
use crate::record::WeightSums;
use crate::released::released;
use crate::strategy::Strategy;
use crate::voxelization::{PrunedOctree, Voxelization};
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
    voxelize_tile(scene, cube, strategy, &(0..u64::MAX), None)
}

/// As [`voxelize`], for one tile of a larger scene: `scene` holds the Gaussians of the tile `codes` of
/// [`Tiles`](crate::Tiles), whose Morton codes are at the strategy's `j_high`. `sums` scale the weights of
/// [`Strategy::RateDistortion`], or those of this scene do. That strategy divides cells that reach beyond the tile;
/// the others do not know tiles.
///
/// # Errors
/// As [`voxelize`].
pub fn voxelize_tile(
    scene: &Scene,
    cube: &Cube,
    strategy: &Strategy,
    codes: &Range<u64>,
    sums: Option<WeightSums>,
) -> Result<Voxelization> {
    strategy.validate()?;
    check_cube(cube)?;
    // One scope for all parallel loops, so that the threads wake up once.
    rayon::scope(|_| {
        Voxelization::of(match strategy {
            &Strategy::Uniform { depth } => {
                let order = MortonOrder::of(scene, cube, depth)?;
                PrunedOctree { cube: *cube, j_high: depth, order, depths: vec![depth; scene.len()] }
            }
            &Strategy::Paper { large_percent, j_low, j_high, tau1, tau2 } => {
                let order = MortonOrder::of(scene, cube, j_high)?;
                let large = &paper::large(scene, large_percent);
                let rule = paper::PaperRule { scene, cube, large, j_low, j_high, tau1, tau2 };
                let depths = rule.depths(&order);
                PrunedOctree { cube: *cube, j_high, order, depths }
            }
            Strategy::Released(options) => released(scene, options)?,
            Strategy::RateDistortion(options) => prune(scene, cube, options, codes, sums)?,
        })
    })
}
