//! Leaves of different depth against the same leaves as integers of full depth.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, ensure};
use gpcc_lite::{Leaf, Limits, geometry};

use super::cloud::read;

/// Coarsens a uniform cloud: each cell of depth `coarse` draws its leaves' depth from
/// `coarse..=j` by a hash, `bias` of 256 of them the coarsest.
fn coarsen(leaves: &[Leaf], j: u8, coarse: u8, bias: u64) -> Vec<Leaf> {
    let mut out: Vec<Leaf> = leaves
        .iter()
        .map(|l| {
            let cell = l.morton >> (3 * (j - coarse));
            let hash = cell.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
            let depth = if hash & 255 < bias {
                coarse
            } else {
                coarse + ((hash >> 8) % u64::from(j - coarse + 1)) as u8
            };
            let cut = 3 * (j - depth);
            Leaf { morton: l.morton >> cut << cut, depth }
        })
        .collect();
    out.sort_unstable();
    out.dedup();
    out
}

/// Bits per leaf: the pruned tree, and the same leaves' centres as integers of full depth.
pub(super) fn table(dir: &Path) -> Result<String> {
    let mut out = String::from(
        "| cloud | leaves | levels above J_high, average | pruned tree, bits per leaf | centres as J_high-bit points | corners as J_high-bit points | one member of each, J_high bits | against centres | against corners | against members |\n|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (name, coarse, bias) in [
        ("vic15", 13, 0),
        ("vic15", 10, 0),
        ("vic15", 10, 160),
        ("syn15", 13, 0),
        ("syn15", 10, 0),
        ("syn15", 10, 160),
    ] {
        let cloud = read(&dir.join(format!("{name}_dc.ply")), 15)?;
        let leaves = coarsen(&cloud.leaves, 15, coarse, bias);
        let n = leaves.len() as f64;
        let above = leaves.iter().map(|l| f64::from(15 - l.depth)).sum::<f64>() / n;
        let bytes = geometry::encode(&leaves, 15)?;
        let back = geometry::decode(&bytes, &Limits { max_points: leaves.len() })?;
        ensure!(back.leaves == leaves, "{name}: leaves differ");
        let points = |offset: &dyn Fn(&Leaf) -> u64| -> Result<f64> {
            let p: Vec<Leaf> =
                leaves.iter().map(|l| Leaf { morton: l.morton | offset(l), depth: 15 }).collect();
            Ok(geometry::encode(&p, 15)?.len() as f64 * 8.0 / n)
        };
        // The centre: the topmost bit below the leaf's own depth, on each axis.
        let centres = points(&|l| if l.depth < 15 { 7 << (3 * (14 - l.depth)) } else { 0 })?;
        let corners = points(&|_| 0)?;
        // The first point of the cloud in each leaf: what a uniform voxelization would keep.
        let mut at = 0;
        let members: Vec<Leaf> = leaves
            .iter()
            .map(|l| {
                while cloud.leaves[at].morton < l.morton {
                    at += 1;
                }
                cloud.leaves[at]
            })
            .collect();
        let members = geometry::encode(&members, 15)?.len() as f64 * 8.0 / n;
        let bits = bytes.len() as f64 * 8.0 / n;
        writeln!(
            out,
            "| {name} | {n} | {above:.2} | {bits:.3} | {centres:.3} | {corners:.3} | {members:.3} | {:+.1} % | {:+.1} % | {:+.1} % |",
            (bits / centres - 1.0) * 100.0,
            (bits / corners - 1.0) * 100.0,
            (bits / members - 1.0) * 100.0
        )?;
    }
    Ok(out)
}
