//! A stream in a file that is read chunk by chunk, so that memory holds a chunk at a time.

use crate::input::{self, Limit};
use crate::output::is_stdio;
use crate::positional::At;
use anyhow::{Context, Result};
use gs_model::Scene;
use gsvx::{Index, Reader, Source};
use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::Path;

/// The bytes of a stream: those of a plain file where they are; in memory what can only be read from its start.
#[derive(Debug)]
pub(crate) enum StreamBytes {
    File(File, u64),
    Memory(Vec<u8>),
}

impl StreamBytes {
    pub(crate) fn open(path: &Path) -> Result<Self> {
        if is_stdio(path) || !std::fs::metadata(path).is_ok_and(|m| m.is_file()) {
            return Ok(Self::Memory(input::bytes(path)?));
        }
        let file = input::open(path)?;
        let length = file.metadata().with_context(|| input::cannot_read(path))?.len();
        Ok(Self::File(file, length))
    }
}

impl Source for StreamBytes {
    fn len(&self) -> u64 {
        match self {
            Self::File(_, length) => *length,
            Self::Memory(bytes) => bytes.len() as u64,
        }
    }

    fn read(&self, range: Range<u64>) -> std::io::Result<Vec<u8>> {
        match self {
            Self::File(file, _) => {
                // The length is a claim of the stream.
                let length = (range.end - range.start) as usize;
                let mut bytes = Vec::new();
                bytes.try_reserve_exact(length)?;
                bytes.resize(length, 0);
                At(file, range.start).read_exact(&mut bytes)?;
                Ok(bytes)
            }
            Self::Memory(all) => Ok(all[range.start as usize..range.end as usize].to_vec()),
        }
    }
}

/// A stream whose head has been read.
pub(crate) struct StreamFile {
    name: String,
    pub(crate) source: StreamBytes,
    reader: Reader,
    pub(crate) index: Index,
    pub(crate) bytes_read: u64,
}

impl StreamFile {
    /// Opens a stream and reads its head.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        Self::open_limited(path, Limit::default())
    }

    /// As [`StreamFile::open`], with a limit of Gaussians.
    pub(crate) fn open_limited(path: &Path, limit: Limit) -> Result<Self> {
        let (name, source) = (input::name(path), StreamBytes::open(path)?);
        let reader = limit.max_gaussians.map_or_else(Reader::new, Reader::with_max_gaussians);
        let index = Index::default();
        let mut this = Self { name, source, reader, index, bytes_read: 0 };
        while let Some(range) = this.reader.head_needs() {
            let bytes = this.read(range.clone())?;
            if bytes.is_empty() {
                return this.cut("head", range, 0);
            }
            this.reader.give(range.start, &bytes).with_context(|| this.name.clone())?;
        }
        this.index = this.reader.index().context("a head without an index")?.clone();
        Ok(this)
    }

    /// The bytes of a range; fewer where the stream ends.
    pub(crate) fn read(&mut self, range: Range<u64>) -> Result<Vec<u8>> {
        let end = range.end.min(self.source.len());
        let read = self.source.read(range.start.min(end)..end);
        let bytes = read.with_context(|| format!("{}: cannot be read", self.name))?;
        self.bytes_read += bytes.len() as u64;
        Ok(bytes)
    }

    /// The first layers of a chunk, as they are in the stream.
    pub(crate) fn bytes(&mut self, chunk: usize, layers: usize) -> Result<Vec<u8>> {
        let range = self.index.chunks[chunk].range(layers);
        let bytes = self.read(range.clone())?;
        match bytes.len() {
            have if (have as u64) < range.end - range.start => self.cut("chunk", range, have),
            _ => Ok(bytes),
        }
    }

    fn cut<T>(&self, what: &'static str, range: Range<u64>, have: usize) -> Result<T> {
        let (offset, need, have) = (range.start, range.end - range.start, have as u64);
        let error = gsvx::Error::Truncated { what, offset, need, have };
        Err(error).with_context(|| self.name.clone())
    }

    /// The Gaussians of a chunk, of an SH degree one below the number of layers.
    pub(crate) fn decode(&mut self, chunk: usize, layers: usize) -> Result<Scene> {
        self.with(chunk, layers, |reader| reader.decode(chunk, layers))
    }

    /// The greatest Morton code, at the finest depth, within the leaf of each Gaussian of a chunk of leaves.
    pub(crate) fn last_codes(&mut self, chunk: usize) -> Result<Vec<u64>> {
        self.with(chunk, 1, |reader| reader.hold(chunk, 1))?;
        let j_high = self.index.header.j_high;
        let last = |depth: u8| (1u64 << (3 * u32::from(j_high - depth))) - 1;
        Ok(self.reader.held_leaves().iter().map(|l| l.morton + last(l.depth)).collect())
    }

    /// The side of the middle one of the cells of a chunk of leaves, by size.
    pub(crate) fn middle_cell(&mut self, chunk: usize) -> Result<f64> {
        self.with(chunk, 1, |reader| reader.hold(chunk, 1))?;
        let mut depths: Vec<u8> = self.reader.held_leaves().iter().map(|l| l.depth).collect();
        depths.sort_unstable();
        let depth = depths.get(depths.len() / 2).copied().unwrap_or_default();
        Ok(self.index.header.cube.side / (1u64 << depth) as f64)
    }

    /// Does `work` while the reader has the first layers of a chunk.
    fn with<T>(
        &mut self,
        chunk: usize,
        layers: usize,
        work: impl FnOnce(&mut Reader) -> gsvx::Result<T>,
    ) -> Result<T> {
        for range in self.reader.needs(chunk, layers) {
            let bytes = self.read(range.clone())?;
            self.reader.give(range.start, &bytes).with_context(|| self.name.clone())?;
        }
        let done = work(&mut self.reader);
        self.reader.forget(chunk);
        done.with_context(|| self.name.clone())
    }
}
