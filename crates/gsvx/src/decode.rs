//! The decoder of whole streams, in memory or in files. [`crate::Reader`] is for those that arrive in parts.

use crate::chunk::resize;
use crate::decoded_chunk::{DecodedChunk, check, verify};
use crate::error::{Error, Result, coding};
use crate::head::{Header, Index, Layer, PREAMBLE, head_len};
use crate::parallel;
use gpcc_lite::Octree;
use gs_model::{Scene, SceneMut, sh_len};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Bytes of decoded Gaussians per byte of a stream that a decoder accepts by default, as much as deflate makes of a
/// byte. Trained scenes have 20 to 200. Only synthetic ones, of Gaussians that are all equal, have more.
pub const DEFAULT_GROWTH: u64 = 1024;
/// Bytes of decoded Gaussians that a decoder accepts by default in a stream of any length.
pub const ALWAYS_ACCEPTED: u64 = 64 << 20;

/// The number of Gaussians of an SH degree that a decoder accepts by default in so many bytes of a stream: as arrays
/// of floats they take at most [`DEFAULT_GROWTH`] times the bytes, and [`ALWAYS_ACCEPTED`] more.
#[must_use]
pub fn default_max_gaussians(bytes: u64, sh_degree: u8) -> u64 {
    DEFAULT_GROWTH.saturating_mul(bytes).saturating_add(ALWAYS_ACCEPTED) / bytes_of(sh_degree)
}

/// Bytes of a decoded Gaussian.
fn bytes_of(sh_degree: u8) -> u64 {
    4 * (3 + 4 + 3 + 1 + 3 * sh_len(sh_degree) as u64)
}

/// Refuses more Gaussians than are accepted (`None`: by default) in so many bytes, or than fit an address space.
pub(crate) fn check_limit(points: u64, most: Option<u64>, bytes: u64, sh_degree: u8) -> Result<()> {
    let limit = most.unwrap_or_else(|| default_max_gaussians(bytes, sh_degree));
    let limit = limit.min(isize::MAX as u64 / bytes_of(sh_degree));
    if points > limit { Err(Error::Limit { points, limit }) } else { Ok(()) }
}

/// Gaussians per block of [`Decoder::blocks`]: a block fits a core's cache.
const BLOCK: usize = 512;

/// Options of [`decode_with`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct DecodeOptions {
    /// Highest SH degree to decode.
    pub max_sh_degree: u8,
    /// Level of detail: 0 is the finest. A number above the coarsest level stands for the coarsest.
    pub lod: u8,
    /// Leave out layers that are missing or damaged instead of failing, and list them in
    /// [`DecodeOutcome::skipped`]. Every chunk is decoded twice.
    pub salvage: bool,
    /// Greatest number of Gaussians accepted; `None` derives it from the stream's length: [`default_max_gaussians`].
    pub max_gaussians: Option<u64>,
}

impl Default for DecodeOptions {
    fn default() -> Self {
        Self { max_sh_degree: 3, lod: 0, salvage: false, max_gaussians: None }
    }
}

/// A decoded scene.
#[derive(Clone, Debug)]
pub struct DecodeOutcome {
    /// The Gaussians: chunk after chunk, in Morton order, then those that were coded exactly.
    pub scene: Scene,
    /// The stream's head.
    pub index: Index,
    /// What was not decoded, and why; one line each.
    pub skipped: Vec<String>,
}

/// Decodes a whole stream.
///
/// # Errors
/// Any damage to the stream is reported as an [`Error`].
pub fn decode(bytes: &[u8]) -> Result<Scene> {
    Ok(decode_with(bytes, &DecodeOptions::default())?.scene)
}

/// As [`decode`], with options.
///
/// # Errors
/// As [`decode`]; see [`DecodeOptions::salvage`].
pub fn decode_with(bytes: &[u8], options: &DecodeOptions) -> Result<DecodeOutcome> {
    let decoder = Decoder::new(bytes, options)?;
    let mut scene = decoder.empty_scene();
    let likely = default_max_gaussians(bytes.len() as u64, decoder.sh_degree());
    let likely = usize::try_from(likely).unwrap_or(usize::MAX);
    decoder.chunks::<Error>(|chunk| {
        if scene.means.capacity() < scene.len() + chunk.len() {
            // What a stream claims takes no memory before a chunk is there, and is not believed at once if it is much.
            let rest = decoder.len() - scene.len();
            let room = rest.min(likely.max(scene.len())).max(chunk.len());
            scene.try_reserve(room).map_err(|_| Error::memory(room))?;
        }
        scene.append(&chunk);
        Ok(())
    })?;
    let Decoder { index, skipped, .. } = decoder;
    Ok(DecodeOutcome { scene, index, skipped })
}

