//! The head of a stream: signature, header and index, under one checksum.
//!
//! The index tells where each layer of each chunk lies, so that a reader fetches what it wants and
//! nothing else. Normative description: `docs/format.md`, "Head".

use crate::bytes::SliceReader;
#[cfg(feature = "encode")]
use crate::bytes::Writer;
use crate::error::{Error, Result};
use gpcc_lite::Cube;
use gs_model::Scene;
use std::ops::Range;

/// First eight bytes of every stream. The non-ASCII byte, CR LF and ^Z catch text-mode transfers, as
/// in PNG.
pub const SIGNATURE: [u8; 8] = [0x89, b'G', b'S', b'V', b'X', 0x0d, 0x0a, 0x1a];
/// The version of the format.
pub const VERSION: u8 = 1;
/// The version in the head of a sequence.
pub(crate) const SEQUENCE_VERSION: u8 = 2;
/// Bytes before the head's body, which tell how long the head is: signature, version and the length of the body.
pub(crate) const PREAMBLE: usize = SIGNATURE.len() + 1 + 4;
/// Greatest length of the head's body: the index of 2^20 chunks fits.
const LONGEST_BODY: u32 = 1 << 26;
/// Most levels of detail.
pub(crate) const MAX_LODS: u8 = 8;
/// Bytes of an index entry at least (kind, count, first cell, box; length and checksum of a layer):
/// bounds the memory that a head can ask for.
const LEAST_ENTRY: usize = 1 + 1 + 1 + 24 + 1 + 4;

/// Quantisation steps of a Gaussian of class [`crate::importance::MEAN_CLASS`]. One of class `c` more
/// has steps `2^c` times finer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steps {
    /// Of `ln(alpha)`.
    pub opacity: f32,
    /// Of the DC coefficients.
    pub dc: f32,
    /// Of the SH coefficients of degree 1, 2, 3.
    pub sh: [f32; 3],
    /// Of the six log-Euclidean covariance coordinates (natural logarithms).
    pub covariance: f32,
}

impl Steps {
    #[cfg(feature = "encode")]
    pub(crate) fn all(&self) -> [f32; 6] {
        let [a, b, c] = self.sh;
        [self.opacity, self.dc, a, b, c, self.covariance]
    }

    /// True for a step that a stream may have.
    pub(crate) fn is_valid(step: f32) -> bool {
        step.is_normal() && step > 0.0 && step < 1e9
    }
}

/// What holds for the whole scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Header {
    /// Number of Gaussians, coarser levels of detail not counted.
    pub count: u64,
    /// SH degree stored, 0 to 3.
    pub sh_degree: u8,
    /// Finest octree depth, 0 to 21.
    pub j_high: u8,
    /// The cube that the octree divides.
    pub cube: Cube,
    /// Quantisation steps.
    pub steps: Steps,
    /// See [`Scene::antialiased`].
    pub antialiased: bool,
    /// See [`Scene::origin`].
    pub origin: [f64; 3],
}

impl Header {
    /// A scene without Gaussians, of the stream's SH degree or `most`.
    #[must_use]
    pub fn empty_scene(&self, most: u8) -> Scene {
        let &Self { sh_degree, antialiased, origin, .. } = self;
        Scene { sh_degree: sh_degree.min(most), antialiased, origin, ..Scene::default() }
    }
}

/// What a chunk holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Gaussians at the centres of octree leaves, in as many layers as the SH degree and one.
    Leaves,
    /// Gaussians bit for bit, in one layer.
    Exact,
}

/// One layer of a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Offset of the first byte in the stream.
    pub offset: u64,
    /// Number of bytes.
    pub len: u64,
    /// CRC-32C (Castagnoli) of the bytes.
    pub crc: u32,
}

impl Layer {
    /// Its bytes in the stream.
    #[must_use]
    pub fn range(&self) -> Range<u64> {
        self.offset..self.offset + self.len
    }
}

