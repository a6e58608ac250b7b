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
mod thinned;

use crate::content::SceneArgs;
use crate::exit::{note, usage};
use crate::join::{self, ScenePart};
use crate::output::{Output, counted, is_stdio};
use crate::progress::Meter;
use crate::report::Reporter;
use crate::stream_file::StreamFile;
use crate::views::Origin;
use anyhow::{Error, Result};
use cameras::{CameraFile, PlanCameras};
use gsvx::{Choices, Index};
use indicatif::DecimalBytes;
use inputs::SceneFile;
use plan_file::PlanFile;
use rayon::prelude::*;
use rows::TileRows;
use scratch::Scratch;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The version of this build.
const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Name of the plan among the scratch files.
const PLAN: &str = "plan";
/// Name of the stream of a part without tiles.
const NOTHING: &str = "tile-none.gsvx";
/// Bytes of a stream per Gaussian, at most: for the room that is needed.
const STREAM_BYTES: u64 = 60;
/// Bytes of a mean.
const MEAN_BYTES: u64 = 12;

/// The folder for scratch files of the work that `key` tells from other work.
fn scratch(args: &SceneArgs, key: &str) -> Result<Scratch> {
    let beside = || match is_stdio(&args.output) {
        true => "gsvx.scratch".into(),
        false => args.output.with_added_extension("scratch"),
    };
    let dir = args.room.scratch.clone().unwrap_or_else(beside);
    let scratch = Scratch::open(&dir, key)?;
    if scratch.resumed {
        note(format_args!("going on with what is in {}", dir.display()));
    }
    Ok(scratch)
}

/// Tells work from other work.
fn key(
    args: &SceneArgs,
    choices: Choices,
    what: &str,
    cameras: Option<&PlanCameras>,
) -> Result<String> {
    let mut key = format!("gsvx {VERSION} {what}\n");
    key += &serde_json::to_string(&(&args.reading, choices, cameras.map(PlanCameras::file)))?;
    key.push('\n');
    for path in &args.inputs {
        key += &SceneFile::new(path)?.key();
    }
    Ok(key)
}

/// Says how much room is needed, as far as the lengths of the files tell, and checks it.
fn state_room(inputs: &[PathBuf], scratch: &Scratch) -> Result<()> {
    let bytes = inputs.iter().map(|p| Ok(SceneFile::new(p)?.bytes)).sum::<Result<u64>>()?;
    if !scratch.resumed {
        let (size, folder) = (DecimalBytes(bytes), scratch.path(""));
        note(format_args!("scratch files: about {size} in {}", folder.display()));
    }
    scratch.check_room(bytes)
}

/// `gsvx plan`.
pub(crate) fn plan(args: &SceneArgs, choices: Choices, report: Reporter) -> Result<()> {
    let output = Output::open(&args.output, args.force, &args.inputs)?;
    let start = Instant::now();
    let cameras = args.content.cameras.as_deref().map(PlanCameras::read).transpose()?;
    let cameras = cameras.as_ref();
    let scratch = scratch(args, &key(args, choices, "plan", cameras)?)?;
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
    warn_of_coarse_cells(&plan);
    let human = format!("{of} in {into}, planned in {seconds:.2} s{}", line(origin));
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
    let scratch = scratch(args, &key)?;
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
    let output = Output::open(&args.output, args.force, &args.inputs)?;
    let start = Instant::now();
    let cameras = args.content.cameras.as_deref().map(PlanCameras::read).transpose()?;
    let cameras = cameras.as_ref();
    let scratch = scratch(args, &key(args, choices, "encode", cameras)?)?;
    state_room(&args.inputs, &scratch)?;
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
    warn_of_coarse_cells(&plan);
    // Cameras that may not be the model's own decide nothing.
    let cameras = cameras.filter(|_| plan.cameras.is_some());
    let work = Work::of_all(&plan, cameras, &scratch);
    work.encode(at_once, start)?.write(output, "", report)?;
    scratch.remove();
    Ok(())
}

/// A further line that says where cameras are from.
fn line(origin: Option<&Origin>) -> String {
    origin.map_or_else(String::new, |origin| format!("\n{}", origin.human()))
}

fn warn_of_coarse_cells(plan: &PlanFile) {
    if let Some(warning) = plan.plan.warning() {
        note(format_args!("warning: {warning}"));
    }
}

/// Tiles of a plan that are to be encoded.
struct Work<'a> {
    plan: &'a PlanFile,
    tiles: Vec<usize>,
    cameras: Option<&'a PlanCameras>,
    scratch: &'a Scratch,
}

impl<'a> Work<'a> {
    fn of_all(plan: &'a PlanFile, cameras: Option<&'a PlanCameras>, scratch: &'a Scratch) -> Self {
        let tiles = (0..plan.plan.tile_counts().len()).collect();
        Self { plan, tiles, cameras, scratch }
    }

