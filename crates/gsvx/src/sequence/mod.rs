//! Sequences: groups of frames, each a static stream and what moves in it.
//!
//! A group needs no other. Its static stream is one of format 1, bit for bit: the scene about which the frames vary.
//! Normative description: `docs/format-sequences.md`.

pub(crate) mod motion;

use crate::bytes::SliceReader;
use crate::decode::{ALWAYS_ACCEPTED, DEFAULT_GROWTH, DecodeOptions, Decoder};
use crate::error::{Error, Result};
use crate::head::{SEQUENCE_VERSION, SIGNATURE, opened};
use gs_model::Scene;
use motion::Motion;
use std::ops::Range;

/// Most frames of a group.
pub const MOST_FRAMES: usize = 256;
/// Bytes of a group in the head at least.
const LEAST_ENTRY: usize = 7;

/// A group of frames, as the head has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameGroup {
    /// Its frames.
    pub frames: Range<u64>,
    /// The bytes of its static stream.
    pub stream: Range<u64>,
    /// The bytes of what moves, behind it.
    pub motion: Range<u64>,
    /// CRC-32C of both.
    pub crc: u32,
}

/// The head of a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// Frames per second.
    pub fps: f32,
    /// The groups in order.
    pub groups: Vec<FrameGroup>,
}

/// A decoded group, ready to give its frames.
#[derive(Debug)]
pub struct Frames {
    /// Without motion.
    scene: Scene,
    /// By chunk.
    motions: Vec<Motion>,
    frames: usize,
}

/// Whether bytes begin like those of a sequence.
#[must_use]
pub fn is_sequence(bytes: &[u8]) -> bool {
    bytes.starts_with(&SIGNATURE) && bytes.get(SIGNATURE.len()) == Some(&SEQUENCE_VERSION)
}

impl Sequence {
    /// Reads the head; `bytes` may go on behind it.
    ///
    /// # Errors
    /// As [`crate::Index::parse`].
    pub fn parse(bytes: &[u8]) -> Result<Self> {
        let (body, mut at) = opened(SEQUENCE_VERSION, bytes)?;
        let mut r = SliceReader::new(body, "head");
        let fps = r.finite_f32("frames per second")?;
        if !(fps.is_normal() && fps > 0.0) {
            return Err(Error::Corrupt { what: "frames per second", value: fps.to_bits().into() });
        }
        let count = r.varint()?;
        if count > (r.remaining() / LEAST_ENTRY) as u64 {
            return Err(Error::Corrupt { what: "number of groups", value: count });
        }
        let (mut first, mut groups) = (0, Vec::with_capacity(count as usize));
        for _ in 0..count {
            let frames = r.varint()?;
            if !(1..=MOST_FRAMES as u64).contains(&frames) {
                return Err(Error::Corrupt { what: "frames of a group", value: frames });
            }
            let mut part = || {
                let len = r.varint()?;
                let end = at.checked_add(len);
                let end = end.ok_or(Error::Corrupt { what: "length of a group", value: len })?;
                Ok::<_, Error>(std::mem::replace(&mut at, end)..end)
            };
            let (stream, motion) = (part()?, part()?);
            groups.push(FrameGroup {
                frames: first..first + frames,
                stream,
                motion,
                crc: r.u32()?,
            });
            first += frames;
        }
        Ok(Self { fps, groups })
    }