/// One chunk, as the index has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Chunk {
    /// What it holds.
    pub kind: Kind,
    /// Level of detail: 0 is the finest. See [`Index::finer`].
    pub lod: u8,
    /// Number of Gaussians.
    pub count: u64,
    /// Morton code, at the finest depth, of its first cell; 0 for [`Kind::Exact`].
    pub first_cell: u64,
    /// Least and greatest coordinates of its Gaussians' means.
    pub bounds: [[f32; 3]; 2],
    /// Its layers; each depends on those before.
    pub layers: Vec<Layer>,
}

impl Chunk {
    /// The bytes in the stream of its first `layers` layers, which lie side by side.
    #[must_use]
    pub fn range(&self, layers: usize) -> Range<u64> {
        let start = self.layers[0].offset;
        let end =
            self.layers[..layers.clamp(1, self.layers.len())].iter().map(|l| l.len).sum::<u64>();
        start..start + end
    }
}

/// Header and index. The default is that of an empty scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Index {
    /// What holds for the whole scene.
    pub header: Header,
    /// The chunks in stream order: coarse levels of detail first, and in Morton order within a level.
    pub chunks: Vec<Chunk>,
    /// Bytes of signature, header and index.
    pub head_len: u64,
}

/// How many bytes of a stream hold signature, header and index. `start` has its first 13 bytes or more.
///
/// # Errors
/// [`Error::NotGsvx`], [`Error::Version`], [`Error::Truncated`] if `start` is too short, or [`Error::Corrupt`] for a
/// head that is longer than any.
pub(crate) fn head_len(start: &[u8]) -> Result<u64> {
    head_len_of(VERSION, start)
}

/// The same for the head of a version.
fn head_len_of(ours: u8, start: &[u8]) -> Result<u64> {
    let known = start.len().min(SIGNATURE.len());
    if known == 0 || start[..known] != SIGNATURE[..known] {
        return Err(Error::NotGsvx);
    }
    let mut r = SliceReader::new(start, "head");
    r.take(SIGNATURE.len())?;
    let version = r.u8()?;
    if version == SEQUENCE_VERSION && ours == VERSION {
        return Err(Error::IsSequence);
    }
    if version == VERSION && ours == SEQUENCE_VERSION {
        return Err(Error::IsStatic);
    }
    if version != ours {
        return Err(Error::Version { version, ours });
    }
    let body = r.u32()?;
    if body > LONGEST_BODY {
        return Err(corrupt("length of the head", body));
    }
    Ok((PREAMBLE + 4) as u64 + u64::from(body))
}

/// The body of a head of a version, whose checksum is right, and the length of the head.
pub(crate) fn opened(version: u8, bytes: &[u8]) -> Result<(&[u8], u64)> {
    let head_len = head_len_of(version, bytes)?;
    let have = bytes.len() as u64;
    // It is no longer than the longest, which fits 32 bits.
    let head = bytes.get(..head_len as usize).ok_or(Error::Truncated {
        what: "head",
        offset: have,
        need: head_len,
        have,
    })?;
    let (checked, crc) = head.split_at(head.len() - 4);
    let expected = u32::from_le_bytes([crc[0], crc[1], crc[2], crc[3]]);
    let found = crc32c::crc32c(checked);
    if found != expected {
        return Err(Error::HeadChecksum { expected, found });
    }
    Ok((&checked[PREAMBLE..], head_len))
}

/// The head of a version with this body.
#[cfg(feature = "encode")]
pub(crate) fn closed(version: u8, body: &[u8]) -> Vec<u8> {
    let mut out = Writer { bytes: SIGNATURE.to_vec() };
    out.u8(version);
    out.u32(body.len() as u32);
    out.bytes.extend(body);
    let crc = crc32c::crc32c(&out.bytes);
    out.u32(crc);
    out.bytes
}

