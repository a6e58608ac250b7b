//! Time and memory on millions of Gaussians, beside a sort in the same run.

use std::fmt::Write;
use std::time::Instant;

use anyhow::Result;
use testing::Rng;
use voxel::{Cube, Merge, RateDistortion, Strategy, merge, rate_distortion, voxelize};

use super::Options;
use super::models;
use crate::usage::{self, cpu_seconds};

/// Repetitions; the fastest counts, since other programs share the machine.
const RUNS: usize = 9;

pub(super) fn table(args: &Options) -> Result<String> {
    let fox = models::read(&args.shared.join("scenes/fox/point_cloud.ply"))?;
    let scene = models::replicated(&fox, &Cube::of(&fox.means)?, args.thousands * 1000);
    drop(fox);
    let cube = Cube::of(&scene.means)?;
    let depth = models::depth_of(&scene, &cube)?;
    let seen: Vec<f32> = (0..scene.len()).map(|i| (i % 101) as f32).collect();

    let sort = sort_seconds(scene.len());
    let mut out = format!(
        "{} Gaussians (fox, replicated) of SH degree {}, {} threads. `sort_unstable` of as many random u64: {sort:.3} s.\n\n\
         CPU seconds are of both steps on all threads: on quiet cores the wall time is at least \
         that divided by the threads. \
         Every time is the fastest of {RUNS}. `skipped`: cells whose subtrees were not visited, of \
         those decided.\n\n\
         | strategy | leaves | voxelize s | merge s | both / sort | CPU s | peak bytes per Gaussian above input, voxelize | ... of which result | skipped |\n\
         |---|---|---|---|---|---|---|---|---|\n",
        scene.len(),
        scene.sh_degree,
        rayon::current_num_threads()
    );
    let strategies = [
        ("Uniform", Strategy::Uniform { depth }),
        ("Paper", Strategy::paper(depth - 2, depth + 2)),
        ("RateDistortion::unseen", Strategy::RateDistortion(RateDistortion::unseen(3e-3))),
        ("RateDistortion::seen", Strategy::RateDistortion(RateDistortion::seen(3e-3, seen))),
    ];
    for (name, strategy) in strategies {
        let (mut voxelizing, mut merging, mut leaves) = (f64::INFINITY, f64::INFINITY, 0);
        let mut cpu = f64::INFINITY;
        let (mut peak, mut kept) = (0, 0);
        for _ in 0..RUNS {
            usage::reset_peak();
            let before = usage::resident_bytes();
            let used = cpu_seconds();
            let start = Instant::now();
            let v = voxelize(&scene, &cube, &strategy)?;
            voxelizing = voxelizing.min(start.elapsed().as_secs_f64());
            peak = peak.max(usage::peak_bytes().saturating_sub(before));
            kept = v.leaves.len() * 16 + (v.members.len() + v.member_offsets.len()) * 4;
            let start = Instant::now();
            let merged = merge(&scene, &v, Merge::Moments)?;
            merging = merging.min(start.elapsed().as_secs_f64());
            cpu = cpu.min(cpu_seconds() - used);
            leaves = merged.len();
        }
        let skipped = match &strategy {
            Strategy::RateDistortion(options) => {
                let (_, report) = rate_distortion(&scene, &cube, options)?;
                format!("{} of {}", report.skipped, report.decided)
            }
            _ => "-".to_owned(),
        };
        let per = |bytes: usize| bytes as f64 / scene.len() as f64;
        writeln!(
            out,
            "| {name} | {leaves} | {voxelizing:.3} | {merging:.3} | {:.1} | {cpu:.2} | {:.0} | {:.0} | {skipped} |",
            (voxelizing + merging) / sort,
            per(peak as usize),
            per(kept)
        )?;
    }
    Ok(out)
}

/// Seconds to sort as many random integers, fastest of all repetitions.
fn sort_seconds(n: usize) -> f64 {
    let mut sort = f64::INFINITY;
    for run in 0..RUNS {
        let mut rng = Rng::seeded(run as u64);
        let mut keys: Vec<u64> = (0..n).map(|_| rng.bits()).collect();
        let start = Instant::now();
        keys.sort_unstable();
        sort = sort.min(start.elapsed().as_secs_f64());
        std::hint::black_box(&keys);
    }
    sort
}
