//! From frames to a sequence: groups of frames whose Gaussians correspond.

mod absent;
mod curves;
mod motion;
mod reference;
mod tracks;

use super::encode::CodingChoice;
use super::options::{DEFAULT_QUALITY, EncodeOptions};
use super::prepare::{Inside, encode_tiled, inside};
use crate::bytes::Writer;
use crate::chunk::check;
use crate::decode::{DecodeOptions, Decoder};
use crate::error::{Error, Result};
use crate::head::{SEQUENCE_VERSION, Steps, closed};
use crate::sequence::MOST_FRAMES;
use gs_model::Scene;
use motion::MovedLeaves;
use tracks::Tracks;
use voxel::{Merge, Merging, Place};

/// How a sequence is encoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SequenceOptions {
    /// Frames per second.
    pub fps: f32,
    /// Quality from 0 (smallest) to 100 (best).
    pub quality: f32,
    /// Most frames of a group, up to [`MOST_FRAMES`]: a longer one is smaller, a shorter one faster to seek. The encoder
    /// holds all frames of a group in memory, about three times.
    pub group: usize,
    /// What is kept, and the layout of the static streams.
    pub encode: EncodeOptions,
}

impl Default for SequenceOptions {
    fn default() -> Self {
        Self { fps: 30.0, quality: DEFAULT_QUALITY, group: 60, encode: EncodeOptions::default() }
    }
}

/// Makes a sequence of frames, one after another. Outliers, which are coded bit for bit, stand still where they are in the
/// mean.
#[derive(Debug)]
pub struct SequenceEncoder {
    options: SequenceOptions,
    /// Origin and SH degree of all frames.
    like: Option<([f64; 3], u8)>,
    tracks: Tracks,
    groups: Vec<EncodedGroup>,
}

#[derive(Debug)]
struct EncodedGroup {
    frames: usize,
    stream: Vec<u8>,
    motion: Vec<u8>,
    /// Gaussians that no frame draws, and outliers.
    transparent: usize,
    outliers: usize,
}

impl SequenceEncoder {
    /// Without frames yet.
    ///
    /// # Errors
    /// [`Error::Option`].
    pub fn new(options: SequenceOptions) -> Result<Self> {
        let SequenceOptions { fps, quality, group, .. } = options;
        Steps::of_quality(quality)?;
        if !(0.001..=1000.0).contains(&fps) {
            let (option, range) = ("frames per second", "from 0.001 to 1000");
            return Err(Error::Option { option, value: fps.into(), range });
        }
        if !(1..=MOST_FRAMES).contains(&group) {
            let (option, range) = ("frames of a group", "from 1 to 256");
            return Err(Error::Option { option, value: group as f64, range });
        }
        Ok(Self { options, like: None, tracks: Tracks::default(), groups: Vec::new() })
    }

    /// Adds a frame. Where its rows are not those of the frame before, its Gaussians are matched with those so far; if most
    /// of them are new, a group begins.
    ///
    /// # Errors
    /// As [`crate::encode`].
    pub fn push(&mut self, frame: Scene) -> Result<()> {
        let frame = self.checked(frame)?;
        if let Some(frame) = self.tracks.push(frame) {
            self.close()?;
            // The first frame of a group is always taken.
            self.tracks.push(frame);
        }
        Ok(())
    }

    /// Adds a frame whose rows are the same Gaussians in all frames. `there` says which of them the frame has.
    ///
    /// # Errors
    /// As [`crate::encode`]; [`Error::Option`] if the number of rows is not that of `there` and of the frames before.
    pub fn push_known(&mut self, frame: Scene, there: &[bool]) -> Result<()> {
        let frame = self.checked(frame)?;
        let before = self.tracks.rows().unwrap_or(there.len());
        if frame.len() != there.len() || before != there.len() {
            let (option, range) = ("rows of a frame", "as many as in the frames before");
            return Err(Error::Option { option, value: frame.len() as f64, range });
        }
        self.tracks.push_known(frame, there);
        Ok(())
    }

    /// A frame like those before. Begins a group if the last is full.
    fn checked(&mut self, mut frame: Scene) -> Result<Scene> {
        check(&frame, 0)?;
        let (origin, expected) = *self.like.get_or_insert((frame.origin, frame.sh_degree));
        if frame.sh_degree != expected {
            return Err(Error::FrameDegree { found: frame.sh_degree, expected });
        }
        if frame.origin != origin {
            frame.move_origin(origin);
        }
        if self.tracks.len() == self.options.group {
            self.close()?;
        }
        Ok(frame)
    }

