//! The decoder of whole streams, in memory or in files. [`crate::Reader`] is for those that arrive in parts.

use crate::chunk::{GaussiansMut, resize};
use crate::decoded_chunk::{DecodedChunk, verify};
use crate::error::{Error, Result, coding};
use crate::head::{Header, Index, Layer, head_len};
use crate::parallel;
use gpcc_lite::Octree;
use gs_model::Scene;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Gaussians per stream byte that a decoder accepts by default; 2^17 more are always accepted. Trained
/// scenes have fewer than one per byte. A solid block of equal Gaussians takes almost no bytes, but each
/// chunk of 2^16 takes more than 64 with its entry in the index: the limit admits what an encoder
/// writes in chunks of the default size.
pub const DEFAULT_GAUSSIANS_PER_BYTE: u64 = 1024;
/// Gaussians that a decoder accepts by default in a stream of any length.
const LEAST_LIMIT: u64 = 1 << 17;

/// The number of Gaussians that a decoder accepts by default in so many bytes.
#[must_use]
pub fn default_max_gaussians(bytes: u64) -> u64 {
    DEFAULT_GAUSSIANS_PER_BYTE.saturating_mul(bytes).saturating_add(LEAST_LIMIT)
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
    /// [`Decoded::skipped`].
    pub salvage: bool,
    /// Greatest number of Gaussians accepted; `None` derives it from the stream's length.
    pub max_gaussians: Option<u64>,
}

impl Default for DecodeOptions {
    fn default() -> Self {
        Self { max_sh_degree: 3, lod: 0, salvage: false, max_gaussians: None }
    }
}

/// A decoded scene.
#[derive(Clone, Debug)]
pub struct Decoded {
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
pub fn decode_with(bytes: &[u8], options: &DecodeOptions) -> Result<Decoded> {
    let decoder = Decoder::new(bytes, options)?;
    let mut scene = decoder.zeros(decoder.len());
    let mut rest = GaussiansMut::of(&mut scene);
    let mut jobs = Vec::with_capacity(decoder.jobs.len());
    for job in &decoder.jobs {
        let (out, others) = rest.split_at(job.count);
        rest = others;
        jobs.push((job, out));
    }
    let work = |(job, mut out): (&Job, GaussiansMut<'_>)| {
        let mut chunk = DecodedChunk::default();
        decoder.decode_job(job, &mut chunk)?;
        chunk.fill(0, &mut out)
    };
    parallel::map(jobs, work).into_iter().collect::<Result<()>>()?;
    let Decoder { index, skipped, .. } = decoder;
    Ok(Decoded { scene, index, skipped })
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
                offset: range.start as usize,
                need: (range.end - range.start) as usize,
                have: self.len().saturating_sub(range.start) as usize,
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
                let start = self.read(0..self.len().min(LENGTH_KNOWN), "head")?;
                let end = if start.len() as u64 == LENGTH_KNOWN { head_len(&start)? } else { 0 };
                self.read(0..self.len().min(end.max(LENGTH_KNOWN)), "head")
            }
        }
    }
}

/// Bytes that tell how long the head is.
const LENGTH_KNOWN: u64 = 13;

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
        let limit = options.max_gaussians.unwrap_or_else(|| default_max_gaussians(bytes.len()));
        let sh_degree = index.header.sh_degree.min(options.max_sh_degree);
        let mut this = Self { bytes, index, sh_degree, skipped: Vec::new(), jobs: Vec::new() };
        if sh_degree < this.index.header.sh_degree {
            let stored = this.index.header.sh_degree;
            this.skipped.push(format!("SH degrees above {sh_degree} of {stored}: not asked for"));
        }
        let lod = options.lod.min(this.index.coarsest_lod());
        let wanted: Vec<usize> = this.index.chunks_of_lod(lod).collect();
        let points = wanted.iter().map(|&i| this.index.chunks[i].count).sum::<u64>();
        if points > limit {
            return Err(Error::Limit { points, limit });
        }
        let mut first = 0;
        for chunk in wanted {
            let layers = this.whole_layers(chunk, options.salvage)?;
            if layers > 0 {
                let count = this.index.chunks[chunk].count as usize;
                this.jobs.push(Job { chunk, layers, first, count });
                first += count;
            }
        }
        Ok(this)
    }

    /// How many layers of a chunk are wanted and whole. A layer that is not whole is an error, or with
    /// `salvage` a line in `skipped`.
    fn whole_layers(&mut self, chunk: usize, salvage: bool) -> Result<usize> {
        let layers = self.index.chunks[chunk].layers.len().min(1 + usize::from(self.sh_degree));
        for layer in 0..layers {
            let at = self.index.chunks[chunk].layers[layer];
            if let Err(e) = self.layer(chunk, layer, at) {
                if !salvage {
                    return Err(e);
                }
                let count = self.index.chunks[chunk].count;
                self.skipped.push(match layer {
                    0 => format!("chunk {chunk} ({count} Gaussians): {}", gs_model::chain(&e)),
                    degree => format!(
                        "SH degree {degree} and above of chunk {chunk}: {}",
                        gs_model::chain(&e)
                    ),
                });
                return Ok(layer);
            }
        }
        Ok(layers)
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

    /// So many Gaussians, to be filled in.
    fn zeros(&self, n: usize) -> Scene {
        let mut scene = self.empty_scene();
        resize(&mut scene, n);
        scene
    }

    /// What is not decoded, and why; one line each.
    #[must_use]
    pub fn skipped(&self) -> &[String] {
        &self.skipped
    }

    /// Decodes the wanted layers of a chunk.
    fn decode_job(&self, job: &Job, decoded: &mut DecodedChunk) -> Result<()> {
        let layers = &self.index.chunks[job.chunk].layers;
        let bytes = |i: usize| match self.bytes {
            // Verified already, and cannot have changed.
            Bytes::Memory(_) => self.bytes.read(layers[i].range(), "a chunk"),
            Bytes::Source(_) => self.layer(job.chunk, i, layers[i]),
        };
        (0..job.layers).try_for_each(|i| decoded.layer(&self.index, job.chunk, i, &bytes(i)?))
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
                let mut scene = self.zeros(job.count);
                let mut chunk = DecodedChunk::default();
                self.decode_job(job, &mut chunk)?;
                chunk.fill(0, &mut GaussiansMut::of(&mut scene))?;
                Ok(scene)
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
                resize(&mut block, BLOCK.min(job.count - at));
                chunk.fill(at, &mut GaussiansMut::of(&mut block))?;
                visit(&mut buffer, job.first + at, &block)?;
            }
            lock().push((chunk, buffer, block));
            Ok(())
        };
        parallel::map(self.jobs.iter().collect(), work).into_iter().collect()
    }
}