impl Index {
    /// Reads the head of a stream; `bytes` may go on behind it.
    ///
    /// # Errors
    /// [`Error::NotGsvx`], [`Error::Version`], [`Error::Truncated`], [`Error::HeadChecksum`] or
    /// [`Error::Corrupt`]. Memory is in proportion to the bytes.
    pub fn parse(bytes: &[u8]) -> Result<Self> {
        let (body, head_len) = opened(VERSION, bytes)?;
        let mut r = SliceReader::new(body, "head");
        let header = read_header(&mut r)?;
        let chunks = read_chunks(&mut r, &header, head_len)?;
        Ok(Self { header, chunks, head_len })
    }

    /// The head as bytes. Offsets of layers are not written: they follow from the lengths.
    #[cfg(feature = "encode")]
    pub(crate) fn to_bytes(header: &Header, chunks: &[Chunk]) -> Vec<u8> {
        let mut body = Writer::default();
        write_header(&mut body, header);
        body.varint(chunks.len() as u64);
        for chunk in chunks {
            body.u8(match chunk.kind {
                Kind::Leaves => chunk.lod,
                Kind::Exact => EXACT,
            });
            body.varint(chunk.count);
            body.varint(chunk.first_cell);
            chunk.bounds.as_flattened().iter().for_each(|&v| body.f32(v));
            for layer in &chunk.layers {
                body.varint(layer.len);
                body.u32(layer.crc);
            }
        }
        closed(VERSION, &body.bytes)
    }

    /// The head in front of layers that follow it back to back, and the same as bytes.
    ///
    /// # Errors
    /// [`Error::Option`] if there are more chunks than a head holds.
    #[cfg(feature = "encode")]
    pub(crate) fn before(header: Header, mut chunks: Vec<Chunk>) -> Result<(Self, Vec<u8>)> {
        let bytes = Self::to_bytes(&header, &chunks);
        if bytes.len() - PREAMBLE - 4 > LONGEST_BODY as usize {
            let (option, value) = ("the number of chunks", chunks.len() as f64);
            let range = "so few that their index takes at most 64 MiB: encode larger chunks";
            return Err(Error::Option { option, value, range });
        }
        let head_len = bytes.len() as u64;
        let mut offset = head_len;
        for layer in chunks.iter_mut().flat_map(|c| &mut c.layers) {
            layer.offset = offset;
            offset += layer.len;
        }
        Ok((Self { header, chunks, head_len }, bytes))
    }

    /// The head of a stream of some chunks of this one, as its finest level of detail. Their layers follow it,
    /// back to back and in the given order. SH degrees that are empty in all of them are left out: each chunk
    /// of leaves has as many layers in the new stream as [`Index::parse`] of the result says.
    ///
    /// `chunks` are numbers of chunks of one level of detail, ascending.
    #[cfg(feature = "encode")]
    #[must_use]
    pub fn head_of(&self, chunks: &[usize]) -> Vec<u8> {
        let mut chosen: Vec<Chunk> = chunks.iter().map(|&i| self.chunks[i].clone()).collect();
        let used = |c: &Chunk| match c.kind {
            Kind::Exact => self.header.sh_degree,
            Kind::Leaves => c.layers.iter().rposition(|l| l.len > 0).unwrap_or(0) as u8,
        };
        let sh_degree = chosen.iter().map(used).max().unwrap_or(0);
        for chunk in &mut chosen {
            chunk.lod = 0;
            chunk.layers.truncate(1 + usize::from(sh_degree));
        }
        let count = chosen.iter().map(|c| c.count).sum();
        Self::to_bytes(&Header { count, sh_degree, ..self.header.clone() }, &chosen)
    }

    /// The number of bytes of each part of the stream: head, coarse levels, base layers, each SH degree,
    /// exact Gaussians. Parts of no bytes are left out.
    #[must_use]
    pub fn parts(&self) -> Vec<(&'static str, u64)> {
        const NAMES: [&str; 7] = [
            "head",
            "coarse levels",
            "base layers",
            "SH degree 1",
            "SH degree 2",
            "SH degree 3",
            "exact Gaussians",
        ];
        let mut sums = [self.head_len, 0, 0, 0, 0, 0, 0];
        for chunk in &self.chunks {
            for (degree, layer) in chunk.layers.iter().enumerate() {
                let part = match chunk.kind {
                    Kind::Exact => 6,
                    Kind::Leaves if chunk.lod > 0 => 1,
                    Kind::Leaves => 2 + degree,
                };
                sums[part] += layer.len;
            }
        }
        NAMES.into_iter().zip(sums).filter(|(_, sum)| *sum > 0).collect()
    }

