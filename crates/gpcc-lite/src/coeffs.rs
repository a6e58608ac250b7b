//! Entropy coding of quantised RAHT coefficients, a group of channels at a time.
//!
//! A group is one independent stream: channels that resemble each other (Y, U, V of one triple)
//! belong together, and groups can be coded on different cores. Inside a group the coder goes
//! coefficient by coefficient, coarse to fine, so that the magnitude of a coefficient is
//! predicted from its ancestors, from the two before it and from the channels already coded.

mod models;

use crate::bytes::{Reader, put_varint};
use crate::context::{Magnitudes, Packed, chunk_size};
use crate::error::{Error, Result};
use crate::raht::Plan;
use crate::range::{BinaryCoder, RangeDecoder, RangeEncoder};
use crate::rlgr;
use models::{Known, Models, Place};

/// Entropy coder of a stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Adaptive binary range coder with magnitude contexts: the small mode.
    #[default]
    Range,
    /// RLGR with [`rlgr::Params::REMOTE_FX`], channel after channel: the fast mode.
    Rlgr,
    /// RLGR with [`rlgr::Params::MALVAR`].
    RlgrMalvar,
}

const RAW: u8 = 0;
const RANGE: u8 = 1;
const RLGR_RFX: u8 = 2;
const RLGR_MALVAR: u8 = 3;

/// Codes a group of channels of quantised coefficients, each in coefficient order.
///
/// The result never exceeds 4 bytes per coefficient plus 1.
///
/// # Errors
/// If a channel's length is not `plan.len()`.
pub fn encode(plan: &Plan, channels: &[&[i32]], mode: Mode) -> Result<Vec<u8>> {
    for (channel, c) in channels.iter().enumerate() {
        if c.len() != plan.len() {
            return Err(Error::ChannelLength { channel, got: c.len(), want: plan.len() });
        }
    }
    let mut out = Vec::new();
    match mode {
        Mode::Range => {
            out.push(RANGE);
            let mut coder = RangeEncoder::new();
            code_channels(plan, &mut Given(channels), &mut coder);
            out.extend(coder.finish());
        }
        Mode::Rlgr | Mode::RlgrMalvar => {
            let (tag, params) = rlgr_params(mode);
            out.push(tag);
            for c in channels {
                let bytes = rlgr::encode(c, &params);
                put_varint(&mut out, bytes.len() as u64);
                out.extend(bytes);
            }
        }
    }
    if out.len() > 1 + 4 * plan.len() * channels.len() {
        out.clear();
        out.push(RAW);
        for c in channels {
            for v in *c {
                out.extend_from_slice(&v.to_le_bytes());
            }
        }
    }
    Ok(out)
}

fn rlgr_params(mode: Mode) -> (u8, rlgr::Params) {
    match mode {
        Mode::RlgrMalvar => (RLGR_MALVAR, rlgr::Params::MALVAR),
        Mode::Rlgr | Mode::Range => (RLGR_RFX, rlgr::Params::REMOTE_FX),
    }
}

/// Decodes a group of `channels` channels.
///
/// Memory is that of the result plus 8 bytes per coefficient, whatever the stream says.
///
/// # Errors
/// If the stream is truncated or holds what no encoder writes.
pub fn decode(plan: &Plan, bytes: &[u8], channels: usize) -> Result<Vec<Vec<i32>>> {
    let n = plan.len();
    let mut r = Reader::new(bytes);
    match r.u8("coefficient mode")? {
        RAW => {
            let mut out = Vec::with_capacity(channels);
            for _ in 0..channels {
                let raw = r.bytes(4 * n as u64, "raw coefficients")?;
                out.push(
                    raw.chunks_exact(4)
                        .map(|b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]))
                        .collect(),
                );
            }
            Ok(out)
        }
        RANGE => {
            let mut coder = RangeDecoder::new(&bytes[1..]);
            let mut out = vec![vec![0; n]; channels];
            code_channels(plan, &mut Wanted(&mut out), &mut coder);
            if coder.exhausted() {
                return Err(Error::Truncated { offset: bytes.len(), what: "coefficients" });
            }
            Ok(out)
        }
        tag @ (RLGR_RFX | RLGR_MALVAR) => {
            let params =
                if tag == RLGR_RFX { rlgr::Params::REMOTE_FX } else { rlgr::Params::MALVAR };
            let mut out = Vec::with_capacity(channels);
            for _ in 0..channels {
                let len = r.varint("RLGR length")?;
                out.push(rlgr::decode(r.bytes(len, "RLGR stream")?, n, &params)?);
            }
            Ok(out)
        }
        _ => Err(r.corrupt("coefficient mode")),
    }
}

