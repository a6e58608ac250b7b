//! Entropy coding of quantised RAHT coefficients, a group of channels at a time.
//!
//! A group is one independent stream: channels that resemble each other (Y, U, V of one triple)
//! belong together, and groups can be coded on different cores. Inside a group the coder goes
//! coefficient by coefficient, coarse to fine, so that the magnitude of a coefficient is
//! predicted from its ancestors, from the two before it and from the channels already coded.

pub(crate) mod lone;
mod models;

use crate::bytes::{Reader, put_varint};
use crate::context::{CHUNK, Magnitudes, Packed, Row, chunk_sizes};
use crate::error::{Error, Result};
use crate::raht::Plan;
use crate::range::BinaryCoder;
use crate::rlgr;
use crate::symbol_coder::{SymbolCoder, SymbolDecoder, SymbolEncoder};
use models::{Known, Models, Place};
use std::borrow::Cow;

/// Entropy coder of a stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Adaptive binary range coder with magnitude contexts: the small mode.
    #[default]
    Range,
    /// The same with one adaptive symbol per magnitude: in half the time, streams a few tenths of a
    /// percent larger.
    Symbols,
    /// RLGR with [`rlgr::Params::REMOTE_FX`] or [`rlgr::Params::STEADY`], whichever is smaller on
    /// the finest coefficients, channel after channel: the fast mode.
    Rlgr,
    /// RLGR with [`rlgr::Params::MALVAR`].
    RlgrMalvar,
}

/// Levels of the channels of a chunk; those that are not there are 0.
pub(crate) type Levels = [i32; CHUNK];

pub(crate) const RAW: u8 = 0;
pub(crate) const RANGE: u8 = 1;
const RLGR_RFX: u8 = 2;
const RLGR_MALVAR: u8 = 3;
pub(crate) const SYMBOLS: u8 = 4;
const RLGR_STEADY: u8 = 5;
/// One channel, coded while its means are rebuilt: only [`crate::attribute`] has them.
pub(crate) const LONE: u8 = 6;
/// The period with which no channels share models.
const OWN: u8 = u8::MAX;
/// Coefficients of a channel on which parameters of RLGR are tried.
const TRIED: usize = 1 << 14;

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
        Mode::Range | Mode::Symbols => {
            let mut coder = SymbolEncoder::default();
            let get = |k: usize, levels: &mut [Levels]| {
                for ((chunk, i), channel) in places(channels.len()).zip(channels) {
                    levels[chunk][i] = channel[k];
                }
            };
            if mode == Mode::Range {
                code_channels::<false, _>(plan, (channels.len(), OWN), &mut coder, get, |_, _| {});
            } else {
                code_channels::<true, _>(plan, (channels.len(), OWN), &mut coder, get, |_, _| {});
            }
            finish(coder, mode, OWN, &mut out);
        }
        Mode::Rlgr | Mode::RlgrMalvar => {
            let levels = |c: usize| Cow::Borrowed(channels[c]);
            return Ok(encode_by_rlgr(plan.len(), channels.len(), mode, levels));
        }
    }
    if out.len() > 1 + 4 * plan.len() * channels.len() {
        return Ok(raw(channels.len(), |c| Cow::Borrowed(channels[c])));
    }
    Ok(out)
}

/// Puts the tag and what was coded behind `out`.
pub(crate) fn finish(coder: SymbolEncoder, mode: Mode, period: u8, out: &mut Vec<u8>) {
    if mode == Mode::Symbols {
        out.extend([SYMBOLS, period.max(1)]);
        coder.finish_both(out);
    } else {
        out.push(RANGE);
        out.extend(coder.finish());
    }
}

/// The decoder of what [`finish`] wrote behind the tag, and the period of the models.
pub(crate) fn open(by_symbols: bool, bytes: &[u8]) -> Result<(SymbolDecoder<'_>, u8)> {
    if !by_symbols {
        return Ok((SymbolDecoder::coded(bytes), OWN));
    }
    let mut r = Reader::new(bytes);
    match r.u8("period of models")? {
        0 => Err(r.corrupt("period of models")),
        period => Ok((SymbolDecoder::both(&bytes[1..])?, period)),
    }
}

/// [`encode`] by RLGR, of channels that `levels` gives one at a time.
pub(crate) fn encode_by_rlgr<'a>(
    n: usize,
    channels: usize,
    mode: Mode,
    levels: impl Fn(usize) -> Cow<'a, [i32]>,
) -> Vec<u8> {
    let tag = rlgr_tag(channels, mode, &levels);
    let params = rlgr_params(tag);
    let mut out = vec![tag];
    for c in 0..channels {
        let bytes = rlgr::encode(&levels(c), &params);
        put_varint(&mut out, bytes.len() as u64);
        out.extend(bytes);
    }
    if out.len() > 1 + 4 * n * channels { raw(channels, levels) } else { out }
}

