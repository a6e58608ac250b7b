//! Levels of detail of a stream: their Gaussians are at the centres of cells that hold all leaves.

use anyhow::{Result, anyhow, ensure};
use gpcc_lite::Leaf;
use gs_model::Scene;
use gsvx::{DecodeOptions, Kind};
use voxel::Voxelization;

/// Decodes every level of a stream that was made of `voxels` and `outliers`.
///
/// # Errors
/// If a level is invalid, or its Gaussians are not at the centres of cells that hold all leaves.
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
        let means = &scene.means[..n];
        ensure!(are_cells(voxels, means), "level {lod} is not the centres of cells of all leaves");
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

/// Whether `means` are the centres of cells, in Morton order, that hold every leaf once.
fn are_cells(voxels: &Voxelization, means: &[[f32; 3]]) -> bool {
    let mut rest = voxels.octree().leaves();
    means.iter().all(|mean| {
        let Some(first) = rest.first() else { return false };
        let cell = |depth: u8| {
            let below = 3 * u32::from(voxels.octree().depth() - depth);
            (below, Leaf { morton: first.morton >> below << below, depth })
        };
        let at_mean = |c: &(u32, Leaf)| {
            voxels.octree().cube().leaf_centre(c.1, voxels.octree().depth()) == *mean
        };
        let Some((below, cell)) = (0..=first.depth).rev().map(cell).find(at_mean) else {
            return false;
        };
        let held = rest.partition_point(|l| l.morton >> below == cell.morton >> below);
        rest = &rest[held..];
        true
    }) && rest.is_empty()
}

/// The scene at another SH degree: coefficients are cut, or zeros are added.
pub(super) fn of_degree(scene: &Scene, sh_degree: u8) -> Scene {
    let mut out = Scene { sh_degree, ..Scene::default() };
    out.append(scene);
    out
}

/// The bits of every Gaussian.
pub(super) fn rows(s: &Scene) -> Vec<Vec<u32>> {
    (0..s.len())
        .map(|i| {
            let sh = s.sh_of(i).as_flattened();
            let other =
                [&s.means[i][..], &s.rotations[i], &s.log_scales[i], &s.opacity_logits[i..=i]];
            other.concat().iter().chain(sh).map(|v| v.to_bits()).collect()
        })
        .collect()
}
