//! A reader for streams that arrive in parts: it does no I/O.
//!
//! It says which byte ranges it needs for which chunks and layers, takes bytes in any order and of any
//! length, and hands out chunks as soon as they are whole.
//!
//! ```
//! # #[cfg(feature = "encode")] {
//! # use gsvx::{EncodeOptions, Reader};
//! # let scene = gs_model::Scene {
//! #     means: (0..50).map(|i| [i as f32, (i * i % 7) as f32, 0.0]).collect(),
//! #     rotations: vec![[1.0, 0.0, 0.0, 0.0]; 50], log_scales: vec![[-2.0; 3]; 50],
//! #     opacity_logits: vec![1.0; 50], sh_degree: 0, sh: vec![[0.3; 3]; 50],
//! #     ..Default::default()
//! # };
//! # let stream = gsvx::encode(&scene, None, 80.0, &EncodeOptions::default())?.bytes;
//! let fetch = |range: std::ops::Range<u64>| &stream[range.start as usize..range.end as usize];
//! let mut reader = Reader::new();
//! while let Some(range) = reader.head_needs() {
//!     let end = range.end.min(stream.len() as u64);
//!     reader.give(range.start, fetch(range.start..end))?;
//! }
//! for range in reader.needs(0, 1) {
//!     reader.give(range.start, fetch(range))?;
//! }
//! let gaussians = reader.decode(0, 1)?;
//! assert!(!gaussians.is_empty());
//! # }
//! # Ok::<(), gsvx::Error>(())
//! ```

mod held;

use crate::decoded_chunk::DecodedChunk;
use crate::error::Result;
use crate::head::{Index, PREAMBLE, head_len};
use held::HeldChunk;
use std::ops::Range;

/// Bytes of a stream's start that are asked for first: the heads of scenes up to some million
/// Gaussians fit.
const FIRST: u64 = 4096;

/// A stream that arrives in parts.
#[derive(Debug, Default)]
pub struct Reader {
    /// All that has arrived, until the index is known.
    start: Buffer,
    index: Option<Index>,
    /// The layers of each chunk, as far as they have arrived.
    layers: Vec<Vec<Buffer>>,
    decoded: DecodedChunk,
    /// What of which chunk is decoded.
    held: Option<HeldChunk>,
    max_gaussians: Option<u64>,
}

/// What has arrived of a range of the stream. Its memory is that of the bytes that have arrived.
#[derive(Clone, Debug, Default)]
struct Buffer {
    /// Ascending, and with gaps between them.
    pieces: Vec<Piece>,
}

/// Consecutive bytes.
#[derive(Clone, Debug)]
struct Piece {
    start: u64,
    bytes: Vec<u8>,
}

impl Piece {
    fn end(&self) -> u64 {
        self.start + self.bytes.len() as u64
    }

    /// Puts in bytes that overlap or touch this piece.
    fn join(&mut self, at: u64, bytes: &[u8]) {
        if at < self.start {
            let gap = (self.start - at) as usize;
            self.bytes.splice(..0, std::iter::repeat_n(0, gap));
            self.start = at;
        }
        let offset = (at - self.start) as usize;
        if self.bytes.len() < offset + bytes.len() {
            self.bytes.resize(offset + bytes.len(), 0);
        }
        self.bytes[offset..offset + bytes.len()].copy_from_slice(bytes);
    }
}

impl Buffer {
    /// Puts in bytes at `at`; they replace what was there. The end fits 64 bits.
    fn put(&mut self, at: u64, bytes: &[u8]) {
        let end = at + bytes.len() as u64;
        if end == at {
            return;
        }
        let first = self.pieces.partition_point(|p| p.end() < at);
        let last = self.pieces.partition_point(|p| p.start <= end);
        if first == last {
            self.pieces.insert(first, Piece { start: at, bytes: bytes.to_vec() });
            return;
        }
        let others: Vec<Piece> = self.pieces.drain(first + 1..last).collect();
        let piece = &mut self.pieces[first];
        piece.join(at, bytes);
        for other in others {
            let known = piece.end();
            if other.end() > known {
                piece.join(known, &other.bytes[(known - other.start) as usize..]);
            }
        }
    }

    /// The bytes that have arrived from the beginning on.
    fn front(&self) -> &[u8] {
        self.pieces.first().filter(|p| p.start == 0).map_or(&[], |p| &p.bytes)
    }
}

