//! `gsvx lod --format 3dtiles`: a tree of 3D Tiles, as CesiumJS reads it.
//!
//! Each chunk becomes a node of the tree. A chunk of a coarse level has as children the finer chunks that replace it. The contents
//! are glTF with SPZ. Gaussians that are coded exactly are a node without coarser ones; those that lie farther away than
//! SPZ holds are left out.
//!
//! 3D Tiles have z up: `(x, z, -y)` of a stream, whose y points down. The transform of the tree has the origin of the scene, or
//! leads to its place on the globe.

use super::Folder;
use super::site::Site;
use crate::exit::note;
use crate::output::counted;
use crate::progress::Meter;
use crate::stream_file::StreamFile;
use anyhow::Result;
use gs_model::spz::{MAX_COORDINATE, ShBits};
use gs_model::{Scene, gltf};
use gsvx::Index;
use serde_json::{Value, json};
use std::io::Write;

/// Name of the tree.
pub(super) const LIST: &str = "tileset.json";
/// Bits of SH coefficients in SPZ. Niantic's 5 and 4 lose about a decibel against the photos, these a fifth of one.
const SH_BITS: ShBits = ShBits { degree_1: 6, rest: 6 };
/// Sides of a cell that a viewer takes for the error of its Gaussian. CesiumJS replaces a node where its error is
/// larger than 16 pixels, and so where cells are larger than 2. Measured on five copies of la_fontaine, against a render
/// of four times the size: a near view fetches 3.7 MB for 26.3 dB with 4, 23.7 MB for 30.3 dB with 8, 58.2 MB for 32.9 dB
/// with 16. A far view fetches 0.2 MB for 28.6 dB, 1.2 MB for 31.8 dB, 7.8 MB for 31.6 dB.
const ERROR_OF_CELL: f64 = 8.0;

/// A node, with the axes of 3D Tiles.
struct Node {
    uri: String,
    error: f64,
    bounds: [[f64; 3]; 2],
    children: Vec<Node>,
}

/// Writes the folder. Returns the bytes of all contents.
pub(super) fn write(
    to: &mut Folder<'_>,
    stream: &mut StreamFile,
    site: Option<Site>,
) -> Result<u64> {
    let index = stream.index.clone();
    let progress = Meter::new("chunks", index.chunks.len());
    let mut tree = Tree { to, stream, index: &index, progress, bytes: 0, left_out: 0 };
    let coarsest = index.coarsest_lod();
    let roots = index.chunks_of_lod(coarsest).map(|chunk| tree.node(chunk));
    let roots: Vec<Node> = roots.filter_map(Result::transpose).collect::<Result<_>>()?;
    let Tree { to, bytes, left_out, .. } = tree;
    if left_out > 0 {
        let these = counted(left_out, "Gaussian");
        note(format_args!(
            "left out: {these} farther than {MAX_COORDINATE} units away, which SPZ does not hold"
        ));
    }
    let transform = transform(site, index.header.origin);
    let list = tileset(&roots, transform).to_string();
    to.write(LIST, list.as_bytes())?;
    Ok(bytes)
}

/// What nodes are made from.
struct Tree<'a, 'f> {
    to: &'a mut Folder<'f>,
    stream: &'a mut StreamFile,
    index: &'a Index,
    progress: Meter,
    bytes: u64,
    /// Gaussians that SPZ does not hold.
    left_out: usize,
}

impl Tree<'_, '_> {
    /// Writes the content of a chunk, and those of all that replace it; none of a chunk that is left out.
    fn node(&mut self, chunk: usize) -> Result<Option<Node>> {
        let finer = self.index.finer(chunk).map(|c| self.node(c));
        let children: Vec<Node> = finer.filter_map(Result::transpose).collect::<Result<_>>()?;
        let layers = self.index.chunks[chunk].layers.len();
        let mut scene = self.stream.decode(chunk, layers)?;
        let held = |m: &[f32; 3]| m.iter().all(|v| v.abs() <= MAX_COORDINATE);
        let near: Vec<usize> = (0..scene.len()).filter(|&i| held(&scene.means[i])).collect();
        if near.len() < scene.len() {
            self.left_out += scene.len() - near.len();
            scene = scene.select(&near);
        }
        if scene.is_empty() {
            return Ok(None);
        }
        // The tree of tiles holds the origin.
        scene.origin = [0.0; 3];
        let uri = format!("{}.glb", super::chunk_name(self.index, chunk));
        self.bytes += content(self.to, &uri, &scene)?;
        self.progress.inc();
        let mut bounds = bounds(&scene);
        children.iter().for_each(|child| widen(&mut bounds, child.bounds));
        let below = children.iter().map(|child| child.error).fold(0.0, f64::max);
        let error = match children.is_empty() {
            true => 0.0,
            false => below.max(ERROR_OF_CELL * self.stream.middle_cell(chunk)?),
        };
        Ok(Some(Node { uri, error, bounds, children }))
    }
}

