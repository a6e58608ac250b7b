//! `gsvx lod` for PlayCanvas: streams, or SOG as in the format Streamed SOG.
//!
//! Each chunk of leaves becomes a file of its own. `lod-meta.json` lists places: one for each chunk of the finest level.
//! For each level of detail it says which file shows the place, which of the file's Gaussians, and how much the picture
//! of the place differs from that of the finest level. Coarse chunks cover many places, so many places name the same
//! file. Gaussians that are coded exactly belong to no place: all of them are one file, the environment, which is
//! always shown.

use super::{Folder, LodFormat, chunk_name, leaves_of};
use crate::format;
use crate::progress::Meter;
use crate::stream_file::StreamFile;
use anyhow::{Context, Result};
use gs_model::{Format, Scene, sog};
use gsvx::{Index, Kind};
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::Range;

/// Name of the list of places, as PlayCanvas looks for it.
pub(super) const LIST: &str = "lod-meta.json";
/// What the file of all Gaussians that are coded exactly is called.
const EXACT: &str = "exact";

/// Writes the folder. Returns the bytes of all files but the list.
pub(super) fn write(to: &mut Folder<'_>, stream: &mut StreamFile) -> Result<u64> {
    let index = stream.index.clone();
    let is_exact = |&i: &usize| index.chunks[i].kind == Kind::Exact;
    let (exact, leaves): (Vec<usize>, Vec<usize>) = (0..index.chunks.len()).partition(is_exact);
    let (progress, mut bytes) = (Meter::new("files", leaves.len()), 0);
    // File `i` has chunk `i`.
    let mut filenames = Vec::new();
    for chunk in leaves {
        let (name, length) = file(to, stream, &chunk_name(&index, chunk), &[chunk])?;
        bytes += length;
        filenames.push(name);
        progress.inc();
    }
    drop(progress);
    let environment = match exact.is_empty() {
        true => None,
        false => Some(file(to, stream, EXACT, &exact)?),
    };
    bytes += environment.as_ref().map_or(0, |&(_, length)| length);
    let mut places = places(stream, &index)?;
    measure(stream, &mut places)?;
    let levels = usize::from(index.coarsest_lod()) + 1;
    let count = |lod: usize| places.iter().filter_map(|p| p.runs.get(lod)).map(|r| r.1.len()).sum();
    let counts: Vec<usize> = (0..levels).map(count).collect();
    let list = List {
        version: 1,
        asset: Asset { generator: concat!("gsvx ", env!("CARGO_PKG_VERSION")) },
        count: counts.iter().sum(),
        counts,
        lod_levels: levels,
        lod_errors: true,
        environment: environment.map(|(name, _)| name),
        filenames,
        tree: tree(&places),
    };
    to.write(LIST, &serde_json::to_vec(&list)?)?;
    Ok(bytes)
}

/// Writes chunks as one file. Returns its name and length, with the images that belong to it.
fn file(
    to: &mut Folder<'_>,
    stream: &mut StreamFile,
    stem: &str,
    chunks: &[usize],
) -> Result<(String, u64)> {
    if to.args.format != LodFormat::Sog {
        let mut bytes = stream.index.head_of(chunks);
        for (chunk, made) in chunks.iter().zip(Index::parse(&bytes)?.chunks) {
            bytes.extend(stream.bytes(*chunk, made.layers.len())?);
        }
        let name = format!("{stem}.gsvx");
        let length = to.write(&name, &bytes)?;
        return Ok((name, length));
    }
    let mut scene = decoded(stream, chunks[0])?;
    for &chunk in &chunks[1..] {
        scene.append(&decoded(stream, chunk)?);
    }
    let name = format!("{stem}/{}", sog::META);
    let format = Format::named("sog").context("this build writes no SOG")?;
    format::say_coarse_steps(&name, format, &scene);
    let mut length = 0;
    for (part, content) in sog::files_of_chunk(&name, &scene, stream.index.chunks[chunks[0]].lod)? {
        length += to.write(&format!("{stem}/{part}"), &content)?;
    }
    Ok((name, length))
}

/// The Gaussians of a chunk, all layers.
fn decoded(stream: &mut StreamFile, chunk: usize) -> Result<Scene> {
    let layers = stream.index.chunks[chunk].layers.len();
    stream.decode(chunk, layers)
}

/// Least and greatest coordinates.
type Bound = [[f32; 3]; 2];

/// A chunk of the finest level, and what shows it.
struct Place {
    first_cell: u64,
    /// For each level, from the finest, a chunk and which of its Gaussians.
    runs: Vec<(usize, Range<usize>)>,
    /// Of the Gaussians of all levels, to one standard deviation.
    bound: Bound,
    /// For each level.
    errors: Vec<f64>,
}