    /// The number of frames.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.groups.last().map_or(0, |group| group.frames.end)
    }

    /// Bytes of head and groups.
    #[must_use]
    pub fn stream_len(&self) -> u64 {
        self.groups.last().map_or(0, |group| group.motion.end)
    }

    /// The number of the group that has a frame.
    #[must_use]
    pub fn group_of(&self, frame: u64) -> Option<usize> {
        let after = self.groups.partition_point(|group| group.frames.end <= frame);
        (after < self.groups.len()).then_some(after)
    }

    /// The bytes of a group, verified: its static stream, and what moves.
    ///
    /// # Errors
    /// [`Error::Truncated`], [`Error::GroupChecksum`].
    pub fn bytes_of<'a>(&self, bytes: &'a [u8], number: usize) -> Result<(&'a [u8], &'a [u8])> {
        let FrameGroup { stream, motion, crc: expected, .. } = &self.groups[number];
        let (offset, have) = (stream.start, bytes.len() as u64);
        if motion.end > have {
            let (need, have) = (motion.end - offset, have.saturating_sub(offset));
            return Err(Error::Truncated { what: "a group of frames", offset, need, have });
        }
        let both = &bytes[offset as usize..motion.end as usize];
        let found = crc32c::crc32c(both);
        if found != *expected {
            return Err(Error::GroupChecksum { group: number, expected: *expected, found });
        }
        Ok(both.split_at((stream.end - offset) as usize))
    }

    /// Decodes a group; `max_gaussians` is as in [`DecodeOptions`]. Without it, what moves takes at most
    /// [`DEFAULT_GROWTH`] times its bytes, and [`ALWAYS_ACCEPTED`] more.
    ///
    /// # Errors
    /// As [`Sequence::bytes_of`] and [`crate::decode`].
    pub fn group(&self, bytes: &[u8], number: usize, max_gaussians: Option<u64>) -> Result<Frames> {
        let (stream, motion) = self.bytes_of(bytes, number)?;
        let options = DecodeOptions { max_gaussians, ..DecodeOptions::default() };
        let decoder = Decoder::new(stream, &options)?;
        let group = &self.groups[number].frames;
        let frames = (group.end - group.start) as usize;
        let (mut scene, mut motions) = (decoder.empty_scene(), Vec::new());
        let mut blocks = SliceReader::new(motion, "motion");
        // A caller who states the number of Gaussians expects what moves of them.
        let mut room = match max_gaussians {
            Some(_) => u64::MAX,
            None => DEFAULT_GROWTH * motion.len() as u64 + ALWAYS_ACCEPTED,
        };
        decoder.decoded(|chunk| {
            if let Some(leaves) = chunk.leaves().filter(|_| !motion.is_empty()) {
                let (block, first) = (blocks.block()?, scene.len());
                motions.push(Motion::decode(block, leaves, first, frames, &mut room)?);
            }
            scene.append(&chunk.scene(decoder.empty_scene())?);
            Ok(())
        })?;
        Ok(Frames { scene, motions, frames })
    }
}

impl Frames {
    /// The number of frames.
    #[must_use]
    pub fn len(&self) -> usize {
        self.frames
    }

    /// Whether there is none: never.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.frames == 0
    }

    /// A frame, from 0 to below [`Frames::len`].
    ///
    /// # Panics
    /// If there is no such frame.
    #[must_use]
    pub fn frame(&self, number: usize) -> Scene {
        let (mut scene, there) = self.all(number);
        if there.contains(&false) {
            scene.keep(&(0..there.len()).filter(|&i| there[i]).collect::<Vec<_>>());
        }
        scene
    }

    /// All Gaussians of the group as they are in a frame, and which of them are there.
    ///
    /// # Panics
    /// If there is no such frame.
    #[must_use]
    pub fn all(&self, number: usize) -> (Scene, Vec<bool>) {
        assert!(number < self.frames, "no frame {number}");
        let mut scene = self.scene.clone();
        self.motions.iter().for_each(|motion| motion.apply(number, &mut scene));
        let mut there = vec![true; scene.len()];
        self.motions.iter().for_each(|motion| motion.mark(number, &mut there));
        (scene, there)
    }

    /// For a player, which writes only what changes: the group without motion, the numbers of the Gaussians that are not
    /// alike in all frames, and the frames of these alone, up to the highest SH degree that moves.
    #[must_use]
    pub fn parted(mut self) -> (Scene, Vec<usize>, Self) {
        let mut moving = Vec::new();
        for motion in &mut self.motions {
            let first = moving.len();
            moving.extend(motion.alone(first));
        }
        let mut scene = self.scene.select(&moving);
        scene.cut_sh(self.motions.iter().map(Motion::sh_degree).max().unwrap_or(0));
        (self.scene, moving, Self { scene, motions: self.motions, frames: self.frames })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decoded_chunk::DecodedChunk;

    #[test]
    fn what_moves_in_all_chunks_shares_one_bound_of_memory() {
        let bytes = std::fs::read(testing::fixture("sequences/births.gsvx")).unwrap();
        let sequence = Sequence::parse(&bytes).unwrap();
        let frames = sequence.frames() as usize;
        let (stream, motion) = sequence.bytes_of(&bytes, 0).unwrap();
        let decoder = Decoder::new(stream, &DecodeOptions::default()).unwrap();
        let decoded = |room: u64| {
            let mut left = room;
            let decode = |chunk: &DecodedChunk| {
                let block = SliceReader::new(motion, "motion").block()?;
                Motion::decode(block, chunk.leaves().unwrap(), 0, frames, &mut left).map(drop)
            };
            decoder.decoded(decode).map(|()| room - left)
        };
        let taken = decoded(u64::MAX).unwrap();
        assert!(taken > 0 && decoded(taken).is_ok());
        assert!(matches!(decoded(taken - 1), Err(Error::Memory { .. })));
    }
}
