//! Scenes larger than memory, and scenes that many machines share: `gsvx plan`, `gsvx encode --part` and
//! `gsvx encode --memory`, which is a plan, all its tiles and a join in one.
//!
//! The stream is that of an encode in memory, byte for byte. See `docs/scale.md`.

mod cameras;
mod inputs;
mod memory;
mod plan_file;
mod planning;
mod rows;
mod scratch;
mod setup;
mod thinned;
mod work;

use crate::commands::join::ScenePart;
use crate::content::SceneArgs;
use crate::exit::usage;
use crate::output::{Output, counted};
use crate::report::Reporter;
use crate::views::Origin;
use anyhow::Result;
use cameras::CameraFile;
use gsvx::Choices;
use plan_file::PlanFile;
use rows::TileRows;
use serde_json::json;
use setup::Setup;
use std::path::{Path, PathBuf};
use std::time::Instant;
use work::Work;

/// The version of this build.
const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Name of the plan among the scratch files.
const PLAN: &str = "plan";

/// `gsvx plan`.
pub(crate) fn plan(args: &SceneArgs, choices: Choices, report: Reporter) -> Result<()> {
    let Setup { output, start, cameras, scratch } = Setup::new(args, choices, "plan")?;
    let cameras = cameras.as_ref();
    let (mut plan, proven) = planning::survey(args, choices, cameras, &scratch)?;
    let rows = TileRows::write(&plan, &plan.plan.sample(), 0, &scratch)?;
    planning::measure(&mut plan, &rows, cameras, proven)?;
    let text = plan.text()?;
    let written = output.write(|out| Ok(out.write_all(text.as_bytes())?))?;
    scratch.remove();
    let (count, tiles) = (plan.plan.count(), plan.plan.tile_counts().len());
    let seconds = start.elapsed().as_secs_f64();
    let (of, into) = (counted(count, "Gaussian"), counted(tiles, "tile"));
    let origin = cameras.and_then(|cameras| cameras.origin.as_ref());
    let json = json!({
        "gaussians": count,
        "tiles": tiles,
        "cameras": origin.map(Origin::json),
        "plan_seconds": seconds,
    });
    plan.warn_of_coarse_cells();
    let human = format!("{of} in {into}, planned in {seconds:.2} s{}", work::line(origin));
    report.wrote(&written, &human, json)
}

/// `gsvx encode --part`.
pub(crate) fn part(args: &SceneArgs, part: ScenePart, report: Reporter) -> Result<()> {
    let [plan_path] = &args.inputs[..] else {
        return Err(usage("--part: name one plan, which gsvx plan has made"));
    };
    let start = Instant::now();
    let plan = PlanFile::read(plan_path)?;
    let inputs: Vec<&Path> = plan.inputs.iter().map(|i| &*i.path).chain([&**plan_path]).collect();
    let output = Output::open(&args.output, args.force, &inputs)?;
    let id = plan.id()?;
    let mut key = format!("gsvx {VERSION} part {}/{} of {id:08x}\n", part.k, part.n);
    plan.inputs.iter().for_each(|i| key += &i.key());
    let scratch = setup::scratch(args, &key)?;
    let tiles = plan.plan.part(part.k - 1, part.n).collect();
    let cameras = plan.cameras.as_ref().map(CameraFile::open).transpose()?;
    let work = Work { plan: &plan, tiles, cameras: cameras.as_ref(), scratch: &scratch };
    let made = work.encode(memory::tiles_at_once(args.room.memory)?, start)?;
    made.write(output, &part.mark(id), report)?;
    scratch.remove();
    Ok(())
}

/// `gsvx encode` of a scene that does not fit in memory, or that is in several files.
pub(crate) fn encode(args: &SceneArgs, choices: Choices, report: Reporter) -> Result<()> {
    let at_once = memory::tiles_at_once(args.room.memory)?;
    let setup = Setup::new(args, choices, "encode")?;
    setup.state_room(args)?;
    let Setup { output, start, cameras, scratch } = setup;
    let cameras = cameras.as_ref();
    let plan = match std::fs::read(scratch.path(PLAN)) {
        Ok(bytes) => PlanFile::parse(&bytes)?,
        Err(_) => {
            let (mut plan, proven) = planning::survey(args, choices, cameras, &scratch)?;
            let rows = Work::of_all(&plan, cameras, &scratch).rows()?;
            planning::measure(&mut plan, &rows, cameras, proven)?;
            scratch.write(PLAN, plan.text()?.as_bytes())?;
            plan
        }
    };
    plan.warn_of_coarse_cells();
    // Cameras that may not be the model's own decide nothing.
    let cameras = cameras.filter(|_| plan.cameras.is_some());
    let work = Work::of_all(&plan, cameras, &scratch);
    work.encode(at_once, start)?.write(output, "", report)?;
    scratch.remove();
    Ok(())
}

/// Whether models are so large that they are not encoded in memory.
pub(crate) fn is_large(inputs: &[PathBuf]) -> bool {
    let files = inputs.iter().filter_map(|p| std::fs::metadata(p).ok());
    memory::is_large(files.map(|m| m.len()).sum())
}
