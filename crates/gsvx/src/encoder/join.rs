//! [`join`]: one stream from the streams of the parts of a scene. No chunk is decoded, and no byte of one is looked
//! at: a new head is made, and the layers follow it in Morton order.

use crate::error::{Error, Result};
use crate::head::{Chunk, Header, Index, Kind, Layer};
use std::ops::Range;

/// How a joined stream is put together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JoinOutcome {
    /// The head; [`JoinOutcome::pieces`] follow it.
    pub head: Vec<u8>,
    /// Ranges of the streams that were joined: the number of the stream, and bytes of it.
    pub pieces: Vec<(usize, Range<u64>)>,
    /// What the head says.
    pub index: Index,
}

/// Joins streams of the same octree and the same steps whose leaves do not overlap. Streams without Gaussians may be
/// among them. What is left to decide here: the number of Gaussians, and which SH degrees are empty
/// everywhere and left out.
///
/// # Errors
/// [`Error::NotOneScene`] if streams differ in what parts of a scene share, or overlap; if they have
/// different levels of detail, or exact Gaussians.
pub fn join(streams: &[Index]) -> Result<JoinOutcome> {
    let Some(first) = streams.first() else { return Ok(JoinOutcome::default()) };
    let mut sh_degree = 0;
    let mut chunks: Vec<(usize, &Chunk)> = Vec::new();
    for (number, stream) in streams.iter().enumerate() {
        let not_one = |why| Error::NotOneScene { first: 0, second: number, why };
        let common = |header: &Header| Header { count: 0, sh_degree: 0, ..header.clone() };
        if stream.header.antialiased != first.header.antialiased {
            return Err(not_one("one is antialiased, the other is not"));
        }
        if stream.header.origin != first.header.origin {
            return Err(not_one("their origins differ"));
        }
        if common(&stream.header) != common(&first.header) {
            return Err(not_one("their octrees or steps differ"));
        }
        if stream.chunks.iter().any(|c| c.kind != Kind::Leaves) {
            return Err(not_one("exact Gaussians cannot be joined"));
        }
        let levels = |s: &Index| (!s.chunks.is_empty()).then(|| s.coarsest_lod());
        if levels(stream).zip(streams.iter().find_map(levels)).is_some_and(|(a, b)| a != b) {
            return Err(not_one("they have different levels of detail"));
        }
        if !stream.chunks.is_empty() {
            sh_degree = sh_degree.max(stream.header.sh_degree);
        }
        chunks.extend(stream.chunks.iter().map(|c| (number, c)));
    }
    if chunks.is_empty() {
        sh_degree = first.header.sh_degree;
    }
    // The coarsest level first, each in Morton order.
    let place = |c: &Chunk| (u8::MAX - c.lod, c.first_cell);
    chunks.sort_by_key(|(_, c)| place(c));
    if let Some(w) = chunks.windows(2).find(|w| place(w[0].1) == place(w[1].1)) {
        return Err(Error::NotOneScene { first: w[0].0, second: w[1].0, why: "they overlap" });
    }
    let count = chunks.iter().filter(|(_, c)| c.lod == 0).map(|(_, c)| c.count).sum();
    let header = Header { count, sh_degree, ..first.header.clone() };
    put_together(header, &chunks)
}

fn put_together(header: Header, chunks: &[(usize, &Chunk)]) -> Result<JoinOutcome> {
    let mut pieces: Vec<(usize, Range<u64>)> = Vec::new();
    let mut joined = Vec::with_capacity(chunks.len());
    for &(number, chunk) in chunks {
        let mut chunk = chunk.clone();
        for layer in chunk.layers.iter().filter(|l| l.len > 0) {
            let range = layer.range();
            match pieces.last_mut() {
                Some((last, bytes)) if *last == number && bytes.end == range.start => {
                    bytes.end = range.end;
                }
                _ => pieces.push((number, range)),
            }
        }
        // The checksum of no bytes is 0.
        let empty = Layer { offset: 0, len: 0, crc: 0 };
        chunk.layers.resize(1 + usize::from(header.sh_degree), empty);
        joined.push(chunk);
    }
    let (index, head) = Index::before(header, joined)?;
    Ok(JoinOutcome { head, pieces, index })
}
