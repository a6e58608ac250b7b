//! The chunk that a reader holds decoded: its Gaussians are taken in blocks, and further layers are added
//! to it without those before being decoded again.
//!
//! Invariant: what is held is what the first [`HeldChunk::layers`] layers of one chunk say. A layer that cannot
//! be decoded leaves what is held as it was.

use super::Reader;
use crate::chunk::resize;
use crate::decode::check_limit;
use crate::decoded_chunk::verify;
use crate::error::{Error, Result};
use gpcc_lite::Leaf;
use gs_model::{Scene, SceneMut};
use std::ops::Range;

/// What is decoded of a chunk.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeldChunk {
    chunk: usize,
    layers: usize,
}

impl Reader {
    /// Decodes the first `layers` layers of a chunk and holds the result in place of the last. Of a chunk
    /// that is held already, only further layers are decoded. Returns the number of its Gaussians.
    ///
    /// # Errors
    /// [`Error::Truncated`] if a layer has not arrived, [`Error::Checksum`] and others if it is damaged.
    /// The layers before it are held then. [`Error::Limit`] for more Gaussians than are accepted; what was held stays.
    pub fn hold(&mut self, chunk: usize, layers: usize) -> Result<usize> {
        let Some(index) = &self.index else {
            return Err(Error::Truncated { what: "head", offset: 0, need: 0, have: 0 });
        };
        let Some(entry) = index.chunks.get(chunk) else {
            return Err(Error::Corrupt { what: "number of a chunk", value: chunk as u64 });
        };
        let bytes = entry.layers.iter().fold(0u64, |sum, l| sum.saturating_add(l.len));
        check_limit(entry.count, self.max_gaussians, bytes, index.header.sh_degree)?;
        let layers = layers.clamp(1, entry.layers.len());
        let first = self.held_layers(chunk, layers);
        if first == 0 {
            self.held = None;
        }
        for number in first..layers {
            let (layer, bytes) = (entry.layers[number], self.layers[chunk][number].front());
            if (bytes.len() as u64) < layer.len {
                return Err(Error::Truncated {
                    what: "a chunk",
                    offset: layer.offset,
                    need: layer.len,
                    have: bytes.len() as u64,
                });
            }
            verify(bytes, chunk, number, layer)?;
            self.decoded.layer(index, chunk, number, bytes)?;
            self.held = Some(HeldChunk { chunk, layers: number + 1 });
        }
        Ok(self.held_len())
    }

    /// How many of the first `layers` layers of a chunk are held, and need not be decoded again: 0 if more are held,
    /// because layers cannot be taken back.
    pub(super) fn held_layers(&self, chunk: usize, layers: usize) -> usize {
        let held = self.held.filter(|h| h.chunk == chunk && h.layers <= layers);
        held.map_or(0, |h| h.layers)
    }

    /// The number of Gaussians of the chunk that is held; 0 without one.
    #[must_use]
    pub fn held_len(&self) -> usize {
        self.held.map_or(0, |_| self.decoded.len())
    }

    /// The leaves of the chunk that is held, in the order of its Gaussians; none for an exact chunk.
    #[must_use]
    pub fn held_leaves(&self) -> &[Leaf] {
        let leaves = self.held.and_then(|_| self.decoded.leaves());
        leaves.map_or(&[], |leaves| leaves.octree().leaves())
    }

    /// Puts some Gaussians of the chunk that is held into `out`, in place of what was there. They have the
    /// SH degree of `out`; coefficients that are not decoded are 0. A range beyond the end is cut.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn held_block(&self, range: Range<usize>, out: &mut Scene) -> Result<()> {
        let end = range.end.min(self.held_len());
        let first = range.start.min(end);
        resize(out, end - first)?;
        if self.held.is_some() {
            self.decoded.fill(first, &mut SceneMut::of(out));
        }
        Ok(())
    }

    /// Decodes the first `layers` layers of a chunk: its Gaussians, at the SH degree of these layers.
    ///
    /// # Errors
    /// As [`Reader::hold`].
    pub fn decode(&mut self, chunk: usize, layers: usize) -> Result<Scene> {
        let count = self.hold(chunk, layers)?;
        let layers = self.held.map_or(1, |h| h.layers as u8);
        let most = if self.decoded.leaves().is_some() { layers - 1 } else { u8::MAX };
        let mut scene =
            self.index.as_ref().map_or_else(Scene::default, |i| i.header.empty_scene(most));
        self.held_block(0..count, &mut scene)?;
        Ok(scene)
    }
}
