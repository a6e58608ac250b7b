//! `gsvx lod`: a stream as a folder of small files that a viewer loads by distance: streams for PlayCanvas, or 3D
//! Tiles (`tiles.rs`).
//!
//! For PlayCanvas each chunk of leaves becomes a stream of its own. `lod-meta.json` lists places: one for each chunk of the finest level.
//! For each level of detail it says which file shows the place, and which of the file's Gaussians. Coarse chunks
//! cover many places, so many places name the same file. Gaussians that are coded exactly belong to no place: all of
//! them are one stream, the environment, which is always shown.

mod site;
mod tiles;

use crate::exit::{note, usage};
use crate::input::{self, Limit};
use crate::output::OutputFolder;
use crate::progress::Meter;
use crate::report::Reporter;
use crate::stream_file::StreamFile;
use anyhow::{Result, bail};
use clap::ValueEnum;
use gsvx::{Index, Kind};
use indicatif::DecimalBytes;
use serde_json::{Value, json};
use site::Site;
use std::ops::Range;
use std::path::PathBuf;

pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx encode city.ply -o city.gsvx --web
  gsvx lod city.gsvx -o web/          put web/ on a server and give PlayCanvas web/lod-meta.json
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
    /// lod-meta.json and small streams, for PlayCanvas.
    Playcanvas,
    /// tileset.json and glTF with SPZ (KHR_gaussian_splatting_compression_spz_2), for CesiumJS. SPZ loses more than
    /// the stream, and takes more bytes.
    #[value(name = "3dtiles")]
    Tiles,
}

/// Name of the list of places, as PlayCanvas looks for it.
const LIST: &str = "lod-meta.json";
/// Name of the stream of all Gaussians that are coded exactly.
const EXACT: &str = "exact.gsvx";

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
    let (list, bytes) = match args.format {
        LodFormat::Playcanvas => (LIST, write_streams(&mut to, &mut stream, &index)?),
        LodFormat::Tiles => (tiles::LIST, tiles::write(&mut to, &mut stream, args.at)?),
    };
    to.output.put_in_place()?;
    let levels = u32::from(index.coarsest_lod()) + 1;
    let files = index.chunks.len();
    let places = leaves_of(&index, 0).len();
    let mut human = format!(
        "{}: {places} places at {levels} levels of detail, in {files} files of {}",
        args.output.join(list).display(),
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

/// Writes the folder for PlayCanvas. Returns the bytes of all streams.
fn write_streams(to: &mut Folder<'_>, stream: &mut StreamFile, index: &Index) -> Result<u64> {
    let mut bytes = 0;
    let files = files(index);
    let progress = Meter::new("files", files.len());
    for (name, chunks) in &files {
        bytes += write_chunks(to, stream, index, name, chunks)?;
        progress.inc();
    }
    let places = places(stream, index)?;
    let names: Vec<&String> = files.iter().map(|(name, _)| name).collect();
    let list = list(index, &places, &names).to_string();
    to.write(LIST, list.as_bytes())?;
    Ok(bytes)
}

/// The chunks of leaves of a level of detail.
fn leaves_of(index: &Index, lod: u8) -> Vec<usize> {
    let leaves = |&i: &usize| index.chunks[i].kind == Kind::Leaves;
    index.chunks_of_lod(lod).filter(leaves).collect()
}

/// The files, and the chunks in each. File `i` has chunk `i` of leaves; the last has the exact chunks, if there are any.
fn files(index: &Index) -> Vec<(String, Vec<usize>)> {
    let is_exact = |&i: &usize| index.chunks[i].kind == Kind::Exact;
    let (exact, leaves): (Vec<usize>, Vec<usize>) = (0..index.chunks.len()).partition(is_exact);
    let of_leaves = |i| (format!("{}.gsvx", chunk_name(index, i)), vec![i]);
    let mut files: Vec<_> = leaves.into_iter().map(of_leaves).collect();
    if !exact.is_empty() {
        files.push((EXACT.into(), exact));
    }
    files
}

/// What a file of one chunk is called: its level of detail and its number.
fn chunk_name(index: &Index, chunk: usize) -> String {
    format!("{}-{chunk}", index.chunks[chunk].lod)
}

/// Writes chunks as a stream. Returns its length.
fn write_chunks(
    to: &mut Folder<'_>,
    stream: &mut StreamFile,
    index: &Index,
    name: &str,
    chunks: &[usize],
) -> Result<u64> {
    let mut bytes = index.head_of(chunks);
    for (chunk, made) in chunks.iter().zip(Index::parse(&bytes)?.chunks) {
        bytes.extend(stream.bytes(*chunk, made.layers.len())?);
    }
    to.write(name, &bytes)
}

/// A place: a chunk of the finest level, and which Gaussians of which chunk show it at each coarser level.
struct Place {
    chunk: usize,
    coarser: Vec<(usize, Range<usize>)>,
}

/// The places, in Morton order.
fn places(stream: &mut StreamFile, index: &Index) -> Result<Vec<Place>> {
    let finest = leaves_of(index, 0);
    let mut places: Vec<Place> =
        finest.iter().map(|&chunk| Place { chunk, coarser: Vec::new() }).collect();
    for lod in 1..=index.coarsest_lod() {
        let level = leaves_of(index, lod);
        for (k, &coarse) in level.iter().enumerate() {
            let starts = |c: usize| index.chunks[c].first_cell;
            let inside = |p: &&mut Place| {
                let at = starts(p.chunk);
                (k == 0 || at >= starts(coarse)) && level.get(k + 1).is_none_or(|&n| at < starts(n))
            };
            let mut own: Vec<&mut Place> = places.iter_mut().filter(inside).collect();
            let codes = stream.last_codes(coarse)?;
            let mut first = 0;
            for i in 0..own.len() {
                // A cell that reaches into the next place belongs to that one.
                let end = own.get(i + 1).map_or(codes.len(), |next| {
                    codes.partition_point(|&code| code < starts(next.chunk))
                });
                own[i].coarser.push((coarse, first..end));
                first = end;
            }
        }
    }
    Ok(places)
}

/// `lod-meta.json`.
fn list(index: &Index, places: &[Place], files: &[&String]) -> Value {
    let bound = |[min, max]: [[f32; 3]; 2]| json!({ "min": min, "max": max });
    let node = |place: &Place| {
        let chunk = &index.chunks[place.chunk];
        let fine = (place.chunk, 0..chunk.count as usize);
        let levels = std::iter::once(&fine).chain(&place.coarser).enumerate();
        let of_level = |(lod, (file, range)): (usize, &(usize, Range<usize>))| {
            let shown = json!({ "file": file, "offset": range.start, "count": range.len() });
            (lod.to_string(), shown)
        };
        let lods: serde_json::Map<String, Value> = levels.map(of_level).collect();
        json!({ "bound": bound(chunk.bounds), "lods": lods })
    };
    let mut all = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for place in places {
        let [low, high] = index.chunks[place.chunk].bounds;
        for k in 0..3 {
            all[0][k] = all[0][k].min(low[k]);
            all[1][k] = all[1][k].max(high[k]);
        }
    }
    let mut list = json!({
        "lodLevels": u32::from(index.coarsest_lod()) + 1,
        "filenames": files,
        "tree": { "bound": bound(all), "children": places.iter().map(node).collect::<Vec<_>>() },
    });
    if index.chunks.iter().any(|c| c.kind == Kind::Exact) {
        list["environment"] = json!(EXACT);
    }
    list
}