/// Writes a content. Returns its length.
fn content(to: &mut Folder<'_>, uri: &str, scene: &Scene) -> Result<u64> {
    let name = to.args.output.join(uri).display().to_string();
    let fill = |out: &mut (dyn Write + Send)| Ok(gltf::write_spz(&name, out, scene, SH_BITS)?);
    to.output.write(uri, &[&to.args.input], fill)
}

/// A box around the means, each with the standard deviation of its longest axis on all sides.
fn bounds(scene: &Scene) -> [[f64; 3]; 2] {
    let mut all = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for (mean, log_scale) in scene.means.iter().zip(&scene.log_scales) {
        // SPZ holds no larger log-scale.
        let largest = log_scale.iter().copied().fold(f32::NEG_INFINITY, f32::max).min(6.0);
        let size = libm::exp(f64::from(largest));
        let [x, y, z] = mean.map(f64::from);
        let at = [x, z, -y];
        widen(&mut all, [at.map(|v| v - size), at.map(|v| v + size)]);
    }
    all
}

fn widen(all: &mut [[f64; 3]; 2], [low, high]: [[f64; 3]; 2]) {
    for k in 0..3 {
        all[0][k] = all[0][k].min(low[k]);
        all[1][k] = all[1][k].max(high[k]);
    }
}

/// The matrix, column after column, from the tree to where it stands; `None` if that is where it is.
fn transform(site: Option<Site>, origin: [f64; 3]) -> Option<[f64; 16]> {
    if let Some(site) = site {
        return Some(site.to_earth());
    }
    let [x, y, z] = origin;
    let columns =
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [x, z, -y, 1.0]];
    (origin != [0.0; 3]).then(|| columns.as_flattened().try_into().unwrap_or_default())
}

/// `tileset.json`.
fn tileset(roots: &[Node], transform: Option<[f64; 16]>) -> Value {
    let mut all = roots.first().map_or([[0.0; 3]; 2], |node| node.bounds);
    roots.iter().for_each(|node| widen(&mut all, node.bounds));
    // The error of showing no tile is the diagonal of the scene.
    let error = (0..3).map(|k| all[1][k] - all[0][k]).map(|v| v * v).sum::<f64>().sqrt();
    let mut root = json!({
        "boundingVolume": volume(all),
        "geometricError": error,
        "refine": "REPLACE",
        "children": roots.iter().map(entry).collect::<Vec<_>>(),
    });
    if let Some(transform) = transform {
        root["transform"] = json!(transform);
    }
    let extensions = ["KHR_gaussian_splatting", "KHR_gaussian_splatting_compression_spz_2"];
    json!({
        "asset": { "version": "1.1" },
        "extensionsUsed": ["3DTILES_content_gltf"],
        "extensions": { "3DTILES_content_gltf": {
            "extensionsUsed": extensions, "extensionsRequired": extensions } },
        "geometricError": error,
        "root": root,
    })
}

fn entry(node: &Node) -> Value {
    let mut entry = json!({
        "boundingVolume": volume(node.bounds),
        "geometricError": node.error,
        "content": { "uri": node.uri },
    });
    if !node.children.is_empty() {
        entry["children"] = node.children.iter().map(self::entry).collect();
    }
    entry
}

/// A box: its centre, and half of each edge.
fn volume([low, high]: [[f64; 3]; 2]) -> Value {
    let middle = [0, 1, 2].map(|k| (low[k] + high[k]) / 2.0);
    let [x, y, z] = [0, 1, 2].map(|k| (high[k] - low[k]) / 2.0);
    let [a, b, c] = middle;
    json!({ "box": [a, b, c, x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z] })
}
