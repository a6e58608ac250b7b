//! Fits the costs of `voxel::CostModel` to streams: bits of a division and of a leaf in gpcc-lite's
//! geometry.

use std::collections::BTreeMap;
use std::fmt::Write;

use anyhow::Result;
use voxel::{RateDistortion, Strategy, Voxelization, voxelize};

use super::models::Study;

/// Counts of one octree: divided cells by number of occupied children (1, 2, 3, 4 and more),
/// leaves above the highest depth, divided cells from the lowest leaf depth on.
const TERMS: usize = 6;
const NAMES: [&str; TERMS] = ["1 child", "2 children", "3", "4 to 8", "leaf flag", "divided flag"];

fn counts(v: &Voxelization) -> [f64; TERMS] {
    let mut out = [0.0; TERMS];
    let lowest = v.octree().leaves().iter().map(|l| l.depth).min().unwrap_or(0);
    for depth in 0..v.octree().depth() {
        // Occupied cells of this depth that are divided, with their children.
        let mut children: BTreeMap<u64, Vec<u64>> = BTreeMap::new();
        let at = |d: u8, code: u64| code >> (3 * u32::from(v.octree().depth() - d));
        for leaf in v.octree().leaves().iter().filter(|l| l.depth > depth) {
            let list = children.entry(at(depth, leaf.morton)).or_default();
            let child = at(depth + 1, leaf.morton);
            if list.last() != Some(&child) {
                list.push(child);
            }
        }
        for list in children.values() {
            out[list.len().min(4) - 1] += 1.0;
        }
        if depth >= lowest {
            out[4] += v.octree().leaves().iter().filter(|l| l.depth == depth).count() as f64;
            out[5] += children.len() as f64;
        }
    }
    out
}

pub(super) fn table(study: &Study) -> Result<String> {
    let d = study.depth;
    let mut octrees = Vec::new();
    for depth in d - 3..d + 4 {
        octrees.push(Strategy::Uniform { depth });
        octrees.push(Strategy::paper(depth - 1, depth + 3));
    }
    for lambda in [1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1] {
        let seen = RateDistortion::seen(lambda, study.seen.clone());
        octrees.push(Strategy::RateDistortion(seen.clone()));
        octrees.push(Strategy::RateDistortion(RateDistortion { drop: None, ..seen }));
        octrees.push(Strategy::RateDistortion(RateDistortion::unseen(lambda)));
    }
    let mut rows = Vec::new();
    for strategy in octrees {
        let v = voxelize(&study.scene, &study.cube, &strategy)?;
        let bits = gpcc_lite::geometry::encode(v.octree())?.len() as f64 * 8.0;
        rows.push((counts(&v), bits, v.len() as f64));
    }
    // Least squares of bits per leaf, with a weak prior: the cost of isolated points.
    let prior = [3.02, 6.0, 8.0, 8.0, 0.5, 0.5];
    let mut fit = prior;
    for _ in 0..4000 {
        // Coordinate descent: six unknowns, always feasible (no cost below zero).
        for k in 0..TERMS {
            let (mut num, mut den) = (1e-3 * prior[k], 1e-3);
            for (c, bits, leaves) in &rows {
                let rest: f64 = (0..TERMS).filter(|&j| j != k).map(|j| fit[j] * c[j]).sum();
                num += c[k] * (bits - rest) / (leaves * leaves);
                den += c[k] * c[k] / (leaves * leaves);
            }
            fit[k] = (num / den).max(0.0);
        }
    }
    let mut out = format!("## Cost of geometry on {}\n\n| term | bits |\n|---|---|\n", study.name);
    for (name, bits) in NAMES.iter().zip(fit) {
        writeln!(out, "| {name} | {bits:.2} |")?;
    }
    let error = |(c, bits, _): &([f64; TERMS], f64, f64)| {
        ((0..TERMS).map(|k| c[k] * fit[k]).sum::<f64>() / bits - 1.0).abs()
    };
    let mean = rows.iter().map(error).sum::<f64>() / rows.len() as f64;
    let worst = rows.iter().map(error).fold(0.0, f64::max);
    writeln!(
        out,
        "\nMean error of the fit over {} octrees: {:.1} %, worst {:.1} %.",
        rows.len(),
        100.0 * mean,
        100.0 * worst
    )?;
    Ok(out)
}