    /// Length that the whole stream has.
    #[must_use]
    pub fn stream_len(&self) -> u64 {
        let layers = self.chunks.iter().flat_map(|c| &c.layers);
        layers.fold(self.head_len, |end, l| end.max(l.offset.saturating_add(l.len)))
    }

    /// The coarsest level of detail; 0 if the stream has none but the finest.
    #[must_use]
    pub fn coarsest_lod(&self) -> u8 {
        self.chunks.iter().map(|c| c.lod).max().unwrap_or(0)
    }

    /// The numbers of the chunks of a level of detail. Exact Gaussians belong to every level.
    pub fn chunks_of_lod(&self, lod: u8) -> impl Iterator<Item = usize> {
        let of_lod = move |(_, c): &(usize, &Chunk)| c.kind == Kind::Exact || c.lod == lod;
        self.chunks.iter().enumerate().filter(of_lod).map(|(i, _)| i)
    }

    /// The chunks of the next finer level that together replace chunk `chunk`. Empty for a chunk of the
    /// finest level and for exact Gaussians.
    #[must_use]
    pub fn finer(&self, chunk: usize) -> Range<usize> {
        let Chunk { kind, lod, first_cell, .. } = self.chunks[chunk];
        if kind == Kind::Exact || lod == 0 {
            return 0..0;
        }
        let next = self.chunks.get(chunk + 1).filter(|c| c.kind == Kind::Leaves && c.lod == lod);
        // Coarse levels come first, and cells ascend in each.
        let up_to = |cell: u64| {
            self.chunks.partition_point(|c| {
                c.kind == Kind::Leaves && (c.lod >= lod || c.lod + 1 == lod && c.first_cell < cell)
            })
        };
        up_to(first_cell)..up_to(next.map_or(u64::MAX, |c| c.first_cell))
    }
}

/// Bits of the header's first byte, above the SH degree.
const ANTIALIASED: u8 = 0x40;
const HAS_ORIGIN: u8 = 0x80;

/// The code of [`Kind::Exact`] in an index entry, in the place of a level of detail.
const EXACT: u8 = 255;

#[cfg(feature = "encode")]
fn write_header(w: &mut Writer, header: &Header) {
    let has_origin = header.origin != [0.0; 3];
    let flag = |set: bool, bit: u8| if set { bit } else { 0 };
    w.u8(header.sh_degree | flag(header.antialiased, ANTIALIASED) | flag(has_origin, HAS_ORIGIN));
    w.u8(header.j_high);
    header.cube.origin.iter().for_each(|&v| w.f64(v));
    w.f64(header.cube.side);
    header.steps.all().iter().for_each(|&v| w.f32(v));
    if has_origin {
        header.origin.iter().for_each(|&v| w.f64(v));
    }
    w.varint(header.count);
}

fn corrupt(what: &'static str, value: impl Into<u64>) -> Error {
    Error::Corrupt { what, value: value.into() }
}

