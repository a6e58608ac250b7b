//! The encoder: chunks of leaves, levels of detail, and the head in front of them.

use crate::chunk::{self, ChunkEncoder, How};
use crate::error::{Error, Result};
use crate::head::{Chunk, Cube, Header, Index, Kind, Layer, Steps};
use crate::importance;
use crate::lod::{self, LodLevel};
use crate::lossless;
use crate::options::{EncodeOptions, MaxError};
use gpcc_lite::Leaf;
use gs_model::Scene;
use rayon::prelude::*;
use std::ops::Range;
use voxel::{Importance, Merge, Merging, Voxelization};

/// A finished stream.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Encoded {
    /// The stream.
    pub bytes: Vec<u8>,
    /// Its head.
    pub index: Index,
    /// Gaussians that [`EncodeOptions::prune`] left out.
    pub pruned: usize,
    /// Gaussians that the voxelization left out; those that it merged are not counted.
    pub left_out: usize,
    /// Where the finest cells are so coarse that positions err visibly at any quality: parts of the scene lie so
    /// far apart, or differ so much in size, that an octree's 21 levels do not suffice. The parts are better
    /// encoded apart.
    pub coarse_cells: Option<CoarseCells>,
    /// The greatest errors, where [`EncodeOptions::max_error`] bounds them: they have been measured.
    pub max_error: Option<MaxError>,
    /// If [`EncodeOptions::rows`] asks for it, and always of [`encode_lossless`]: the row in which a decoder
    /// returns each Gaussian of the input. Gaussians that were merged share one. [`LEFT_OUT`] stands for
    /// those left out.
    pub rows: Option<Vec<u32>>,
}

/// How coarse the finest cells are; see [`Encoded::coarse_cells`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoarseCells {
    /// Side of a cell, in units of the largest axis of a Gaussian.
    pub cells: f64,
    /// Of the Gaussian below which a tenth of all are smaller, rather than of the median one.
    pub of_small: bool,
}

impl CoarseCells {
    /// Which Gaussians are meant: "typical" or "small".
    #[must_use]
    pub fn which(&self) -> &'static str {
        if self.of_small { "small" } else { "typical" }
    }
}

/// In [`Encoded::rows`]: a Gaussian that is not in the stream.
pub const LEFT_OUT: u32 = u32::MAX;

impl Encoded {
    /// The number of bytes of each part of the stream; see [`Index::parts`].
    #[must_use]
    pub fn parts(&self) -> Vec<(&'static str, u64)> {
        self.index.parts()
    }

    /// The number of Gaussians that are coded bit for bit.
    #[must_use]
    pub fn exact(&self) -> usize {
        let chunks = self.index.chunks.iter().filter(|c| c.kind == Kind::Exact);
        chunks.map(|c| c.count as usize).sum()
    }

    /// The number of Gaussians that are coded exactly where others are not.
    #[must_use]
    pub fn outliers(&self) -> usize {
        let exact = self.exact();
        if exact as u64 == self.index.header.count { 0 } else { exact }
    }

    /// The share of the bytes that Gaussians take that are coded exactly, from 0 to 1.
    #[must_use]
    pub fn exact_share(&self) -> f64 {
        let chunks = self.index.chunks.iter().filter(|c| c.kind == Kind::Exact);
        let bytes: u64 = chunks.flat_map(|c| &c.layers).map(|l| l.len).sum();
        bytes as f64 / self.bytes.len().max(1) as f64
    }
}

