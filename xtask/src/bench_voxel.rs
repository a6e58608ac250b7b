//! `cargo xtask bench-voxel`: what adaptive voxelization costs and what it brings.

#[path = "bench_voxel/chart.rs"]
mod chart;
#[path = "bench_voxel/cost.rs"]
mod cost;
#[path = "bench_voxel/criteria.rs"]
mod criteria;
#[path = "bench_voxel/curves.rs"]
mod curves;
#[path = "bench_voxel/merging.rs"]
mod merging;
#[path = "bench_voxel/models.rs"]
mod models;
#[path = "bench_voxel/speed.rs"]
mod speed;
#[path = "bench_voxel/tuned.rs"]
mod tuned;

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;

/// Measures the voxelization strategies and prints the tables of docs/results/voxel.md.
#[derive(Debug, Args)]
pub(crate) struct BenchArgs {
    /// Directory with `scenes` and `models`
    #[arg(long, default_value = "../shared")]
    pub(crate) shared: PathBuf,
    /// Only these parts: speed, criteria, merging, rates, tuned, cost (all if none)
    #[arg(long)]
    pub(crate) only: Vec<String>,
    /// Only these scenes; `room` is the fixture, the others lie in `scenes` of the shared folder
    #[arg(long, default_values_t = ["fox".to_owned(), "bonsai".to_owned(), "room".to_owned()])]
    pub(crate) scene: Vec<String>,
    /// Gaussians of the speed runs, in thousands
    #[arg(long, default_value_t = 2500)]
    pub(crate) thousands: usize,
    /// Folder of the room
    #[arg(long, default_value = "fixtures/room")]
    pub(crate) room: PathBuf,
    /// Steps of fine-tune in `tuned`
    #[arg(long, default_value_t = 300)]
    pub(crate) steps: u64,
    /// Folder for the plots of `rates` and `criteria`
    #[arg(long, default_value = "docs/results")]
    pub(crate) plots: PathBuf,
    /// In `rates`, also try variants of the rate-distortion settings
    #[arg(long)]
    pub(crate) variants: bool,
}

/// Runs the parts asked for.
pub(crate) fn run(args: &BenchArgs) -> Result<()> {
    let wants = |part: &str| args.only.is_empty() || args.only.iter().any(|o| o == part);
    if wants("speed") {
        println!("{}", speed::table(args)?);
    }
    if wants("criteria") {
        println!("{}", criteria::table(args)?);
    }
    for name in &args.scene {
        if !["merging", "rates", "tuned", "cost"].into_iter().any(wants) {
            break;
        }
        let folder =
            if name == "room" { args.room.clone() } else { args.shared.join("scenes").join(name) };
        let study = models::Study::open(&folder, name).with_context(|| format!("scene {name}"))?;
        if wants("cost") {
            println!("{}", cost::table(&study)?);
        }
        if wants("merging") {
            println!("{}", merging::table(&study)?);
        }
        if wants("rates") {
            println!("{}", curves::table(&study, args)?);
        }
        if wants("tuned") {
            println!("{}", tuned::table(&study, args.steps)?);
        }
    }
    Ok(())
}