fn read_header(r: &mut SliceReader<'_>) -> Result<Header> {
    let first = r.u8()?;
    let (antialiased, has_origin) = (first & ANTIALIASED != 0, first & HAS_ORIGIN != 0);
    let sh_degree = first & !(ANTIALIASED | HAS_ORIGIN);
    if sh_degree > 3 {
        return Err(corrupt("SH degree", sh_degree));
    }
    let j_high = r.u8()?;
    if j_high > gpcc_lite::morton::MAX_DEPTH {
        return Err(corrupt("octree depth", j_high));
    }
    let corner = finite_f64s(r, "cube origin")?;
    let side = r.finite_f64("cube side")?;
    if side <= 0.0 {
        return Err(corrupt("cube side", side.to_bits()));
    }
    let mut steps = [0.0; 6];
    for v in &mut steps {
        *v = r.finite_f32("quantisation step")?;
        if !Steps::is_valid(*v) {
            return Err(corrupt("quantisation step", v.to_bits()));
        }
    }
    let [opacity, dc, sh1, sh2, sh3, covariance] = steps;
    let steps = Steps { opacity, dc, sh: [sh1, sh2, sh3], covariance };
    let origin = if has_origin { finite_f64s(r, "origin")? } else { [0.0; 3] };
    let count = r.varint()?;
    let cube = Cube { origin: corner, side };
    Ok(Header { count, sh_degree, j_high, cube, steps, antialiased, origin })
}

fn finite_f64s(r: &mut SliceReader<'_>, what: &'static str) -> Result<[f64; 3]> {
    Ok([r.finite_f64(what)?, r.finite_f64(what)?, r.finite_f64(what)?])
}

fn read_chunks(r: &mut SliceReader<'_>, header: &Header, head_len: u64) -> Result<Vec<Chunk>> {
    let count = r.varint()?;
    if count > (r.remaining() / LEAST_ENTRY) as u64 {
        return Err(corrupt("number of chunks", count));
    }
    let mut offset = head_len;
    let mut chunks: Vec<Chunk> = Vec::with_capacity(count as usize);
    let mut total = 0u64;
    for _ in 0..count {
        let chunk = read_chunk(r, header, &mut offset)?;
        if let Some(before) = chunks.last()
            && !in_order(before, &chunk)
        {
            return Err(corrupt("first cell of a chunk out of order", chunk.first_cell));
        }
        if chunk.lod == 0 {
            total = total.checked_add(chunk.count).ok_or(corrupt("Gaussians", chunk.count))?;
        }
        chunks.push(chunk);
    }
    let last = chunks.iter().rfind(|c| c.kind == Kind::Leaves).map_or(0, |c| c.lod);
    if last != 0 {
        return Err(corrupt("finest level of detail", last));
    }
    if total != header.count {
        return Err(corrupt("number of Gaussians", header.count));
    }
    Ok(chunks)
}

/// Coarse levels first and none left out, Morton order within a level, exact chunks last.
fn in_order(before: &Chunk, chunk: &Chunk) -> bool {
    match (before.kind, chunk.kind) {
        (_, Kind::Exact) => true,
        (Kind::Exact, Kind::Leaves) => false,
        _ => {
            before.lod == chunk.lod + 1
                || chunk.lod == before.lod && chunk.first_cell > before.first_cell
        }
    }
}

fn read_chunk(r: &mut SliceReader<'_>, header: &Header, offset: &mut u64) -> Result<Chunk> {
    let (kind, lod) = match r.u8()? {
        EXACT => (Kind::Exact, 0),
        lod if lod <= MAX_LODS => (Kind::Leaves, lod),
        other => return Err(corrupt("level of detail", other)),
    };
    let count = r.varint()?;
    if count == 0 || count >= u64::from(u32::MAX) {
        return Err(corrupt("Gaussians of a chunk", count));
    }
    let first_cell = r.varint()?;
    if first_cell >> (3 * header.j_high) != 0 {
        return Err(corrupt("first cell of a chunk", first_cell));
    }
    let mut bounds = [[0.0; 3]; 2];
    for v in bounds.as_flattened_mut() {
        *v = r.f32()?;
    }
    let mut layers = Vec::new();
    let of_kind = match kind {
        Kind::Leaves => 1 + usize::from(header.sh_degree),
        Kind::Exact => 1,
    };
    for _ in 0..of_kind {
        let len = r.varint()?;
        layers.push(Layer { offset: *offset, len, crc: r.u32()? });
        *offset = offset.checked_add(len).ok_or(corrupt("length of a layer", len))?;
    }
    Ok(Chunk { kind, lod, count, first_cell, bounds, layers })
}