impl AsRef<[u8]> for Encoded {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

/// Encodes a voxelized scene.
///
/// `scene` holds one Gaussian per leaf of `voxels`, in leaf order, each at its leaf's centre (what
/// [`voxel::merge`] returns, or a fine-tuned version of it). Importances in `options` are per leaf.
/// `outliers` are coded bit for bit; a decoder returns them behind the leaves, in their order.
///
/// # Errors
/// [`Error::CountMismatch`], [`Error::OffCentre`] or [`Error::NonFinite`] if the scene does not fit,
/// [`Error::InvalidOutlier`] if an outlier does not; [`Error::Coding`] if the leaves are not a valid
/// pruned octree.
pub fn encode_voxels(
    scene: &Scene,
    voxels: &Voxelization,
    outliers: Option<&Scene>,
    options: &EncodeOptions,
) -> Result<Encoded> {
    check_lengths(scene)?;
    if scene.len() != voxels.len() {
        return Err(Error::CountMismatch { scene: scene.len(), leaves: voxels.len() });
    }
    check_centres(scene, voxels)?;
    let given = options.importance.clone();
    if let Some(given) = &given
        && given.len() != scene.len()
    {
        return Err(Error::CountMismatch { scene: given.len(), leaves: scene.len() });
    }
    let importance = given.unwrap_or_else(|| importance::without_cameras(scene));
    let weights = &Importance::Given(importance);
    let own = Voxelization {
        members: (0..voxels.len() as u32).collect(),
        member_offsets: (0..=voxels.len() as u32).collect(),
        dropped: Vec::new(),
        leaves: voxels.leaves.clone(),
        ..*voxels
    };
    let members = &own.members;
    let source = Source { scene, voxels: &own, members, weights, merged: true, whole: None };
    encode_source(&source, outliers, options)
}

/// Encodes a scene bit for bit. Gaussians come back in Morton order of their means, or in their own order
/// at `ceil(log2 N)` bits each. Values need not be valid: NaN, infinities and zero quaternions are kept.
///
/// # Errors
/// [`Error::CountMismatch`] if the arrays of the scene differ in length, [`Error::Limit`] beyond
/// 2^32 - 2 Gaussians.
pub fn encode_lossless(scene: &Scene, keep_order: bool) -> Result<Encoded> {
    check_lengths(scene)?;
    let n = scene.len();
    if n as u64 >= u64::from(u32::MAX) {
        return Err(Error::Limit { points: n as u64, limit: u64::from(u32::MAX) - 1 });
    }
    let header = Header {
        count: n as u64,
        sh_degree: scene.sh_degree,
        j_high: 0,
        cube: Cube { origin: [0.0; 3], side: 1.0 },
        steps: Steps::from_dc(1.0),
    };
    if n == 0 {
        return Ok(Encoded { rows: Some(Vec::new()), ..assemble(header, Vec::new()) });
    }
    let (chunk, order) = exact_chunk(scene, keep_order);
    let mut rows: Vec<u32> = (0..n as u32).collect();
    (0..).zip(&order).for_each(|(row, &i)| rows[i as usize] = row);
    Ok(Encoded { rows: Some(rows), ..assemble(header, vec![chunk]) })
}

/// All arrays of a scene have the lengths that its number of Gaussians and its SH degree ask for.
pub(crate) fn check_lengths(scene: &Scene) -> Result<()> {
    let n = scene.len();
    for len in [scene.opacity_logits.len(), scene.log_scales.len(), scene.rotations.len()] {
        if len != n {
            return Err(Error::CountMismatch { scene: n, leaves: len });
        }
    }
    if scene.sh_degree > 3 || scene.sh.len() != n * scene.sh_len() {
        return Err(Error::CountMismatch { scene: n * scene.sh_len(), leaves: scene.sh.len() });
    }
    Ok(())
}

/// Each Gaussian is at the centre of its leaf, and no leaf is deeper than the finest depth.
pub(crate) fn check_centres(scene: &Scene, voxels: &Voxelization) -> Result<()> {
    let (j_high, max) = (voxels.j_high, gpcc_lite::morton::MAX_DEPTH);
    if j_high > max {
        let source = gpcc_lite::Error::Depth { depth: j_high, max };
        return Err(Error::Coding { what: "geometry", source });
    }
    let cube = Cube::from(voxels.cube);
    let off_centre = |(leaf, mean): (&Leaf, &[f32; 3])| {
        leaf.depth > j_high || cube.leaf_centre(*leaf, j_high) != *mean
    };
    let pairs = voxels.leaves.par_iter().zip(&scene.means).with_min_len(4096);
    match pairs.position_first(off_centre) {
        Some(index) => Err(Error::OffCentre { index }),
        None => Ok(()),
    }
}

/// Steps that a decoder accepts.
pub(crate) fn check_steps(steps: &Steps) -> Result<()> {
    match steps.all().into_iter().find(|&step| !Steps::is_valid(step)) {
        Some(step) => Err(Error::Option {
            option: "quantisation step",
            value: step.into(),
            range: "above 1.2e-38 and below 1e9",
        }),
        None => Ok(()),
    }
}

/// Where the Gaussians of leaves come from.
pub(crate) struct Source<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) voxels: &'a Voxelization,
    /// What the member offsets of `voxels` count: the members of the finest leaves, at every level of detail.
    pub(crate) members: &'a [u32],
    /// Importance of each Gaussian of the scene.
    pub(crate) weights: &'a Importance,
    /// Every leaf has one member, in leaf order, at its centre.
    pub(crate) merged: bool,
    /// What tiles share; `None` without tiles.
    pub(crate) whole: Option<Whole<'a>>,
}

