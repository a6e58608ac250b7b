//! Scenes larger than memory, and scenes that many machines share: `gsvx plan`, `gsvx encode --part` and
//! `gsvx encode --memory`, which is a plan, all its tiles and a join in one.
//!
//! The stream is that of an encode in memory, byte for byte. See `docs/scale.md`.

mod inputs;
mod memory;
mod plan_file;
mod planning;
mod rows;
mod scratch;
mod sight;

use crate::exit::note;
use crate::input::Reading;
use crate::join::{self, Part};
use crate::output::{Output, counted, is_stdio, megabytes};
use crate::progress::Steps;
use crate::report::Reporter;
use anyhow::Result;
use gsvx::{Choices, Index};
use inputs::Input;
use plan_file::PlanFile;
use rayon::prelude::*;
use rows::Rows;
use scratch::Scratch;
use serde_json::{Value, json};
use sight::{CameraFile, Sight};
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

/// Where the work is done, and with how much.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct Room {
    /// Most memory to use, as in 1G; the rest goes to scratch files. [default: as much as the models need, up to a
    /// quarter of the machine's]
    ///
    /// Needs as much room on the disk as the models take, in a folder beside the output. If the run is killed,
    /// the same command goes on from there.
    #[arg(long, value_name = "SIZE", value_parser = crate::size::bytes, hide_short_help = true,
          help_heading = "Scenes larger than memory")]
    pub(crate) memory: Option<u64>,
    /// Folder for scratch files [default: OUTPUT.scratch].
    #[arg(
        long,
        value_name = "FOLDER",
        hide_short_help = true,
        help_heading = "Scenes larger than memory"
    )]
    scratch: Option<PathBuf>,
}

impl Room {
    fn tiles_at_once(&self) -> Result<usize> {
        memory::tiles_at_once(memory::bound(self.memory))
    }

    fn scratch(&self, output: &Path, key: &str) -> Result<Scratch> {
        let beside = || {
            let mut name = output.as_os_str().to_owned();
            if is_stdio(output) {
                name = "gsvx".into();
            }
            name.push(".scratch");
            PathBuf::from(name)
        };
        let dir = self.scratch.clone().unwrap_or_else(beside);
        let scratch = Scratch::open(&dir, key)?;
        if scratch.resumed {
            note(format_args!("going on with what is in {}", dir.display()));
        }
        Ok(scratch)
    }
}

/// Several models as one scene, and how they are encoded.
pub(crate) struct LargeJob<'a> {
    pub(crate) inputs: &'a [PathBuf],
    pub(crate) reading: &'a Reading,
    pub(crate) choices: Choices,
    pub(crate) cameras: Option<&'a Path>,
    pub(crate) output: &'a Path,
    pub(crate) force: bool,
    pub(crate) room: &'a Room,
}

impl LargeJob<'_> {
    /// Tells this work from other work.
    fn key(&self, what: &str, sight: Option<&Sight>) -> Result<String> {
        let mut key = format!("gsvx {} {what}\n", VERSION);
        key += &serde_json::to_string(&(self.reading, self.choices, sight.map(Sight::file)))?;
        key.push('\n');
        for path in self.inputs {
            key += &Input::new(path)?.key();
        }
        Ok(key)
    }

    fn sight(&self) -> Result<Option<Sight>> {
        self.cameras.map(Sight::read).transpose()
    }

    fn open_output(&self) -> Result<Output> {
        let inputs: Vec<&Path> = self.inputs.iter().map(PathBuf::as_path).collect();
        Output::open(self.output, self.force, &inputs)
    }

    /// Says how much room is needed, as far as the lengths of the files tell, and checks it.
    fn state_room(&self, scratch: &Scratch) -> Result<()> {
        let bytes = self.inputs.iter().map(|p| Ok(Input::new(p)?.bytes)).sum::<Result<u64>>()?;
        if !scratch.resumed {
            note(format_args!(
                "scratch files: about {} in {}",
                megabytes(bytes),
                scratch.path("").display()
            ));
        }
        scratch.check_room(bytes)
    }
}

