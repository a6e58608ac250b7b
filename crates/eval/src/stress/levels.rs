//! Levels of detail of a stream: their Gaussians are at the centres of cells that hold all leaves.

use anyhow::{Result, anyhow, ensure};
use gpcc_lite::Leaf;
use gs_model::Scene;
use gsvx::{DecodeOptions, Kind};
use voxel::Voxelization;

use super::chain::{of_degree, rows};

/// Decodes every level of a stream that was made of `voxels` and `outliers`.
///
/// # Errors
/// If a level is invalid, or is not the octree cut off at some depth.
pub(super) fn check(bytes: &[u8], voxels: &Voxelization, outliers: &Scene) -> Result<()> {
    let whole = gsvx::decode_with(bytes, &DecodeOptions::default())?;
    let coarsest = whole.index.coarsest_lod();
    let mut finer = voxels.len();
    for lod in 1..=coarsest {
        let mut options = DecodeOptions::default();
        options.lod = lod;
        let scene = gsvx::decode_with(bytes, &options)?.scene;
        scene.validate().map_err(|e| anyhow!("level {lod} has {e}"))?;
        ensure!(scene.len() >= outliers.len(), "level {lod} lacks outliers");
        let n = scene.len() - outliers.len();
        ensure!(n < finer, "level {lod} has {n} Gaussians, the finer level {finer}");
        finer = n;
        let exact = scene.select(&(n..scene.len()).collect::<Vec<_>>());
        ensure!(
            rows(&of_degree(&exact, outliers.sh_degree)) == rows(outliers),
            "an outlier of level {lod} has other bits"
        );
        let is_cut = |depth: u8| cut_off(voxels, depth) == scene.means[..n];
        ensure!((0..voxels.j_high).any(is_cut), "level {lod} is the octree at no depth");
    }
    let leaf_chunks = whole.index.chunks.iter().filter(|c| c.kind == Kind::Leaves);
    for (number, chunk) in leaf_chunks.enumerate() {
        // Whatever a viewer replaces by finer chunks, it replaces by something.
        ensure!(
            chunk.lod == 0 || !whole.index.finer(number).is_empty(),
            "chunk {number} has no finer chunks"
        );
    }
    Ok(())
}

/// The centres of the cells at `depth` that hold leaves, and of the leaves that are not deeper.
fn cut_off(voxels: &Voxelization, depth: u8) -> Vec<[f32; 3]> {
    let cell = |leaf: &Leaf| {
        let below = 3 * u32::from(voxels.j_high - depth.min(leaf.depth));
        Leaf { morton: leaf.morton >> below << below, depth: depth.min(leaf.depth) }
    };
    let mut cells: Vec<Leaf> = voxels.leaves.iter().map(cell).collect();
    cells.dedup();
    cells.iter().map(|&c| voxels.cube.leaf_centre(c, voxels.j_high)).collect()
}