/// What the tiles of a scene share.
#[derive(Clone, Copy)]
pub(crate) struct Whole<'a> {
    /// The tiles: chunks begin where they begin.
    pub(crate) tiles: lod::Tiles<'a>,
    /// Mean importance of leaves.
    pub(crate) mean_importance: f64,
    /// The highest SH degree in use.
    pub(crate) sh_degree: Option<u8>,
}

impl Source<'_> {
    /// The sum of the members' importance, per leaf.
    pub(crate) fn importance(&self) -> Vec<f32> {
        let Importance::Given(importance) = self.weights else { return Vec::new() };
        self.voxels.sums(importance)
    }

    /// Gaussians of SH degree 0 of some leaves.
    fn base(&self, range: Range<usize>) -> Result<Scene> {
        if self.merged {
            let mut part = Scene { sh_degree: 0, ..Scene::default() };
            part.append_range(self.scene, range);
            return Ok(part);
        }
        let part = part_of(self.voxels, self.members, range);
        Ok(Merging::new(self.scene, &part, Merge::Moments, self.weights)?.up_to(0))
    }

    /// Coefficients of one SH degree of some leaves.
    fn sh(&self, range: Range<usize>, degree: u8) -> Result<Vec<[f32; 3]>> {
        if self.merged {
            let (d, k) = (usize::from(degree), self.scene.sh_len());
            let of = |i: usize| &self.scene.sh[i * k + d * d..i * k + (d + 1) * (d + 1)];
            return Ok(range.flat_map(of).copied().collect());
        }
        let part = part_of(self.voxels, self.members, range);
        Ok(Merging::new(self.scene, &part, Merge::Moments, self.weights)?.sh(degree))
    }
}

/// Some of the leaves.
fn part_of(voxels: &Voxelization, members: &[u32], range: Range<usize>) -> Voxelization {
    let offsets = &voxels.member_offsets[range.start..=range.end];
    let (first, last) = (offsets[0], offsets[offsets.len() - 1]);
    Voxelization {
        cube: voxels.cube,
        j_high: voxels.j_high,
        leaves: voxels.leaves[range].to_vec(),
        member_offsets: offsets.iter().map(|o| o - first).collect(),
        members: members[first as usize..last as usize].to_vec(),
        dropped: Vec::new(),
    }
}

/// Encodes the leaves of a source, a chunk at a time on each thread.
pub(crate) fn encode_source(
    source: &Source<'_>,
    outliers: Option<&Scene>,
    options: &EncodeOptions,
) -> Result<Encoded> {
    check_steps(&options.steps)?;
    let outliers = checked_outliers(outliers, source.scene)?;
    let exact_degree = outliers.map_or(0, |o| used_degree(o, options.max_sh_degree));
    let used = || used_degree(source.scene, options.max_sh_degree).max(exact_degree);
    let sh_degree = source.whole.and_then(|w| w.sh_degree).unwrap_or_else(used);
    let importance = source.importance();
    let header = Header {
        count: 0,
        sh_degree,
        j_high: source.voxels.j_high,
        cube: source.voxels.cube.into(),
        steps: options.steps,
    };
    let how = How {
        steps: &options.steps,
        sh_degree,
        fit: true,
        // What saves bits on average makes single errors large.
        lambda: options.max_error.map(|_| 0.0),
    };
    let tiles = source.whole.map_or(lod::Tiles::ONE, |w| w.tiles);
    let levels = lod::levels(source.voxels, options, tiles);
    let mut jobs = Vec::new();
    for level in levels.iter().rev() {
        let importance = level.sum(&importance);
        let classes = if options.uniform_precision {
            vec![f32::from(importance::MEAN_CLASS); importance.len()]
        } else if let Some(Whole { mean_importance, .. }) = source.whole.filter(|_| level.lod == 0)
        {
            importance::log_classes_about(mean_importance, &importance, options.steps.covariance)
        } else {
            // Relative to the mean of the tile.
            let of = |tile: &Range<usize>| {
                importance::log_classes(&importance[tile.clone()], options.steps.covariance)
            };
            level.tiles.iter().flat_map(of).collect()
        };
        jobs.push((level, classes));
    }
    drop(importance);
    let each = jobs.iter().flat_map(|(level, classes)| {
        level.cuts.windows(2).map(move |cut| (*level, &classes[..], cut[0]..cut[1]))
    });
    let encode = |(level, classes, range): (&LodLevel, &[f32], Range<usize>)| {
        encode_chunk(how, &header, source, (level, classes, range))
    };
    let each: Vec<_> = each.collect();
    // At most a quarter of the Gaussians at a time, for memory's sake: a chunk keeps two cores busy.
    let at_once = (each.len() / 4).clamp(1, rayon::current_num_threads());
    let mut chunks = Vec::with_capacity(each.len());
    for some in each.chunks(at_once) {
        let encoded: Vec<_> =
            some.par_iter().with_max_len(1).map(|job| encode(job.clone())).collect();
        // The first error, on any number of threads.
        chunks.extend(encoded.into_iter().collect::<Result<Vec<_>>>()?);
    }
    let chunks = without_zero_degrees(chunks, exact_degree);
    let (header, chunks) = joined(&header, chunks, outliers, exact_degree);
    let left_out = source.voxels.dropped.len();
    let rows = options.rows.then(|| source.voxels.leaf_of_each(source.scene.len()));
    Ok(Encoded { left_out, rows, ..assemble(header, chunks) })
}