/// The places, in Morton order, not measured.
fn places(stream: &mut StreamFile, index: &Index) -> Result<Vec<Place>> {
    let starts = |chunk: usize| index.chunks[chunk].first_cell;
    let finest = |&chunk: &usize| Place {
        first_cell: starts(chunk),
        runs: vec![(chunk, 0..index.chunks[chunk].count as usize)],
        bound: Bound::default(),
        errors: Vec::new(),
    };
    let mut places: Vec<Place> = leaves_of(index, 0).iter().map(finest).collect();
    for lod in 1..=index.coarsest_lod() {
        let level = leaves_of(index, lod);
        for (k, &coarse) in level.iter().enumerate() {
            let inside = |p: &&mut Place| {
                (k == 0 || p.first_cell >= starts(coarse))
                    && level.get(k + 1).is_none_or(|&n| p.first_cell < starts(n))
            };
            let mut own: Vec<&mut Place> = places.iter_mut().filter(inside).collect();
            let codes = stream.last_codes(coarse)?;
            let mut first = 0;
            for i in 0..own.len() {
                // A cell that reaches into the next place belongs to that one.
                let end = own.get(i + 1).map_or(codes.len(), |next| {
                    codes.partition_point(|&code| code < next.first_cell)
                });
                own[i].runs.push((coarse, first..end));
                first = end;
            }
        }
    }
    Ok(places)
}

/// Finds the bounds and the errors of places.
fn measure(stream: &mut StreamFile, places: &mut [Place]) -> Result<()> {
    let progress = Meter::new("errors", places.len());
    // The last chunk of each level: places follow each other in it.
    let mut held: Vec<Option<(usize, Scene)>> = Vec::new();
    for place in places {
        held.resize(held.len().max(place.runs.len()), None);
        let mut versions = Vec::new();
        for ((chunk, range), held) in place.runs.iter().zip(&mut held) {
            let (_, scene) = match held.take() {
                Some(same) if same.0 == *chunk => held.insert(same),
                _ => held.insert((*chunk, decoded(stream, *chunk)?)),
            };
            let mut version = Scene { sh_degree: scene.sh_degree, ..Scene::default() };
            version.append_range(scene, range.clone());
            versions.push(version);
        }
        place.bound = versions.iter().map(Scene::extent).reduce(union).unwrap_or_default();
        place.errors = finetune::level_errors(&versions, place.bound);
        progress.inc();
    }
    Ok(())
}

fn union([a, b]: Bound, [c, d]: Bound) -> Bound {
    let of = |f: fn(f32, f32) -> f32, x: [f32; 3], y: [f32; 3]| [0, 1, 2].map(|k| f(x[k], y[k]));
    [of(f32::min, a, c), of(f32::max, b, d)]
}

/// `lod-meta.json`.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct List {
    version: u8,
    asset: Asset,
    count: usize,
    counts: Vec<usize>,
    lod_levels: usize,
    lod_errors: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    environment: Option<String>,
    filenames: Vec<String>,
    tree: Node,
}

#[derive(Serialize)]
struct Asset {
    generator: &'static str,
}

#[derive(Serialize)]
struct Node {
    bound: Corners,
    #[serde(flatten)]
    content: Content,
}

#[derive(Clone, Copy, Serialize)]
struct Corners {
    min: [f32; 3],
    max: [f32; 3],
}

#[derive(Serialize)]
#[serde(untagged)]
enum Content {
    Inner { children: [Box<Node>; 2] },
    Place { lods: BTreeMap<usize, Run>, errors: Vec<f32> },
}

#[derive(Serialize)]
struct Run {
    file: usize,
    offset: usize,
    count: usize,
}

/// A binary tree of places.
fn tree(places: &[Place]) -> Node {
    if let [place] = places {
        let run = |(chunk, range): &(usize, Range<usize>)| Run {
            file: *chunk,
            offset: range.start,
            count: range.len(),
        };
        let shown = place.runs.iter().enumerate().filter(|(_, (_, range))| !range.is_empty());
        let lods = shown.map(|(lod, shown)| (lod, run(shown))).collect();
        let errors = place.errors.iter().map(|&e| e as f32).collect();
        let [min, max] = place.bound;
        return Node { bound: Corners { min, max }, content: Content::Place { lods, errors } };
    }
    let (before, after) = places.split_at(places.len() / 2);
    let children = [before, after].map(|half| Box::new(tree(half)));
    let [a, b] = [&children[0], &children[1]].map(|node| [node.bound.min, node.bound.max]);
    let [min, max] = union(a, b);
    Node { bound: Corners { min, max }, content: Content::Inner { children } }
}