/// The leaves of a stream and their importance classes, in the order of the Gaussians. Gaussians that are
/// coded bit for bit have neither.
///
/// # Errors
/// As [`decode`].
pub fn decode_leaves(bytes: &[u8]) -> Result<(Octree, Vec<u8>)> {
    let decoder = Decoder::new(bytes, &DecodeOptions { max_sh_degree: 0, ..Default::default() })?;
    let Header { cube, j_high, .. } = decoder.index.header;
    let mut octree = Octree::new(cube, j_high, Vec::new()).map_err(coding("geometry"))?;
    let mut classes = Vec::new();
    let mut chunk = DecodedChunk::default();
    for job in &decoder.jobs {
        decoder.decode_job(job, &mut chunk)?;
        if let Some(leaves) = chunk.leaves() {
            octree.append(leaves.octree()).map_err(coding("geometry"))?;
            classes.extend_from_slice(leaves.classes());
        }
    }
    Ok((octree, classes))
}

/// What the checksums of a stream show of damage in its chunks, one line each. Nothing is decoded, and each thread holds
/// at most a megabyte of the stream.
///
/// # Errors
/// Damage of the head, as [`decode`]; [`Error::Read`].
pub fn faults(source: &dyn Source) -> Result<Vec<String>> {
    let bytes = Bytes::Source(source);
    let index = Index::parse(&bytes.head()?)?;
    let decoder = Decoder { bytes, sh_degree: 3, index, skipped: Vec::new(), jobs: Vec::new() };
    let fault = |chunk: usize| {
        let layers = decoder.index.chunks[chunk].layers.iter().enumerate();
        let bad = |(number, layer): (usize, &Layer)| {
            decoder.compare(chunk, number, *layer).err().map(|why| (number, why))
        };
        layers.filter_map(bad).next()
    };
    let found = parallel::map((0..decoder.index.chunks.len()).collect(), fault);
    let mut lines = Vec::new();
    for (chunk, bad) in found.into_iter().enumerate() {
        match bad {
            Some((_, Error::Read(why))) => return Err(Error::Read(why)),
            Some((layer, why)) => lines.push(decoder.in_words(chunk, layer, &why)),
            None => {}
        }
    }
    Ok(lines)
}

/// Where a stream is that is not in memory, for [`Decoder::of_source`].
pub trait Source: std::fmt::Debug + Sync {
    /// Bytes of the stream, and of what may follow it.
    fn len(&self) -> u64;

    /// True if there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The bytes of a range that ends within [`Source::len`]. It is called from several threads.
    ///
    /// # Errors
    /// If they cannot be read.
    fn read(&self, range: Range<u64>) -> std::io::Result<Vec<u8>>;
}

/// The bytes of a stream.
#[derive(Clone, Copy, Debug)]
enum Bytes<'a> {
    Memory(&'a [u8]),
    Source(&'a dyn Source),
}

impl<'a> Bytes<'a> {
    fn len(self) -> u64 {
        match self {
            Self::Memory(bytes) => bytes.len() as u64,
            Self::Source(source) => source.len(),
        }
    }

    /// The bytes of a range.
    fn read(self, range: Range<u64>, what: &'static str) -> Result<Cow<'a, [u8]>> {
        if range.end > self.len() {
            return Err(Error::Truncated {
                what,
                offset: range.start,
                need: range.end - range.start,
                have: self.len().saturating_sub(range.start),
            });
        }
        match self {
            Self::Memory(bytes) => {
                Ok(Cow::Borrowed(&bytes[range.start as usize..range.end as usize]))
            }
            Self::Source(source) => source.read(range).map(Cow::Owned).map_err(Error::Read),
        }
    }

    /// The start of the stream, as far as the head reaches; more where that costs nothing.
    fn head(self) -> Result<Cow<'a, [u8]>> {
        match self {
            Self::Memory(bytes) => Ok(Cow::Borrowed(bytes)),
            Self::Source(_) => {
                let known = PREAMBLE as u64;
                let start = self.read(0..self.len().min(known), "head")?;
                let end = if start.len() == PREAMBLE { head_len(&start)? } else { 0 };
                self.read(0..self.len().min(end.max(known)), "head")
            }
        }
    }
}

/// Bytes that are compared with a checksum at a time.
const PIECE: usize = 1 << 20;

/// A stream about to be decoded, for callers that need not hold the whole scene.
#[derive(Debug)]
pub struct Decoder<'a> {
    bytes: Bytes<'a>,
    index: Index,
    sh_degree: u8,
    skipped: Vec<String>,
    jobs: Vec<Job>,
}