/// `gsvx plan`.
pub(crate) fn plan(job: &LargeJob<'_>, report: Reporter) -> Result<()> {
    let output = job.open_output()?;
    let start = Instant::now();
    let sight = job.sight()?;
    let scratch = job.room.scratch(job.output, &job.key("plan", sight.as_ref())?)?;
    let mut plan =
        planning::survey(job.inputs, job.reading, job.choices, sight.as_ref(), &scratch)?;
    let rows = Rows::write(&plan, &plan.plan.sample(), 0, &scratch)?;
    planning::measure(&mut plan.plan, &rows, sight.as_ref())?;
    let text = plan.text()?;
    let (name, stdout) = (output.name(), output.is_stdout());
    output.write(|out| Ok(out.write_all(text.as_bytes())?))?;
    scratch.remove();
    let (count, tiles) = (plan.plan.count(), plan.plan.tile_counts().len());
    let seconds = start.elapsed().as_secs_f64();
    let (of, into) = (counted(count, "Gaussian"), counted(tiles as u64, "tile"));
    let human = format!("{name}: {of} in {into}, planned in {seconds:.2} s");
    let json =
        json!({ "output": name, "gaussians": count, "tiles": tiles, "plan_seconds": seconds });
    warn_of_coarse_cells(&plan);
    report.say(stdout, &human, &json)
}

/// `gsvx encode --part`.
pub(crate) fn part(
    plan_path: &Path,
    part: Part,
    (output, force): (&Path, bool),
    room: &Room,
    report: Reporter,
) -> Result<()> {
    let plan = PlanFile::read(plan_path)?;
    let inputs: Vec<&Path> = plan.inputs.iter().map(|i| &*i.path).chain([plan_path]).collect();
    let opened = Output::open(output, force, &inputs)?;
    let id = plan.id()?;
    let mut key = format!("gsvx {} part {}/{} of {id:08x}\n", VERSION, part.k, part.n);
    plan.inputs.iter().for_each(|i| key += &i.key());
    let scratch = room.scratch(output, &key)?;
    let tiles: Vec<usize> = plan.plan.part(part.k - 1, part.n).collect();
    let sight = plan.cameras.as_ref().map(CameraFile::open).transpose()?;
    let made = Made::of(&plan, &tiles, (room, sight.as_ref()), &scratch, Instant::now())?;
    made.write(opened, &part.mark(id), report)?;
    scratch.remove();
    Ok(())
}

/// `gsvx encode` of a scene that does not fit in memory, or that is in several files.
pub(crate) fn encode(job: &LargeJob<'_>, report: Reporter) -> Result<()> {
    job.room.tiles_at_once()?;
    let output = job.open_output()?;
    let start = Instant::now();
    let sight = job.sight()?;
    let scratch = job.room.scratch(job.output, &job.key("encode", sight.as_ref())?)?;
    job.state_room(&scratch)?;
    let plan = match std::fs::read(scratch.path(PLAN)) {
        Ok(bytes) => PlanFile::parse(&bytes)?,
        Err(_) => {
            let sight = sight.as_ref();
            let mut plan = planning::survey(job.inputs, job.reading, job.choices, sight, &scratch)?;
            let all: Vec<usize> = (0..plan.plan.tile_counts().len()).collect();
            check_room(&plan, &all, &scratch)?;
            let rows = Rows::write(&plan, &all, plan.plan.sh_degree(), &scratch)?;
            planning::measure(&mut plan.plan, &rows, sight)?;
            scratch.write(PLAN, plan.text()?.as_bytes())?;
            plan
        }
    };
    warn_of_coarse_cells(&plan);
    let all: Vec<usize> = (0..plan.plan.tile_counts().len()).collect();
    let made = Made::of(&plan, &all, (job.room, sight.as_ref()), &scratch, start)?;
    made.write(output, "", report)?;
    scratch.remove();
    Ok(())
}

fn warn_of_coarse_cells(plan: &PlanFile) {
    if let Some(warning) = plan.plan.warning() {
        note(format_args!("warning: {warning}"));
    }
}

/// Refuses work on some tiles for which the disk is too small.
fn check_room(plan: &PlanFile, tiles: &[usize], scratch: &Scratch) -> Result<()> {
    let plan = &plan.plan;
    let rows: u64 = tiles.iter().map(|&t| plan.tile_counts()[t]).sum();
    let row = gs_model::ply::row_bytes(plan.sh_degree()) as u64;
    scratch.check_room(rows * (row + STREAM_BYTES + MEAN_BYTES))
}

