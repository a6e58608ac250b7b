//! What adaptive voxelization costs and what it brings.

mod cost;
mod criteria;
mod curves;
mod merging;
mod models;
mod speed;
mod tuned;

use std::path::PathBuf;

use anyhow::{Context, Result};

/// Measures the voxelization strategies and prints the tables of docs/results/voxel.md.
#[derive(Clone, Debug)]
pub struct Options {
    /// Directory with `scenes` and `models`.
    pub shared: PathBuf,
    /// Only these parts: speed, criteria, merging, rates, tuned, cost (all if none).
    pub only: Vec<String>,
    /// Only these scenes; `room` is the fixture, the others lie in `scenes` of the shared folder.
    pub scene: Vec<String>,
    /// Gaussians of the speed runs, in thousands.
    pub thousands: usize,
    /// Folder of the room.
    pub room: PathBuf,
    /// Steps of fine-tune in `tuned`.
    pub steps: u64,
    /// Folder for the plots of `rates` and `criteria`.
    pub plots: PathBuf,
    /// In `rates`, also try variants of the rate-distortion settings.
    pub variants: bool,
}

/// Runs the parts asked for.
///
/// # Errors
/// If a model or scene cannot be read, or a stage fails.
pub fn run(args: &Options) -> Result<()> {
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