/// Levels as they are.
fn raw<'a>(channels: usize, levels: impl Fn(usize) -> Cow<'a, [i32]>) -> Vec<u8> {
    let mut out = vec![RAW];
    for c in 0..channels {
        out.extend(levels(c).iter().flat_map(|v| v.to_le_bytes()));
    }
    out
}

/// The parameters to use, as a tag.
fn rlgr_tag<'a>(channels: usize, mode: Mode, levels: impl Fn(usize) -> Cow<'a, [i32]>) -> u8 {
    if mode == Mode::RlgrMalvar {
        return RLGR_MALVAR;
    }
    let size = |tag: u8| -> usize {
        let params = rlgr_params(tag);
        let finest = |c: &[i32]| rlgr::encode(&c[c.len().saturating_sub(TRIED)..], &params).len();
        (0..channels).map(|c| finest(&levels(c))).sum()
    };
    if size(RLGR_STEADY) < size(RLGR_RFX) { RLGR_STEADY } else { RLGR_RFX }
}

fn rlgr_params(tag: u8) -> rlgr::Params {
    match tag {
        RLGR_MALVAR => rlgr::Params::MALVAR,
        RLGR_STEADY => rlgr::Params::STEADY,
        _ => rlgr::Params::REMOTE_FX,
    }
}

/// Decodes a group of `channels` channels.
///
/// Memory is that of the result, as much again for contexts and 12 bytes per coefficient, whatever
/// the stream says.
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
        tag @ (RANGE | SYMBOLS) => {
            let (mut coder, period) = open(tag == SYMBOLS, &bytes[1..])?;
            let mut out = vec![vec![0; n]; channels];
            let put = |k: usize, levels: &[Levels]| {
                for ((chunk, i), channel) in places(channels).zip(&mut out) {
                    channel[k] = levels[chunk][i];
                }
            };
            if tag == RANGE {
                code_channels::<false, _>(plan, (channels, period), &mut coder, |_, _| {}, put);
            } else {
                code_channels::<true, _>(plan, (channels, period), &mut coder, |_, _| {}, put);
            }
            if coder.exhausted() {
                return Err(Error::Truncated { offset: bytes.len(), what: "coefficients" });
            }
            Ok(out)
        }
        tag @ (RLGR_RFX | RLGR_MALVAR | RLGR_STEADY) => {
            let params = rlgr_params(tag);
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

/// Codes or decodes the coefficients of a group one after another, magnitudes by symbols or in
/// binary.
pub(crate) struct RowCoder<const BY_SYMBOLS: bool> {
    sizes: Vec<usize>,
    models: Models,
    context: Magnitudes,
    magnitudes: Vec<Packed>,
    depth: usize,
}

impl<const BY_SYMBOLS: bool> RowCoder<BY_SYMBOLS> {
    /// `period` as in [`crate::attribute::Options::period`].
    pub(crate) fn new(coefficients: usize, channels: usize, period: u8) -> Self {
        let sizes = chunk_sizes(channels);
        Self {
            models: Models::new(channels, sizes.len(), BY_SYMBOLS.then_some(period)),
            context: Magnitudes::new(coefficients, sizes.len()),
            magnitudes: vec![Packed::default(); sizes.len()],
            sizes,
            depth: 0,
        }
    }

    /// A new octree level begins.
    pub(crate) fn start_level(&mut self, depth: usize) {
        self.context.start_level();
        self.depth = depth;
    }

    /// What magnitudes are expected, until the next call of [`RowCoder::code`] or
    /// [`RowCoder::learn`].
    pub(crate) fn context(&self) -> &Magnitudes {
        &self.context
    }

    /// Learns the levels of coefficient `k` without coding them.
    pub(crate) fn learn(&mut self, k: usize, row: &Row, levels: &[Levels]) {
        let mut any = false;
        for (magnitude, levels) in self.magnitudes.iter_mut().zip(levels) {
            *magnitude = Packed::default();
            for (i, level) in levels.iter().enumerate() {
                magnitude.set(i, level.unsigned_abs());
            }
            any |= !magnitude.is_zero();
        }
        if any {
            self.context.learn(k, row, &self.magnitudes);
        } else {
            self.context.learn_zeros(k, row);
        }
    }

    /// Codes the levels of coefficient `k >= 1`, one entry per chunk; false if all are zero, and
    /// then a decoder does not touch them.
    #[inline]
    pub(crate) fn code<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        k: usize,
        (parent, axis): (u32, u8),
        levels: &mut [Levels],
    ) -> bool {
        let row = self.context.at(parent, axis);
        let mut place = Place { level: self.depth * 3 + usize::from(axis), coded: 0 };
        let mut pending = false;
        if self.sizes.len() > 1 {
            let some = C::ENCODING && levels.iter().any(|l| *l != [0; CHUNK]);
            match self.models.row::<BY_SYMBOLS, C>(coder, &row, place.level, some) {
                Some(false) => {
                    self.context.learn_zeros(k, &row);
                    return false;
                }
                Some(true) => pending = true,
                None => {}
            }
        }
        let (mut first, mut signs) = (0, 0);
        let mut any = false;
        for (chunk, &size) in self.sizes.iter().enumerate() {
            let here = self.context.chunk(&row, chunk, first);
            let levels = &mut levels[chunk];
            let mut magnitude = Packed::default();
            let some = C::ENCODING && *levels != [0; CHUNK];
            let flag = if pending && chunk + 1 == self.sizes.len() {
                Some(true)
            } else {
                let which = (chunk, size);
                self.models.any::<BY_SYMBOLS, C>(coder, &here, place, which, pending, some)
            };
            let truth = *levels;
            *levels = [0; CHUNK];
            if flag == Some(false) {
                // As many zeros shift all signs out.
                signs = 0;
            } else if BY_SYMBOLS {
                let bases = here.bases();
                let mut known = if flag.is_some() { Known::SomeNotZero } else { Known::Nothing };
                for i in 0..size {
                    if known == Known::SomeNotZero && i + 1 == size {
                        known = Known::NotZero;
                    }
                    let of = (bases[i], place.coded);
                    let level = self.models.level(coder, of, first + i, known, truth[i]);
                    let m = level.unsigned_abs();
                    known = if m > 0 { Known::Nothing } else { known };
                    levels[i] = level;
                    magnitude.set(i, m);
                    place.coded = place.coded.saturating_add(m);
                }
            } else {
                for i in 0..size {
                    let ch = first + i;
                    let known = match flag {
                        Some(true) if !magnitude.is_zero() => Known::Nothing,
                        Some(true) if i + 1 == size => Known::NotZero,
                        Some(true) => Known::SomeNotZero,
                        _ => Known::Nothing,
                    };
                    let v = truth[i];
                    let m = self.models.magnitude(
                        coder,
                        &here,
                        place,
                        (i, ch),
                        known,
                        v.unsigned_abs(),
                    );
                    let mut t = 0;
                    if m != 0 {
                        let negative = self.models.sign(coder, ch, signs, v < 0);
                        let level = m as i32;
                        levels[i] = if negative { level.wrapping_neg() } else { level };
                        t = 1 + usize::from(negative);
                    }
                    signs = (signs * 3 + t) % 9;
                    magnitude.set(i, m);
                    place.coded = place.coded.saturating_add(m);
                }
            }
            if !magnitude.is_zero() {
                any = true;
                pending = false;
            }
            self.magnitudes[chunk] = magnitude;
            first += size;
        }
        if any {
            self.context.learn(k, &row, &self.magnitudes);
        } else {
            self.context.learn_zeros(k, &row);
        }
        any
    }
}