    /// Encodes the frames that have come as a group.
    fn close(&mut self) -> Result<()> {
        let tracks = std::mem::take(&mut self.tracks);
        if tracks.len() > 0 {
            self.groups.push(encode_group(tracks, &self.options)?);
        }
        Ok(())
    }

    /// The most Gaussians of a group, of those encoded so far, that are left out because no rasterizer draws them in any
    /// frame.
    #[must_use]
    pub fn transparent(&self) -> usize {
        self.groups.iter().map(|group| group.transparent).max().unwrap_or(0)
    }

    /// The most outliers of a group, of those encoded so far.
    #[must_use]
    pub fn outliers(&self) -> usize {
        self.groups.iter().map(|group| group.outliers).max().unwrap_or(0)
    }

    /// The sequence of all frames that have come.
    ///
    /// # Errors
    /// As [`SequenceEncoder::push`].
    pub fn finish(&mut self) -> Result<Vec<u8>> {
        self.close()?;
        let mut body = Writer::default();
        body.f32(self.options.fps);
        body.varint(self.groups.len() as u64);
        for EncodedGroup { frames, stream, motion, .. } in &self.groups {
            body.varint(*frames as u64);
            body.varint(stream.len() as u64);
            body.varint(motion.len() as u64);
            body.u32(crc32c::crc32c_append(crc32c::crc32c(stream), motion));
        }
        let mut out = closed(SEQUENCE_VERSION, &body.bytes);
        self.groups.iter().for_each(|group| {
            out.extend(&group.stream);
            out.extend(&group.motion);
        });
        Ok(out)
    }
}

/// Encodes the frames of a group.
fn encode_group(tracks: Tracks, options: &SequenceOptions) -> Result<EncodedGroup> {
    let SequenceOptions { quality, encode, .. } = options;
    let (mut frames, alive) = tracks.into_frames();
    absent::move_on(&mut frames, &alive);
    let (steps, count) = (Steps::of_quality(*quality)?, frames.len());
    let reference = reference::reference(&frames);
    let transparent = reference.drawn().map_or(0, |drawn| reference.len() - drawn.len());
    let Inside { scene, rows, mut leaves, outliers, log_size } =
        inside(&reference, None, *quality, &encode.prepare)?;
    let of = |row: usize| &alive[row * count..(row + 1) * count];
    if !alive.is_empty() {
        // What is not there at the same time is not merged.
        let apart = |members: &[u32]| {
            members.windows(2).any(|m| of(rows[m[0] as usize]) != of(rows[m[1] as usize]))
        };
        (leaves.voxels, leaves.shared) = (leaves.voxels.split(&scene.means, apart)?, None);
    }
    let (encoded, voxels, weights) =
        encode_tiled(&scene, leaves, outliers.as_ref(), CodingChoice::new(&steps, &encode.code))?;
    let mut motion = Writer::default();
    if count > 1 {
        let merged = |scene: &Scene| -> Result<Scene> {
            let merging = Merging::new(scene, &voxels, Merge::Moments, &weights)?;
            Ok(merging.at(Place::MemberMean).scene())
        };
        let first = |leaf: usize| rows[voxels.members_of(leaf)[0] as usize];
        let there = (0..if alive.is_empty() { 0 } else { voxels.len() }).flat_map(|i| of(first(i)));
        let moved = MovedLeaves {
            reference: merged(&scene)?,
            alive: there.copied().collect(),
            frames: frames.iter().map(|f| merged(&f.select(&rows))).collect::<Result<_>>()?,
            steps: MovedLeaves::steps(&steps, libm::exp(log_size) as f32),
        };
        drop(frames);
        let all = DecodeOptions { max_gaussians: Some(u64::MAX), ..DecodeOptions::default() };
        let mut first = 0;
        Decoder::new(&encoded.bytes, &all)?.decoded(|chunk| {
            if let Some(values) = chunk.leaves() {
                motion.block(&moved.encode(first, values)?);
            }
            first += chunk.len();
            Ok(())
        })?;
    }
    let outliers = outliers.map_or(0, |outliers| outliers.len());
    Ok(EncodedGroup {
        frames: count,
        stream: encoded.bytes,
        motion: motion.bytes,
        transparent,
        outliers,
    })
}
