//! The parts of a stream put together: chunks of leaves, the exact chunk, and the head in front of them.

use super::check::checked_outliers;
use super::encoded::EncodedStream;
use crate::error::Result;
use crate::head::{Chunk, Header, Index, Kind, Layer};
use crate::lossless;
use gpcc_lite::Octree;
use gs_model::Scene;

/// An encoded chunk: its index entry, whose list of layers is still empty, and the layers.
pub(crate) type EncodedChunk = (Chunk, Vec<Vec<u8>>);

/// The index entry of a chunk of leaves, without its layers.
pub(crate) fn leaves_chunk(lod: u8, octree: &Octree) -> Chunk {
    let bounds = bounds_of((0..octree.len()).map(|i| octree.centre(i)));
    let count = octree.len() as u64;
    let first_cell = octree.leaves().first().map_or(0, |leaf| leaf.morton);
    Chunk { kind: Kind::Leaves, lod, count, first_cell, bounds, layers: Vec::new() }
}

/// Least and greatest coordinates.
fn bounds_of(means: impl Iterator<Item = [f32; 3]>) -> [[f32; 3]; 2] {
    means.fold([[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]], |[low, high], mean| {
        let least = std::array::from_fn(|k| low[k].min(mean[k]));
        [least, std::array::from_fn(|k| high[k].max(mean[k]))]
    })
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
pub(crate) fn exact_chunk(scene: &Scene, keep_order: bool) -> (EncodedChunk, Vec<u32>) {
    let bounds = bounds_of(scene.means.iter().copied());
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
///
/// # Errors
/// As [`Index::before`].
pub(crate) fn assemble(header: Header, encoded: Vec<EncodedChunk>) -> Result<EncodedStream> {
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
    let (index, mut bytes) = Index::before(header, chunks)?;
    bytes.extend(payload);
    Ok(EncodedStream { bytes, index, ..EncodedStream::default() })
}

/// Gives a scene another SH degree: coefficients are cut, or zeros are added.
fn at_degree(scene: &mut Scene, degree: u8) {
    let mut other = scene.emptied(degree);
    other.append(scene);
    *scene = other;
}

/// Adds outliers, which fit the leaves, to encoded chunks without empty SH degrees at the end.
pub(crate) fn with_outliers(
    header: &Header,
    chunks: Vec<EncodedChunk>,
    outliers: Option<&Scene>,
) -> Result<(Header, Vec<EncodedChunk>)> {
    let outliers = checked_outliers(outliers, header.sh_degree)?;
    Ok(joined(header, chunks, outliers, outliers.map_or(0, |o| o.sh_degree)))
}

pub(crate) fn joined(
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
