//! `gsvx lod`: a stream as a folder of small files that a viewer loads part by part: what PlayCanvas streams
//! (`places.rs`), or 3D Tiles (`tiles.rs`).

mod places;
mod site;
mod tiles;

use crate::exit::{note, usage};
use crate::format;
use crate::input::{self, Limit};
use crate::output::{OutputFolder, counted};
use crate::report::Reporter;
use crate::stream_file::StreamFile;
use anyhow::{Result, bail};
use clap::ValueEnum;
use gs_model::Format;
use gsvx::{Index, Kind};
use indicatif::DecimalBytes;
use serde_json::json;
use site::Site;
use std::path::PathBuf;

pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx encode city.ply -o city.gsvx --web
  gsvx lod city.gsvx -o web/          put web/ on a server and give PlayCanvas web/lod-meta.json
  gsvx lod city.gsvx -o web/ --format sog    for viewers without gsvx: PlayCanvas, SuperSplat, Babylon.js
  gsvx lod city.gsvx -o tiles/ --format 3dtiles --at 2.2945,48.8582,35    for CesiumJS: tiles/tileset.json";

#[derive(clap::Args)]
pub(crate) struct LodArgs {
    /// The stream; one that was encoded with --lod or --web has coarse levels.
    #[arg(value_name = "STREAM")]
    input: PathBuf,
    /// Folder for lod-meta.json or tileset.json and the files that it names; made if it is not there.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Whom the folder is for.
    #[arg(long, value_name = "FORMAT", default_value = "playcanvas")]
    format: LodFormat,
    /// With 3dtiles: where on the globe the origin of the scene is (gsvx info names it if it is not 0), in degrees and
    /// metres above the ellipsoid. One unit is a metre, x points east, y down, z north.
    #[arg(long, value_name = "LON,LAT,HEIGHT", value_parser = site::parse, allow_hyphen_values = true)]
    at: Option<Site>,
    #[command(flatten)]
    limit: Limit,
    /// Write into a folder that is not empty, and replace files there.
    #[arg(long)]
    force: bool,
}

/// What the folder holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LodFormat {
    /// lod-meta.json and small streams, for PlayCanvas with the parser of the npm package gsvx.
    Playcanvas,
    /// lod-meta.json and SOG of several files (streamed SOG), for PlayCanvas alone and others that read it. SOG takes
    /// more bytes than streams.
    Sog,
    /// tileset.json and glTF with SPZ (KHR_gaussian_splatting_compression_spz_2), for CesiumJS. SPZ loses more than
    /// the stream, and takes more bytes.
    #[value(name = "3dtiles")]
    Tiles,
}

/// Writes the folder.
pub(crate) fn run(args: &LodArgs, report: Reporter) -> Result<()> {
    if args.at.is_some() && args.format != LodFormat::Tiles {
        return Err(usage("--at: only --format 3dtiles has a place on the globe"));
    }
    let mut stream = StreamFile::open(&args.input)?;
    let index = stream.index.clone();
    args.limit.check(&args.input, index.header.count)?;
    let name = input::name(&args.input);
    if index.chunks.iter().all(|c| c.kind == Kind::Exact) {
        bail!("{name}: is lossless, so it has no octree to divide; encode without --lossless");
    }
    let [x, y, z] = index.header.origin;
    if args.at.is_some() && index.header.origin != [0.0; 3] {
        note(format_args!(
            "note: {name}: --at is taken as the place of the scene's origin, ({x}, {y}, {z}), which positions are relative to"
        ));
    }
    let mut to = Folder { output: OutputFolder::open(&args.output, args.force)?, args };
    if let (LodFormat::Sog, Some(sog)) = (args.format, Format::named("sog")) {
        format::say_lost_origin(&args.output.display().to_string(), sog, index.header.origin);
    }
    let (list, bytes) = match args.format {
        LodFormat::Playcanvas | LodFormat::Sog => {
            (places::LIST, places::write(&mut to, &mut stream)?)
        }
        LodFormat::Tiles => (tiles::LIST, tiles::write(&mut to, &mut stream, args.at)?),
    };
    // Beside the list.
    let files = to.output.len() - 1;
    to.output.put_in_place()?;
    let levels = u32::from(index.coarsest_lod()) + 1;
    let places = leaves_of(&index, 0).len();
    let mut human = format!(
        "{}: {} at {} of detail, in {} of {}",
        args.output.join(list).display(),
        counted(places, "place"),
        counted(levels, "level"),
        counted(files, "file"),
        DecimalBytes(bytes)
    );
    if levels == 1 {
        human += "\nThe stream has no coarse levels, so a place is shown whole or not at all. gsvx encode --lod makes them.";
    }
    let json = json!({
        "output": args.output.display().to_string(),
        "places": places,
        "levels": levels,
        "files": files,
        "bytes": bytes,
    });
    report.say(false, &human, &json)
}

/// Where the files go.
struct Folder<'a> {
    output: OutputFolder,
    args: &'a LodArgs,
}

impl Folder<'_> {
    /// Writes a file. Returns its length.
    fn write(&mut self, name: &str, bytes: &[u8]) -> Result<u64> {
        self.output.write(name, &[&self.args.input], |out| Ok(out.write_all(bytes)?))
    }
}

/// The chunks of leaves of a level of detail.
fn leaves_of(index: &Index, lod: u8) -> Vec<usize> {
    let leaves = |&i: &usize| index.chunks[i].kind == Kind::Leaves;
    index.chunks_of_lod(lod).filter(leaves).collect()
}

/// What a file of one chunk is called: its level of detail and its number.
fn chunk_name(index: &Index, chunk: usize) -> String {
    format!("{}-{chunk}", index.chunks[chunk].lod)
}
