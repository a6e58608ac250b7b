//! A stream that arrives in parts, and the chunk of it that is decoded.

use crate::error::{Error, Result};
use crate::plain::{Array, ByteRange, Chunk, Frame, Info, Options};
use gs_model::{Axes, Scene};
use gsvx::sequence::{FrameGroup, Frames, Sequence};
use gsvx::{Index, Kind, Reader};
use std::mem::MaybeUninit;
use std::sync::{Mutex, MutexGuard};

/// A stream of which bytes are given as they arrive, and one decoded chunk of it. `gsvx_open` makes it,
/// `gsvx_close` frees it.
#[derive(Debug)]
pub struct Stream(Mutex<State>);

#[derive(Debug)]
pub(crate) struct State {
    reader: Reader,
    axes: Axes,
    max_sh_degree: u8,
    max_gaussians: Option<u64>,
    /// The Gaussians of the decoded chunk or frame, in the caller's axes.
    decoded: Option<Scene>,
    /// The group of frames that was decoded last, and what the head said of it.
    group: Option<(FrameGroup, Frames)>,
}

impl Stream {
    pub(crate) fn new(options: Option<&Options>) -> Result<Self> {
        let default = Options { axes: 0, max_sh_coefficients: 0, max_gaussians: 0 };
        let options = options.unwrap_or(&default);
        let max_gaussians = Some(options.max_gaussians).filter(|&most| most > 0);
        Ok(Self(Mutex::new(State {
            reader: max_gaussians.map_or_else(Reader::new, Reader::with_max_gaussians),
            axes: axes(options.axes)?,
            max_sh_degree: max_sh_degree(options.max_sh_coefficients)?,
            max_gaussians,
            decoded: None,
            group: None,
        })))
    }

    /// The state. A call that panicked may have left it half changed.
    pub(crate) fn lock(&self) -> Result<MutexGuard<'_, State>> {
        self.0.lock().map_err(|_| Error::Internal("an earlier call failed within gsvx".into()))
    }
}

/// Axes by their number.
pub(crate) fn axes(number: u32) -> Result<Axes> {
    match number {
        0 => Ok(Axes::Stored),
        1 => Ok(Axes::YUp),
        2 => Ok(Axes::Unity),
        3 => Ok(Axes::Unreal),
        _ => Err(Error::Argument { what: "axes", value: number.into(), range: "one of gsvx_axes" }),
    }
}

/// The greatest SH degree with so many coefficients.
fn max_sh_degree(coefficients: u32) -> Result<u8> {
    match coefficients {
        1 => Ok(0),
        4 => Ok(1),
        9 => Ok(2),
        0 | 16 => Ok(3),
        other => Err(Error::Argument {
            what: "max_sh_coefficients",
            value: other.into(),
            range: "0, 1, 4, 9 or 16",
        }),
    }
}

impl State {
    /// Takes bytes of the stream.
    pub(crate) fn give(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        if offset.checked_add(bytes.len() as u64).is_none() {
            let range = "an offset of which the end fits 64 bits";
            return Err(Error::Argument { what: "offset", value: offset, range });
        }
        // The head first: what is given before it is known is copied once more.
        while let Some(need) = self.reader.head_needs() {
            let known = need.start.checked_sub(offset).filter(|&at| at < bytes.len() as u64);
            let Some(at) = known else { break };
            let end = (bytes.len() as u64).min(need.end.saturating_sub(offset));
            self.reader.give(need.start, &bytes[at as usize..end as usize])?;
        }
        Ok(self.reader.give(offset, bytes)?)
    }

    /// The first bytes that are missing: of the head, then of a chunk. Empty if nothing is.
    pub(crate) fn needs(&self, chunk: u64, layers: u32) -> Result<ByteRange> {
        if let Some(head) = self.reader.head_needs() {
            return Ok(ByteRange { begin: head.start, end: head.end });
        }
        if layers == 0 {
            return Ok(ByteRange { begin: 0, end: 0 });
        }
        let missing = self.reader.needs(self.chunk_number(chunk)?, layers as usize);
        let first = missing.first().map_or((0, 0), |range| (range.start, range.end));
        Ok(ByteRange { begin: first.0, end: first.1 })
    }

    fn index(&self) -> Result<&Index> {
        self.reader.index().ok_or(Error::NoIndex)
    }

