//! A stream that arrives in parts, for JavaScript: [`gsvx::Reader`] with numbers and objects that cross the
//! border.
//!
//! Invariant: nothing panics on what JavaScript passes in. Numbers that are no offset of a stream are cut to
//! one.

use crate::layout::{self, BLOCK};
use crate::{error, head};
use gs_model::Scene;
use gsvx::Reader;
use wasm_bindgen::prelude::*;

/// A gsvx stream that arrives in parts.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Stream {
    reader: Reader,
    block: Scene,
}

impl Default for Stream {
    fn default() -> Self {
        // JavaScript compares the number of Gaussians with its limits before anything is decoded.
        Self { reader: Reader::with_max_gaussians(u64::MAX), block: Scene::default() }
    }
}

#[wasm_bindgen]
impl Stream {
    /// A stream of which nothing is known yet.
    #[wasm_bindgen(constructor)]
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Start and end of the bytes that are needed before the head is known; nothing when it is.
    #[wasm_bindgen(js_name = headNeeds)]
    #[must_use]
    pub fn head_needs(&self) -> Option<Vec<f64>> {
        self.reader.head_needs().map(|r| vec![r.start as f64, r.end as f64])
    }

    /// Takes bytes of the stream that begin at `offset`.
    ///
    /// # Errors
    /// An object with `message`, `code` and `offset` if the head is damaged.
    pub fn give(&mut self, offset: f64, bytes: &[u8]) -> Result<(), JsValue> {
        // A number that is too large, negative or NaN is cut.
        self.reader.give(offset as u64, bytes).map_err(|e| error::of(&e, None))
    }

    /// The head, once it has arrived.
    #[must_use]
    pub fn head(&self) -> Option<js_sys::Object> {
        self.reader.index().map(|index| head::of(index).unchecked_into())
    }

    /// How many layers of a chunk have arrived whole.
    #[wasm_bindgen(js_name = wholeLayers)]
    #[must_use]
    pub fn whole_layers(&self, chunk: usize) -> usize {
        self.reader.whole_layers(chunk)
    }

    /// Decodes the first layers of a chunk and holds its Gaussians. Returns how many there are.
    ///
    /// # Errors
    /// An object with `message`, `code`, `offset`, and `chunk` and `layer` where they are known.
    pub fn hold(&mut self, chunk: usize, layers: usize) -> Result<usize, JsValue> {
        self.reader.hold(chunk, layers).map_err(|e| error::of(&e, self.reader.index()))
    }

    /// For each chunk that together replace chunk `chunk`, which is held: the number of the first Gaussian
    /// that stands for it. Gaussians are in the same order as the chunks.
    #[must_use]
    pub fn parts(&self, chunk: usize) -> Vec<u32> {
        let Some(index) = self.reader.index().filter(|i| chunk < i.chunks.len()) else {
            return Vec::new();
        };
        let leaves = self.reader.held_leaves();
        let first = |finer: usize| {
            let cell = index.chunks[finer].first_cell;
            leaves.partition_point(|leaf| leaf.morton < cell) as u32
        };
        index.finer(chunk).map(first).collect()
    }

    /// Puts some Gaussians of the chunk that is held into the typed arrays of `arrays`, from number `at` on.
    /// Arrays that are missing, or have no room for `capacity` Gaussians, are made; they begin as zeros.
    ///
    /// # Errors
    /// As [`Stream::hold`]; an object with `message` and `code` for an unknown layout or too small a capacity.
    pub fn take(
        &mut self,
        first: usize,
        count: usize,
        arrays: &js_sys::Object,
        at: usize,
        capacity: usize,
        layout: &str,
        sh_degree: u8,
    ) -> Result<(), JsValue> {
        let first = first.min(self.reader.held_len());
        let count = count.min(self.reader.held_len() - first);
        if at.checked_add(count).is_none_or(|end| end > capacity) {
            return Err(error::object("the arrays have no room for the Gaussians", "option").into());
        }
        let sh_degree = sh_degree.min(3);
        let mut out = layout::named(layout, arrays, capacity, sh_degree)?;
        self.block.clear();
        self.block.sh_degree = sh_degree;
        for done in (0..count).step_by(BLOCK) {
            let range = first + done..first + count.min(done + BLOCK);
            self.reader
                .held_block(range, &mut self.block)
                .map_err(|e| error::of(&e, self.reader.index()))?;
            #[cfg(feature = "page")]
            crate::outlook::see(&self.block, self.seldom());
            out.put(at + done, &self.block);
        }
        Ok(())
    }

    /// One in so many Gaussians is enough to find the first view. A coarse level has few.
    #[cfg(feature = "page")]
    fn seldom(&self) -> usize {
        let whole = self.reader.index().filter(|index| index.coarsest_lod() == 0);
        whole.map_or(1, |i| i.header.count.div_ceil(crate::outlook::ENOUGH as u64) as usize)
    }

    /// Forgets the bytes of a chunk.
    pub fn forget(&mut self, chunk: usize) {
        self.reader.forget(chunk);
    }
}