/// Where levels come from, or go.
trait Levels {
    fn width(&self) -> usize;
    fn get(&self, channel: usize, k: usize) -> i32;
    fn set(&mut self, channel: usize, k: usize, level: i32);
}

/// The encoder's channels.
struct Given<'a>(&'a [&'a [i32]]);

impl Levels for Given<'_> {
    fn width(&self) -> usize {
        self.0.len()
    }

    #[inline]
    fn get(&self, channel: usize, k: usize) -> i32 {
        self.0[channel][k]
    }

    #[inline]
    fn set(&mut self, _: usize, _: usize, _: i32) {}
}

/// The decoder's channels, zeros at first.
struct Wanted<'a>(&'a mut [Vec<i32>]);

impl Levels for Wanted<'_> {
    fn width(&self) -> usize {
        self.0.len()
    }

    #[inline]
    fn get(&self, _: usize, _: usize) -> i32 {
        0
    }

    #[inline]
    fn set(&mut self, channel: usize, k: usize, level: i32) {
        self.0[channel][k] = level;
    }
}

/// Codes or decodes all channels.
fn code_channels<C: BinaryCoder, L: Levels>(plan: &Plan, levels: &mut L, coder: &mut C) {
    let n = plan.len();
    let width = levels.width();
    if n == 0 || width == 0 {
        return;
    }
    for ch in 0..width {
        let dc = coder.code_raw_wide(levels.get(ch, 0) as u32, 32) as i32;
        levels.set(ch, 0, dc);
    }
    let mut sizes = Vec::new();
    let mut left = width;
    while left > 0 {
        sizes.push(chunk_size(left));
        left -= chunk_size(left);
    }
    let mut models = Models::new(width, sizes.len());
    let mut context = Magnitudes::new(n, sizes.len());
    for (depth, level) in plan.levels().windows(2).enumerate() {
        context.start_level();
        let range = level[0] as usize - 1..level[1] as usize - 1;
        let places = plan.parents()[range.clone()].iter().zip(&plan.axes()[range.clone()]);
        for (k, (&parent, &axis)) in (range.start + 1..).zip(places) {
            if !C::ENCODING && coder.exhausted() {
                return;
            }
            let mut place = Place { level: depth * 3 + usize::from(axis), coded: 0 };
            let (mut first, mut signs) = (0, 0);
            for (chunk, &size) in sizes.iter().enumerate() {
                let here = context.at(k, parent, axis, chunk, first);
                let mut magnitude = Packed::default();
                let some = C::ENCODING && (first..first + size).any(|ch| levels.get(ch, k) != 0);
                let flag = models.any(coder, &here, place, (chunk, size), some);
                if flag == Some(false) {
                    // As many zeros shift all signs out.
                    signs = 0;
                } else {
                    for i in 0..size {
                        let ch = first + i;
                        let known = match flag {
                            Some(true) if !magnitude.is_zero() => Known::Nothing,
                            Some(true) if i + 1 == size => Known::NotZero,
                            Some(true) => Known::SomeNotZero,
                            _ => Known::Nothing,
                        };
                        let v = levels.get(ch, k);
                        let who = (i, ch);
                        let m = models.magnitude(coder, &here, place, who, known, v.unsigned_abs());
                        let mut t = 0;
                        if m != 0 {
                            let negative = models.sign(coder, ch, signs, v < 0);
                            let level = m as i32;
                            levels.set(ch, k, if negative { level.wrapping_neg() } else { level });
                            t = 1 + usize::from(negative);
                        }
                        signs = (signs * 3 + t) % 9;
                        magnitude.set(i, m);
                        place.coded = place.coded.saturating_add(m);
                    }
                }
                context.update(&here, magnitude);
                first += size;
            }
        }
    }
}
