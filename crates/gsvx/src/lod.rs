//! Level of detail: a decoded scene with at most one Gaussian per cell of a coarser octree.

use crate::decode::Decoded;
use crate::error::Result;
use gpcc_lite::Leaf;
use voxel::{Merge, Voxelization};

/// Merges the Gaussians of a decoded scene whose leaves lie in the same cell at `depth`.
///
/// Means become the centres of those cells, shapes match the second moments of what they
/// replace. Leaves at or above `depth` and Gaussians that were coded exactly stay as they are. A
/// lossless stream has no leaves and is returned unchanged, with a remark. The whole stream is
/// decoded first: this saves drawing, not reading.
///
/// # Errors
/// [`crate::Error::Voxel`] if merging fails.
pub fn reduce(mut decoded: Decoded, depth: u8) -> Result<Decoded> {
    if decoded.leaves.is_empty() || depth >= decoded.header.j_high {
        if decoded.leaves.is_empty() && decoded.header.count > 0 {
            decoded.skipped.push("level of detail: a lossless stream has no octree".into());
        }
        return Ok(decoded);
    }
    let j_high = decoded.header.j_high;
    let mut leaves: Vec<Leaf> = Vec::new();
    let mut member_offsets = vec![0u32];
    for (i, leaf) in decoded.leaves.iter().enumerate() {
        let cell = if leaf.depth > depth {
            let below = 3 * u32::from(j_high - depth);
            Leaf { morton: leaf.morton >> below << below, depth }
        } else {
            *leaf
        };
        if leaves.last() != Some(&cell) {
            if i > 0 {
                member_offsets.push(i as u32);
            }
            leaves.push(cell);
        }
    }
    member_offsets.push(decoded.leaves.len() as u32);
    let voxels = Voxelization {
        cube: decoded.header.cube,
        j_high,
        leaves,
        member_offsets,
        members: (0..decoded.leaves.len() as u32).collect(),
        dropped: Vec::new(),
    };
    crate::decode::centres(&voxels.leaves, &decoded.header, 0)?;
    let before = decoded.leaves.len();
    let outliers = decoded.scene.split_off(before);
    decoded.scene = voxel::merge(&decoded.scene, &voxels, Merge::Moments)?;
    decoded.skipped.push(format!(
        "level of detail: {before} Gaussians merged into {} at depth {depth}",
        voxels.leaves.len()
    ));
    decoded.scene.append(&outliers);
    decoded.leaves = voxels.leaves;
    Ok(decoded)
}
