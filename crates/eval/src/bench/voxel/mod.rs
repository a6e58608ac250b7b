//! What adaptive voxelization costs and what it brings.

mod cost;
mod criteria;
mod curves;
mod merging;
mod models;
mod page;
mod speed;
mod tuned;

use std::path::PathBuf;

use anyhow::{Context, Result, bail};

/// What [`run`] measures.
#[derive(Clone, Debug)]
pub struct Options {
    /// Directory with `scenes` and `models`.
    pub shared: PathBuf,
    /// Only these parts: rates, tuned, criteria, speed, merging, cost (all if none).
    pub only: Vec<String>,
    /// Only these scenes; `room` is the fixture, the others lie in `scenes` of the shared folder.
    pub scene: Vec<String>,
    /// Gaussians of the speed runs, in thousands.
    pub thousands: usize,
    /// Folder of the room.
    pub room: PathBuf,
    /// Steps of fine-tune in `tuned`.
    pub steps: u64,
    /// Where the page goes, relative to the root of the workspace; the plots of `rates` lie beside it.
    pub out: PathBuf,
    /// In `rates`, also try variants of the rate-distortion settings.
    pub variants: bool,
}

/// The parts of a run.
const PARTS: [&str; 6] = ["rates", "tuned", "criteria", "speed", "merging", "cost"];

/// Prints all figures of the parts asked for, and writes a page with the summaries of those of them
/// that have one: rates, tuned, criteria and speed.
///
/// # Errors
/// If there is no such part, a model or scene cannot be read, or a stage fails.
pub fn run(args: &Options) -> Result<()> {
    if let Some(unknown) = args.only.iter().find(|o| !PARTS.contains(&o.as_str())) {
        bail!("no part {unknown}; parts: {}", PARTS.join(", "));
    }
    let wants = |part: &str| args.only.is_empty() || args.only.iter().any(|o| o == part);
    let mut page = page::Page::default();
    if wants("speed") {
        page.speed = Some(speed::table(args)?);
        page.speed.iter().for_each(|table| println!("{table}"));
    }
    if wants("criteria") {
        let (comparisons, details) = criteria::measure(args)?;
        println!("{details}");
        page.criteria = comparisons;
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
            let rates = curves::measure(&study, args)?;
            println!("{}", rates.details);
            page.rates.push(rates);
        }
        if wants("tuned") {
            let tuned = tuned::measure(&study, args.steps)?;
            println!("{}", tuned.details);
            page.tuned.push(tuned);
        }
    }
    match page.text(args)? {
        Some(text) => crate::page::write(&args.out, &text, None),
        None => Ok(()),
    }
}
