//! A stream in a file that is read chunk by chunk, so that memory holds a chunk at a time.

use crate::input;
use crate::output::is_stdio;
use anyhow::{Context, Result};
use gs_model::Scene;
use gsvx::{Index, Reader};
use std::fs::File;
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A stream whose head has been read.
pub(crate) struct StreamFile {
    path: PathBuf,
    source: Source,
    reader: Reader,
    index: Index,
}

impl StreamFile {
    /// Opens a stream and reads its head. Standard input is read whole.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let named = || input::name(path);
        let mut source = Source::open(path)?;
        let mut reader = Reader::new();
        while let Some(range) = reader.head_needs() {
            let bytes = source.read(range.clone())?;
            if bytes.is_empty() {
                let (offset, need) = (range.start as usize, (range.end - range.start) as usize);
                let cut = gsvx::Error::Truncated { what: "head", offset, need, have: 0 };
                return Err(cut).with_context(named);
            }
            reader.give(range.start, &bytes).with_context(named)?;
        }
        let index = reader.index().context("a head without an index")?.clone();
        Ok(Self { path: path.into(), source, reader, index })
    }

    /// The head.
    pub(crate) fn index(&self) -> &Index {
        &self.index
    }

    /// Bytes read so far.
    pub(crate) fn bytes_read(&self) -> u64 {
        self.source.bytes_read
    }

    /// The bytes of a range; fewer where the file ends.
    pub(crate) fn read(&mut self, range: Range<u64>) -> Result<Vec<u8>> {
        self.source.read(range)
    }

    /// The first layers of a chunk, as they are in the stream.
    pub(crate) fn bytes(&mut self, chunk: usize, layers: usize) -> Result<Vec<u8>> {
        let range = self.index.chunks[chunk].range(layers);
        let bytes = self.source.read(range.clone())?;
        if bytes.len() as u64 != range.end - range.start {
            let (offset, need) = (range.start as usize, (range.end - range.start) as usize);
            let have = bytes.len();
            let error = gsvx::Error::Truncated { what: "chunk", offset, need, have };
            return Err(error).with_context(|| input::name(&self.path));
        }
        Ok(bytes)
    }

    /// The Gaussians of a chunk, of an SH degree one below the number of layers.
    pub(crate) fn decode(&mut self, chunk: usize, layers: usize) -> Result<Scene> {
        self.fetch(chunk, layers)?;
        let scene = self.reader.decode(chunk, layers);
        self.reader.forget(chunk);
        scene.with_context(|| input::name(&self.path))
    }

    /// The greatest Morton code, at the finest depth, within the leaf of each Gaussian of a chunk of leaves.
    pub(crate) fn last_codes(&mut self, chunk: usize) -> Result<Vec<u64>> {
        self.fetch(chunk, 1)?;
        let held = self.reader.hold(chunk, 1);
        self.reader.forget(chunk);
        held.with_context(|| input::name(&self.path))?;
        let j_high = self.index.header.j_high;
        let last = |depth: u8| (1u64 << (3 * u32::from(j_high - depth))) - 1;
        Ok(self.reader.held_leaves().iter().map(|l| l.morton + last(l.depth)).collect())
    }

    fn fetch(&mut self, chunk: usize, layers: usize) -> Result<()> {
        for range in self.reader.needs(chunk, layers) {
            let bytes = self.source.read(range.clone())?;
            let given = self.reader.give(range.start, &bytes);
            given.with_context(|| input::name(&self.path))?;
        }
        Ok(())
    }
}

/// A stream that is read in ranges; standard input is read whole.
struct Source {
    file: Box<dyn ReadSeek>,
    bytes_read: u64,
    name: String,
}

trait ReadSeek: Read + Seek {}
impl<T: Read + Seek> ReadSeek for T {}

impl Source {
    fn open(path: &Path) -> Result<Self> {
        let name = input::name(path);
        let file: Box<dyn ReadSeek> = if is_stdio(path) {
            Box::new(Cursor::new(input::bytes(path)?))
        } else {
            Box::new(File::open(path).with_context(|| format!("{name}: cannot be read"))?)
        };
        Ok(Self { file, bytes_read: 0, name })
    }

    /// The bytes of a range; fewer where the stream ends.
    fn read(&mut self, range: Range<u64>) -> Result<Vec<u8>> {
        let bytes =
            self.try_read(range).with_context(|| format!("{}: cannot be read", self.name))?;
        self.bytes_read += bytes.len() as u64;
        Ok(bytes)
    }

    fn try_read(&mut self, range: Range<u64>) -> std::io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.file.seek(SeekFrom::Start(range.start))?;
        self.file.by_ref().take(range.end - range.start).read_to_end(&mut bytes)?;
        Ok(bytes)
    }
}