    fn chunk_number(&self, chunk: u64) -> Result<usize> {
        let all = self.index()?.chunks.len();
        let fits = usize::try_from(chunk).ok().filter(|&c| c < all);
        fits.ok_or(Error::Argument {
            what: "chunk",
            value: chunk,
            range: "less than gsvx_info.chunks",
        })
    }

    /// SH degree of the arrays.
    fn sh_degree(&self) -> Result<u8> {
        Ok(self.index()?.header.sh_degree.min(self.max_sh_degree))
    }

    /// What the head says of the stream.
    pub(crate) fn info(&self) -> Result<Info> {
        let index = self.index()?;
        let bounds = index.chunks_of_lod(0).map(|i| self.axes.turn_box(index.chunks[i].bounds));
        let nothing = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        let [low, high] = bounds.fold(nothing, |[low, high], [a, b]| {
            [std::array::from_fn(|k| low[k].min(a[k])), std::array::from_fn(|k| high[k].max(b[k]))]
        });
        Ok(Info {
            gaussians: index.header.count,
            bytes: index.stream_len(),
            chunks: index.chunks.len() as u64,
            levels: 1 + u32::from(index.coarsest_lod()),
            sh_degree: self.sh_degree()?.into(),
            low,
            high,
            antialiased: index.header.antialiased.into(),
        })
    }

    /// What the index says of a chunk.
    pub(crate) fn chunk(&self, number: u64) -> Result<Chunk> {
        let number = self.chunk_number(number)?;
        let index = self.index()?;
        let chunk = &index.chunks[number];
        let finer = index.finer(number);
        let [low, high] = self.axes.turn_box(chunk.bounds);
        Ok(Chunk {
            gaussians: chunk.count,
            finer_begin: finer.start as u64,
            finer_end: finer.end as u64,
            low,
            high,
            level: chunk.lod.into(),
            exact: u32::from(chunk.kind == Kind::Exact),
            layers: chunk.layers.len().min(1 + usize::from(self.sh_degree()?)) as u32,
        })
    }

    /// Decodes the first layers of a chunk in place of what was decoded before.
    pub(crate) fn decode(&mut self, chunk: u64, layers: u32) -> Result<u64> {
        let number = self.chunk_number(chunk)?;
        let mut scene = self.decoded.take().unwrap_or_default();
        scene.sh_degree = self.sh_degree()?;
        let layers = (layers as usize).clamp(1, 1 + usize::from(scene.sh_degree));
        let count = self.reader.hold(number, layers)?;
        self.reader.held_block(0..count, &mut scene)?;
        self.axes.turn(&mut scene);
        self.decoded = Some(scene);
        Ok(count as u64)
    }

    /// Decodes a frame of a sequence in place of what was decoded before.
    pub(crate) fn decode_frame(&mut self, bytes: &[u8], number: u64) -> Result<Frame> {
        let sequence = Sequence::parse(bytes)?;
        let range = "less than gsvx_frame.frames";
        let group = sequence.group_of(number);
        let group = group.ok_or(Error::Argument { what: "frame", value: number, range })?;
        let entry = &sequence.groups[group];
        let held = self.group.take().filter(|(held, _)| held == entry);
        let (_, frames) = self.group.insert(match held {
            Some(held) => held,
            None => (entry.clone(), sequence.group(bytes, group, self.max_gaussians)?),
        });
        let mut scene = frames.frame((number - entry.frames.start) as usize);
        scene.cut_sh(self.max_sh_degree);
        self.axes.turn(&mut scene);
        let (gaussians, sh_degree) = (scene.len() as u64, scene.sh_degree.into());
        self.decoded = Some(scene);
        Ok(Frame { frames: sequence.frames(), gaussians, fps: sequence.fps, sh_degree })
    }

    /// Copies an array of the decoded chunk or frame.
    pub(crate) fn copy(&self, array: u32, out: &mut [MaybeUninit<u8>]) -> Result<()> {
        let array = Array::numbered(array)?;
        let scene = self.decoded.as_ref().ok_or(Error::NothingDecoded)?;
        array.write(scene, out).map(drop)
    }

    /// Forgets the bytes of a chunk.
    pub(crate) fn forget(&mut self, chunk: u64) -> Result<()> {
        let chunk = self.chunk_number(chunk)?;
        self.reader.forget(chunk);
        Ok(())
    }
}