/// A chunk to decode.
#[derive(Debug)]
struct Job {
    chunk: usize,
    /// Its layers that are wanted and whole.
    layers: usize,
    /// The number of its first Gaussian in the output, and of its Gaussians.
    first: usize,
    count: usize,
}

impl<'a> Decoder<'a> {
    /// Reads the head and verifies the checksums of all layers that are wanted.
    ///
    /// # Errors
    /// As [`decode`], as far as damage shows before the decoding.
    pub fn new(bytes: &'a [u8], options: &DecodeOptions) -> Result<Self> {
        Self::of(Bytes::Memory(bytes), options)
    }

    /// As [`Decoder::new`], of a stream that is not in memory. Each thread holds the bytes of one chunk at a time; they
    /// are read, and compared with their checksums, once here and once when they are decoded.
    ///
    /// # Errors
    /// As [`Decoder::new`]; [`Error::Read`].
    pub fn of_source(source: &'a dyn Source, options: &DecodeOptions) -> Result<Self> {
        Self::of(Bytes::Source(source), options)
    }

    fn of(bytes: Bytes<'a>, options: &DecodeOptions) -> Result<Self> {
        let index = Index::parse(&bytes.head()?)?;
        let sh_degree = index.header.sh_degree.min(options.max_sh_degree);
        let mut this = Self { bytes, index, sh_degree, skipped: Vec::new(), jobs: Vec::new() };
        if sh_degree < this.index.header.sh_degree {
            let stored = this.index.header.sh_degree;
            this.skipped.push(format!("SH degrees above {sh_degree} of {stored}: not asked for"));
        }
        let lod = options.lod.min(this.index.coarsest_lod());
        let wanted: Vec<usize> = this.index.chunks_of_lod(lod).collect();
        // The index has at most 2^20 chunks of at most 2^32.
        let points = wanted.iter().map(|&i| this.index.chunks[i].count).sum::<u64>();
        // Bytes behind the stream do not count towards its length.
        let of_stream = bytes.len().min(this.index.stream_len());
        check_limit(points, options.max_gaussians, of_stream, sh_degree)?;
        let mut first = 0;
        let good = |chunk| this.good_layers(chunk, options.salvage);
        let found = parallel::map(wanted.clone(), good);
        for (chunk, found) in wanted.into_iter().zip(found) {
            let (layers, bad) = found?;
            if let Some(why) = bad {
                this.skipped.push(this.in_words(chunk, layers, &why));
            }
            if layers > 0 {
                let count = this.index.chunks[chunk].count as usize;
                this.jobs.push(Job { chunk, layers, first, count });
                first += count;
            }
        }
        Ok(this)
    }

    /// How many layers of a chunk are wanted and good. One that is not is an error, or with `salvage` the reason why
    /// there are no more. Then they are decoded on trial: only that shows how many Gaussians there are.
    fn good_layers(&self, chunk: usize, salvage: bool) -> Result<(usize, Option<Error>)> {
        let mut decoded = DecodedChunk::default();
        let layers = &self.index.chunks[chunk].layers;
        let wanted = layers.len().min(1 + usize::from(self.sh_degree));
        for (number, &layer) in layers[..wanted].iter().enumerate() {
            let good = self.layer(chunk, number, layer).and_then(|bytes| match salvage {
                true => decoded.layer(&self.index, chunk, number, &bytes),
                false => Ok(()),
            });
            match good {
                Ok(()) => {}
                Err(why) if salvage => return Ok((number, Some(why))),
                Err(why) => return Err(why),
            }
        }
        Ok((wanted, None))
    }

    /// What is said of the layers of a chunk from `layer` on, which are left out.
    fn in_words(&self, chunk: usize, layer: usize, why: &Error) -> String {
        let (count, why) = (self.index.chunks[chunk].count, gs_model::chain(why));
        match layer {
            0 => format!("chunk {chunk} ({count} Gaussians): {why}"),
            degree => format!("SH degree {degree} and above of chunk {chunk}: {why}"),
        }
    }

    /// Compares a layer with its checksum, piece by piece.
    fn compare(&self, chunk: usize, number: usize, layer: Layer) -> Result<()> {
        let Range { start, end } = layer.range();
        if end > self.bytes.len() {
            // `read` returns the error that names the missing bytes.
            return self.bytes.read(start..end, "a chunk").map(drop);
        }
        let mut found = 0;
        for at in (start..end).step_by(PIECE) {
            let piece = self.bytes.read(at..end.min(at + PIECE as u64), "a chunk")?;
            found = crc32c::crc32c_append(found, &piece);
        }
        check(found, chunk, number, layer)
    }