/// Where each channel is: its chunk and its place there.
pub(crate) fn places(channels: usize) -> impl Iterator<Item = (usize, usize)> {
    let sizes = chunk_sizes(channels);
    sizes.into_iter().enumerate().flat_map(|(chunk, size)| (0..size).map(move |i| (chunk, i)))
}

/// Codes or decodes whole channels: `channels(k, levels, out)` gives the levels of coefficient `k`
/// or takes them.
fn code_channels<const BY_SYMBOLS: bool, C: SymbolCoder>(
    plan: &Plan,
    (channels, period): (usize, u8),
    coder: &mut C,
    mut get: impl FnMut(usize, &mut [Levels]),
    mut put: impl FnMut(usize, &[Levels]),
) {
    let n = plan.len();
    if n == 0 || channels == 0 {
        return;
    }
    let mut rows = RowCoder::<BY_SYMBOLS>::new(n, channels, period);
    let mut levels = vec![[0; CHUNK]; rows.sizes.len()];
    get(0, &mut levels);
    code_dc(coder, channels, &mut levels);
    put(0, &levels);
    for (depth, level) in plan.levels().windows(2).enumerate() {
        rows.start_level(depth);
        let range = level[0] as usize - 1..level[1] as usize - 1;
        let places = plan.parents()[range.clone()].iter().zip(&plan.axes()[range.clone()]);
        for (k, (&parent, &axis)) in (range.start + 1..).zip(places) {
            if !C::ENCODING && coder.exhausted() {
                return;
            }
            get(k, &mut levels);
            if rows.code(coder, k, (parent, axis), &mut levels) {
                put(k, &levels);
            }
        }
    }
}

/// Codes or decodes the levels of coefficient 0.
pub(crate) fn code_dc<C: BinaryCoder>(coder: &mut C, channels: usize, levels: &mut [Levels]) {
    for (chunk, i) in places(channels) {
        levels[chunk][i] = coder.code_raw_wide(levels[chunk][i] as u32, 32) as i32;
    }
}