/// Tiles as streams among the scratch files.
struct Made {
    streams: Vec<PathBuf>,
    gaussians: u64,
    input_bytes: u64,
    /// Seconds until the tiles were begun, and of the tiles.
    before: f64,
    tiles: f64,
}

impl Made {
    fn of(
        plan: &PlanFile,
        tiles: &[usize],
        (room, sight): (&Room, Option<&Sight>),
        scratch: &Scratch,
        start: Instant,
    ) -> Result<Self> {
        check_room(plan, tiles, scratch)?;
        let at_once = room.tiles_at_once()?;
        let name = |tile: usize| format!("tile-{tile:06}.gsvx");
        let left: Vec<usize> = tiles.iter().copied().filter(|&t| !scratch.has(&name(t))).collect();
        let mut streams: Vec<PathBuf> = tiles.iter().map(|&t| scratch.path(&name(t))).collect();
        if tiles.is_empty() {
            // The join needs a head.
            scratch.write(NOTHING, &plan.plan.encode_nothing()?.bytes)?;
            streams.push(scratch.path(NOTHING));
        }
        let gaussians = tiles.iter().map(|&t| plan.plan.tile_counts()[t]).sum();
        let input_bytes = plan.inputs.iter().map(|i| i.bytes).sum();
        let mut before = start.elapsed().as_secs_f64();
        let step = Instant::now();
        let mut waited = 0.0;
        if !left.is_empty() {
            let rows = Rows::write(plan, tiles, plan.plan.sh_degree(), scratch)?;
            waited = step.elapsed().as_secs_f64();
            let bar = Steps::new("encode", tiles.len() as u64);
            (left.len()..tiles.len()).for_each(|_| bar.inc());
            for some in left.chunks(at_once) {
                some.par_iter().with_max_len(1).try_for_each(|&tile| {
                    let gaussians = rows.tile(tile)?;
                    let seen = sight.map(|s| s.of(&gaussians).weights).unwrap_or_default();
                    let encoded = plan.plan.encode(tile, &gaussians, &seen)?;
                    scratch.write(&name(tile), &encoded.bytes)?;
                    bar.inc();
                    Ok::<(), anyhow::Error>(())
                })?;
            }
        }
        before += waited;
        let tiles = step.elapsed().as_secs_f64() - waited;
        Ok(Self { streams, gaussians, input_bytes, before, tiles })
    }

    /// Joins the tiles, and says what was made.
    fn write(self, output: Output, mark: &str, report: Reporter) -> Result<()> {
        let step = Instant::now();
        let (name, stdout) = (output.name(), output.is_stdout());
        let indices = self.streams.iter().map(|p| join::head(p)).collect::<Result<Vec<_>>>()?;
        let mut index = Index::default();
        output.write(|out| {
            index = join::write(&self.streams, &indices, out)?;
            Ok(out.write_all(mark.as_bytes())?)
        })?;
        let join = step.elapsed().as_secs_f64();
        let (bytes, coded) = (index.stream_len(), index.header.count);
        let Self { gaussians, input_bytes, before, tiles, .. } = self;
        let human = format!(
            "{name}: {gaussians} Gaussians coded as {coded}, {} -> {} ({:.1} bits per Gaussian), {}\n\
             read and partition {before:.2} s, encode {tiles:.2} s, join {join:.2} s",
            megabytes(input_bytes),
            megabytes(bytes),
            8.0 * bytes as f64 / coded.max(1) as f64,
            counted(self.streams.len() as u64, "tile"),
        );
        let json: Value = json!({
            "output": name,
            "bytes": bytes,
            "input_bytes": input_bytes,
            "input_gaussians": gaussians,
            "gaussians": coded,
            "tiles": self.streams.len(),
            "partition_seconds": before,
            "encode_seconds": tiles,
            "join_seconds": join,
        });
        report.say(stdout, &human, &json)
    }
}

/// Whether models are so large that they are not encoded in memory.
pub(crate) fn is_large(inputs: &[PathBuf]) -> bool {
    let bytes: u64 = inputs.iter().filter_map(|p| std::fs::metadata(p).ok()).map(|m| m.len()).sum();
    memory::in_memory(bytes) > memory::bound(None)
}