/// Adds outliers, which fit the leaves, to encoded chunks without empty SH degrees at the end.
pub(crate) fn with_outliers(
    header: &Header,
    chunks: Vec<EncodedChunk>,
    outliers: Option<&Scene>,
) -> Result<(Header, Vec<EncodedChunk>)> {
    let leaves = Scene { sh_degree: header.sh_degree, ..Scene::default() };
    let outliers = checked_outliers(outliers, &leaves)?;
    Ok(joined(header, chunks, outliers, outliers.map_or(0, |o| o.sh_degree)))
}

fn joined(
    header: &Header,
    mut chunks: Vec<EncodedChunk>,
    outliers: Option<&Scene>,
    exact_degree: u8,
) -> (Header, Vec<EncodedChunk>) {
    let sh_degree = chunks.first().map_or(exact_degree, |c| c.1.len() as u8 - 1);
    if let Some(outliers) = outliers {
        let mut outliers = outliers.clone();
        at_degree(&mut outliers, sh_degree);
        chunks.push(exact_chunk(&outliers, true).0);
    }
    let of_finest = |(chunk, _): &&(Chunk, _)| chunk.lod == 0;
    let count = chunks.iter().filter(of_finest).map(|(chunk, _)| chunk.count).sum();
    (Header { count, sh_degree, ..header.clone() }, chunks)
}

/// An encoded chunk: its index entry, whose list of layers is still empty, and the layers.
pub(crate) type EncodedChunk = (Chunk, Vec<Vec<u8>>);

fn encode_chunk(
    how: How<'_>,
    header: &Header,
    source: &Source<'_>,
    (level, classes, range): (&LodLevel, &[f32], Range<usize>),
) -> Result<EncodedChunk> {
    let coarse = level.lod > 0;
    let source = Source {
        voxels: level.voxels.as_ref().unwrap_or(source.voxels),
        merged: source.merged && !coarse,
        ..*source
    };
    let base = source.base(range.clone())?;
    chunk::check(&base, range.start)?;
    let leaves = source.voxels.leaves[range.clone()].to_vec();
    let chunk = leaves_chunk(header, level.lod, &leaves);
    // Coarse levels are seen for a moment or from afar, so they have base layers only.
    let how = How { sh_degree: if coarse { 0 } else { how.sh_degree }, ..how };
    let sh = |degree, piece: Range<usize>| {
        let leaves = range.start + piece.start..range.start + piece.end;
        let sh = source.sh(leaves.clone(), degree)?;
        chunk::check_sh(&sh, usize::from(2 * degree + 1), leaves.start)?;
        Ok(sh)
    };
    let encoder = ChunkEncoder::new(leaves, header.j_high, &classes[range.clone()])?;
    let mut layers = encoder.encode(&how, base, sh)?;
    layers.resize(1 + usize::from(header.sh_degree), Vec::new());
    Ok((chunk, layers))
}

/// The index entry of a chunk of leaves, without its layers.
pub(crate) fn leaves_chunk(header: &Header, lod: u8, leaves: &[Leaf]) -> Chunk {
    let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for leaf in leaves {
        let mean = header.cube.leaf_centre(*leaf, header.j_high);
        for k in 0..3 {
            bounds[0][k] = bounds[0][k].min(mean[k]);
            bounds[1][k] = bounds[1][k].max(mean[k]);
        }
    }
    let count = leaves.len() as u64;
    let first_cell = leaves.first().map_or(0, |leaf| leaf.morton);
    Chunk { kind: Kind::Leaves, lod, count, first_cell, bounds, layers: Vec::new() }
}