impl Reader {
    /// A reader of which nothing is known yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// A reader that accepts so many Gaussians in a chunk. [`Reader::new`] derives the number from the chunk's bytes:
    /// [`default_max_gaussians`](crate::default_max_gaussians).
    #[must_use]
    pub fn with_max_gaussians(most: u64) -> Self {
        Self { max_gaussians: Some(most), ..Self::default() }
    }

    /// The bytes that are needed before the index is known; `None` when it is. The range may reach
    /// beyond the end of a short stream.
    #[must_use]
    pub fn head_needs(&self) -> Option<Range<u64>> {
        if self.index.is_some() {
            return None;
        }
        let front = self.start.front();
        let end = if front.len() < PREAMBLE { FIRST } else { head_len(front).unwrap_or(FIRST) };
        Some(front.len() as u64..end)
    }

    /// The head, once it has arrived.
    #[must_use]
    pub fn index(&self) -> Option<&Index> {
        self.index.as_ref()
    }

    /// Takes bytes of the stream that begin at `offset`, whether they were asked for or not.
    ///
    /// # Errors
    /// Damage of the head, as soon as it shows. All that was given is forgotten then: the head can be given again.
    pub fn give(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        if let Some(index) = &self.index {
            put_layers(index, &mut self.layers, offset, bytes);
            return Ok(());
        }
        if offset.checked_add(bytes.len() as u64).is_some() {
            self.start.put(offset, bytes);
        }
        self.read_head().inspect_err(|_| self.start = Buffer::default())
    }

    /// Reads the index, if the whole head has arrived.
    fn read_head(&mut self) -> Result<()> {
        let front = self.start.front();
        if front.len() < PREAMBLE || (front.len() as u64) < head_len(front)? {
            return Ok(());
        }
        let index = Index::parse(front)?;
        let empty = |c: &crate::Chunk| vec![Buffer::default(); c.layers.len()];
        self.layers = index.chunks.iter().map(empty).collect();
        // Bytes that have arrived beyond the head belong to layers.
        for piece in std::mem::take(&mut self.start).pieces {
            put_layers(&index, &mut self.layers, piece.start, &piece.bytes);
        }
        self.index = Some(index);
        Ok(())
    }

    /// The byte ranges that are missing to hold the first `layers` layers of a chunk ([`Reader::hold`]): none of layers
    /// that are held already. Nothing for a chunk that is not there.
    #[must_use]
    pub fn needs(&self, chunk: usize, layers: usize) -> Vec<Range<u64>> {
        let Some(entry) = self.index.as_ref().and_then(|i| i.chunks.get(chunk)) else {
            return Vec::new();
        };
        let mut missing: Vec<Range<u64>> = Vec::new();
        let wanted = entry.layers.iter().zip(&self.layers[chunk]).take(layers);
        for (layer, buffer) in wanted.skip(self.held_layers(chunk, layers)) {
            let mut at = 0u64;
            let there = buffer.pieces.iter().map(|p| p.start..p.end());
            for range in there.chain(std::iter::once(layer.len..layer.len)) {
                if at < range.start {
                    let gap = layer.offset + at..layer.offset + range.start;
                    match missing.last_mut() {
                        Some(last) if last.end == gap.start => last.end = gap.end,
                        _ => missing.push(gap),
                    }
                }
                at = range.end;
            }
        }
        missing
    }

    /// How many layers of a chunk have arrived whole, from the first on.
    #[must_use]
    pub fn whole_layers(&self, chunk: usize) -> usize {
        let Some(entry) = self.index.as_ref().and_then(|i| i.chunks.get(chunk)) else { return 0 };
        let whole = entry.layers.iter().zip(&self.layers[chunk]);
        whole.take_while(|(layer, buffer)| buffer.front().len() as u64 == layer.len).count()
    }

    /// Forgets the bytes of a chunk, when it is decoded or not wanted any more.
    pub fn forget(&mut self, chunk: usize) {
        if let Some(layers) = self.layers.get_mut(chunk) {
            layers.iter_mut().for_each(|buffer| *buffer = Buffer::default());
        }
    }
}

/// Puts bytes into the layers that they belong to.
fn put_layers(index: &Index, layers: &mut [Vec<Buffer>], offset: u64, bytes: &[u8]) {
    let end = offset.saturating_add(bytes.len() as u64);
    for (chunk, buffers) in index.chunks.iter().zip(layers) {
        for (layer, buffer) in chunk.layers.iter().zip(buffers) {
            let range = layer.range();
            let (start, stop) = (range.start.max(offset), range.end.min(end));
            if start < stop {
                let bytes = &bytes[(start - offset) as usize..(stop - offset) as usize];
                buffer.put(start - range.start, bytes);
            }
        }
    }
}