    /// The bytes of a layer, verified.
    fn layer(&self, chunk: usize, number: usize, layer: Layer) -> Result<Cow<'a, [u8]>> {
        let bytes = self.bytes.read(layer.range(), "a chunk")?;
        verify(&bytes, chunk, number, layer)?;
        Ok(bytes)
    }

    /// The stream's head.
    #[must_use]
    pub fn index(&self) -> &Index {
        &self.index
    }

    /// Gaussians that will be decoded.
    #[must_use]
    pub fn len(&self) -> usize {
        self.jobs.last().map_or(0, |job| job.first + job.count)
    }

    /// True if there is no Gaussian.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// SH degree of the Gaussians: the stream's, or less if less is wanted.
    #[must_use]
    pub fn sh_degree(&self) -> u8 {
        self.sh_degree
    }

    /// A scene without Gaussians, of the SH degree of those that will be decoded.
    #[must_use]
    pub fn empty_scene(&self) -> Scene {
        self.index.header.empty_scene(self.sh_degree)
    }

    /// What is not decoded, and why; one line each.
    #[must_use]
    pub fn skipped(&self) -> &[String] {
        &self.skipped
    }

    /// Decodes chunk after chunk, with what only the crate knows of them.
    pub(crate) fn decoded(&self, mut take: impl FnMut(&DecodedChunk) -> Result<()>) -> Result<()> {
        let mut chunk = DecodedChunk::default();
        self.jobs.iter().try_for_each(|job| {
            self.decode_job(job, &mut chunk)?;
            take(&chunk)
        })
    }

    /// Decodes the wanted layers of a chunk.
    fn decode_job(&self, job: &Job, decoded: &mut DecodedChunk) -> Result<()> {
        (0..job.layers).try_for_each(|layer| self.decode_layer(job.chunk, layer, decoded))
    }

    /// Decodes a layer behind those before it.
    fn decode_layer(&self, chunk: usize, layer: usize, decoded: &mut DecodedChunk) -> Result<()> {
        let at = self.index.chunks[chunk].layers[layer];
        let bytes = match self.bytes {
            // Verified already, and cannot have changed.
            Bytes::Memory(_) => self.bytes.read(at.range(), "a chunk")?,
            Bytes::Source(_) => self.layer(chunk, layer, at)?,
        };
        decoded.layer(&self.index, chunk, layer, &bytes)
    }

    /// Decodes the chunks on all threads and hands their Gaussians to `take` in order. As many chunks as
    /// there are threads are in memory at once.
    ///
    /// # Errors
    /// Damage, as [`decode`]; what `take` returns.
    pub fn chunks<E: From<Error> + Send>(
        &self,
        mut take: impl FnMut(Scene) -> std::result::Result<(), E>,
    ) -> std::result::Result<(), E> {
        for jobs in self.jobs.chunks(parallel::threads()) {
            let work = |job: &Job| {
                let mut chunk = DecodedChunk::default();
                self.decode_job(job, &mut chunk)?;
                chunk.scene(self.empty_scene())
            };
            let scenes: Vec<Result<Scene>> = parallel::map(jobs.iter().collect(), work);
            for scene in scenes {
                take(scene?)?;
            }
        }
        Ok(())
    }

    /// Decodes the scene on all threads in blocks of a few hundred Gaussians. `visit` is called for
    /// each block, in any order and on several threads at once. It gets the number of the block's first
    /// Gaussian in the scene, and a `T` for buffers that no other call uses at the same time. Each thread
    /// holds one decoded chunk at a time.
    ///
    /// # Errors
    /// As [`decode`], when some blocks may have been visited already; what `visit` returns.
    pub fn blocks<T: Default + Send, E: From<Error> + Send>(
        &self,
        visit: impl Fn(&mut T, usize, &Scene) -> std::result::Result<(), E> + Sync + Send,
    ) -> std::result::Result<(), E> {
        let free: Mutex<Vec<(DecodedChunk, T, Scene)>> = Mutex::default();
        let lock = || free.lock().unwrap_or_else(PoisonError::into_inner);
        let work = |job: &Job| {
            let space = lock().pop();
            let new = || (DecodedChunk::default(), T::default(), self.empty_scene());
            let (mut chunk, mut buffer, mut block) = space.unwrap_or_else(new);
            self.decode_job(job, &mut chunk)?;
            for at in (0..job.count).step_by(BLOCK) {
                resize(&mut block, BLOCK.min(job.count - at))?;
                chunk.fill(at, &mut SceneMut::of(&mut block));
                visit(&mut buffer, job.first + at, &block)?;
            }
            lock().push((chunk, buffer, block));
            Ok(())
        };
        parallel::map(self.jobs.iter().collect(), work).into_iter().collect()
    }
}