/// Leaves out SH degrees above `least` at the end that are empty in every chunk.
pub(crate) fn without_zero_degrees(mut chunks: Vec<EncodedChunk>, least: u8) -> Vec<EncodedChunk> {
    let used = chunks.iter().map(|(_, layers)| {
        layers.iter().rposition(|layer| !layer.is_empty()).map_or(1, |last| last + 1)
    });
    let used = used.max().unwrap_or(1).max(1 + usize::from(least));
    chunks.iter_mut().for_each(|(_, layers)| layers.truncate(used));
    chunks
}

/// A chunk of Gaussians bit for bit, and the order in which they come back.
fn exact_chunk(scene: &Scene, keep_order: bool) -> (EncodedChunk, Vec<u32>) {
    let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for mean in &scene.means {
        for k in 0..3 {
            bounds[0][k] = bounds[0][k].min(mean[k]);
            bounds[1][k] = bounds[1][k].max(mean[k]);
        }
    }
    let chunk = Chunk {
        kind: Kind::Exact,
        lod: 0,
        count: scene.len() as u64,
        first_cell: 0,
        bounds,
        layers: Vec::new(),
    };
    let (payload, order) = lossless::encode_payload(scene, keep_order);
    ((chunk, vec![payload]), order)
}

/// Puts head and layers together.
pub(crate) fn assemble(header: Header, encoded: Vec<EncodedChunk>) -> Encoded {
    let mut chunks = Vec::with_capacity(encoded.len());
    let mut payload =
        Vec::with_capacity(encoded.iter().flat_map(|chunk| &chunk.1).map(Vec::len).sum());
    for (mut chunk, layers) in encoded {
        for bytes in layers {
            let layer = Layer { offset: 0, len: bytes.len() as u64, crc: crc32c::crc32c(&bytes) };
            chunk.layers.push(layer);
            payload.extend(bytes);
        }
        chunks.push(chunk);
    }
    let mut bytes = Index::to_bytes(&header, &chunks);
    let head_len = bytes.len() as u64;
    let mut offset = head_len;
    for layer in chunks.iter_mut().flat_map(|c| &mut c.layers) {
        layer.offset = offset;
        offset += layer.len;
    }
    bytes.extend(payload);
    Encoded { bytes, index: Index { header, chunks, head_len }, ..Encoded::default() }
}

/// Outliers that fit the scene of the leaves.
fn checked_outliers<'a>(outliers: Option<&'a Scene>, leaves: &Scene) -> Result<Option<&'a Scene>> {
    let Some(outliers) = outliers.filter(|o| !o.is_empty()) else { return Ok(None) };
    if outliers.sh_degree > leaves.sh_degree {
        return Err(Error::Option {
            option: "SH degree of the outliers",
            value: outliers.sh_degree.into(),
            range: "at most that of the leaves",
        });
    }
    check_lengths(outliers)?;
    match outliers.invalid().first {
        Some(first) => Err(Error::InvalidOutlier { index: first.index, field: first.field }),
        None => Ok(Some(outliers)),
    }
}

/// Gives a scene another SH degree: coefficients are cut, or zeros are added.
fn at_degree(scene: &mut Scene, degree: u8) {
    let mut other = Scene { sh_degree: degree, ..Scene::default() };
    other.append(scene);
    *scene = other;
}

/// The highest degree, up to `most`, with a coefficient that is not zero.
pub(crate) fn used_degree(scene: &Scene, most: u8) -> u8 {
    let mut degree = scene.sh_degree.min(most);
    if scene.is_empty() {
        return degree;
    }
    let zero = |v: &[f32; 3]| v.iter().all(|&x| x == 0.0);
    while degree > 0 {
        let d = usize::from(degree);
        let own = |sh: &[[f32; 3]]| sh[d * d..(d + 1) * (d + 1)].iter().all(zero);
        if !scene.sh.par_chunks(scene.sh_len()).all(own) {
            break;
        }
        degree -= 1;
    }
    degree
}

impl From<voxel::Cube> for Cube {
    fn from(cube: voxel::Cube) -> Self {
        Self { origin: cube.origin, side: cube.side }
    }
}