    fn gaussians(&self) -> u64 {
        self.tiles.iter().map(|&t| self.plan.plan.tile_counts()[t]).sum()
    }

    /// The Gaussians of the tiles on disk. Refuses work for which the disk is too small.
    fn rows(&self) -> Result<TileRows> {
        let sh_degree = self.plan.plan.sh_degree();
        let row = gs_model::ply::row_bytes(sh_degree) as u64;
        self.scratch.check_room(self.gaussians() * (row + STREAM_BYTES + MEAN_BYTES))?;
        TileRows::write(self.plan, &self.tiles, sh_degree, self.scratch)
    }

    /// Encodes the tiles, each as a stream among the scratch files.
    fn encode(&self, at_once: usize, start: Instant) -> Result<TileStreams> {
        let Self { plan, tiles, cameras, scratch } = self;
        let name = |tile: usize| format!("tile-{tile:06}.gsvx");
        let left: Vec<usize> = tiles.iter().copied().filter(|&t| !scratch.has(&name(t))).collect();
        let mut streams: Vec<PathBuf> = tiles.iter().map(|&t| scratch.path(&name(t))).collect();
        if tiles.is_empty() {
            // The join needs a head.
            scratch.write(NOTHING, &plan.plan.encode_nothing()?.bytes)?;
            streams.push(scratch.path(NOTHING));
        }
        let rows = if left.is_empty() { None } else { Some(self.rows()?) };
        let before = start.elapsed().as_secs_f64();
        let step = Instant::now();
        if let Some(rows) = rows {
            let bar = Meter::new("encode", tiles.len());
            (left.len()..tiles.len()).for_each(|_| bar.inc());
            for some in left.chunks(at_once) {
                some.par_iter().with_max_len(1).try_for_each(|&tile| {
                    let gaussians = rows.tile(tile)?;
                    let seen = cameras.map(|s| s.of(&gaussians).squared).unwrap_or_default();
                    let encoded = plan.plan.encode(tile, &gaussians, &seen)?;
                    scratch.write(&name(tile), &encoded.bytes)?;
                    bar.inc();
                    Ok::<(), Error>(())
                })?;
            }
        }
        let input_bytes = plan.inputs.iter().map(|i| i.bytes).sum();
        let transparent = plan.inputs.iter().map(|i| i.transparent).sum();
        let (gaussians, tiles) = (self.gaussians(), step.elapsed().as_secs_f64());
        let cameras = cameras.and_then(|cameras| cameras.origin.clone());
        Ok(TileStreams { streams, gaussians, transparent, input_bytes, cameras, before, tiles })
    }
}

/// Tiles as streams among the scratch files.
struct TileStreams {
    streams: Vec<PathBuf>,
    gaussians: u64,
    /// Of all inputs: those that no rasterizer draws.
    transparent: u64,
    input_bytes: u64,
    cameras: Option<Origin>,
    /// Seconds until the tiles were begun, and of the tiles.
    before: f64,
    tiles: f64,
}

impl TileStreams {
    /// Joins the tiles, and says what was made.
    fn write(self, output: Output, mark: &str, report: Reporter) -> Result<()> {
        let step = Instant::now();
        let heads = self.streams.iter().map(|p| Ok(StreamFile::open(p)?.index));
        let heads = heads.collect::<Result<Vec<_>>>()?;
        let mut index = Index::default();
        let written = output.write(|out| {
            index = join::write(&self.streams, &heads, out)?;
            Ok(out.write_all(mark.as_bytes())?)
        })?;
        let join = step.elapsed().as_secs_f64();
        let (bytes, coded) = (index.stream_len(), index.header.count);
        let Self { streams, gaussians, transparent, input_bytes, cameras, before, tiles } = self;
        let human = format!(
            "{gaussians} Gaussians coded as {coded}, {} -> {} ({:.1} bits per Gaussian), {}\n\
             read and partition {before:.2} s, encode {tiles:.2} s, join {join:.2} s{}",
            DecimalBytes(input_bytes),
            DecimalBytes(bytes),
            8.0 * bytes as f64 / coded.max(1) as f64,
            counted(streams.len(), "tile"),
            line(cameras.as_ref()),
        );
        let json = json!({
            "bytes": bytes,
            "input_bytes": input_bytes,
            "input_gaussians": gaussians,
            "gaussians": coded,
            "transparent": transparent,
            "tiles": streams.len(),
            "cameras": cameras.as_ref().map(Origin::json),
            "partition_seconds": before,
            "encode_seconds": tiles,
            "join_seconds": join,
        });
        report.wrote(&written, &human, json)
    }
}

/// Whether models are so large that they are not encoded in memory.
pub(crate) fn is_large(inputs: &[PathBuf]) -> bool {
    let files = inputs.iter().filter_map(|p| std::fs::metadata(p).ok());
    memory::is_large(files.map(|m| m.len()).sum())
}
