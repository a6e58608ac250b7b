//! Entropy coding of quantised RAHT coefficients, a group of channels at a time.
//!
//! A group is one independent stream: channels that resemble each other (Y, U, V of one triple)
//! belong together, and groups can be coded on different cores. Inside a group the coder goes
//! coefficient by coefficient, coarse to fine, so that the magnitude of a coefficient is
//! predicted from its ancestors, from the two before it and from the channels already coded.

use crate::bytes::{Reader, put_varint};
use crate::context::Magnitudes;
use crate::error::{Error, Result};
use crate::mix::{Mixer, stretch};
use crate::model::Bit;
use crate::raht::Plan;
use crate::range::{BinaryCoder, RangeDecoder, RangeEncoder};
use crate::rdoq::{BUCKETS, bucket};
use crate::rlgr;

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
            let mut copy: Vec<Vec<i32>> = channels.iter().map(|c| c.to_vec()).collect();
            code_channels(plan, &mut copy, &mut coder);
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
            code_channels(plan, &mut out, &mut coder);
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

/// Unary decisions before the exponential-Golomb escape.
const UNARY: usize = 20;
/// Memory of the counters.
const LIMIT: u32 = 250;
/// Counters that are mixed for each decision.
const INPUTS: usize = 3;
/// Logarithmic classes of a magnitude in the finer contexts.
const CLASSES: usize = 6;

/// The three contexts of a coefficient.
#[derive(Clone, Copy)]
struct Place {
    expected: u32,
    tables: [usize; INPUTS],
    mixer: usize,
}

/// Counters of the unary decisions of one coefficient context.
type Unary = [Bit; UNARY];

/// All adaptive state of a group.
struct Models {
    /// By channel and expected magnitude.
    expected: Vec<Unary>,
    /// By ancestors, previous and other channels, each in classes.
    parts: Vec<Unary>,
    /// By octree level, axis and coarse expected magnitude.
    level: Vec<Unary>,
    mixers: Vec<Mixer<INPUTS>>,
    escape: [Bit; 32],
    sign: Vec<Bit>,
}

/// 0, 1, 2, 3-4, 5-8, above.
#[inline]
fn class(v: u32) -> usize {
    match v {
        0..=2 => v as usize,
        3..=4 => 3,
        5..=8 => 4,
        _ => 5,
    }
}

/// A counter that starts where magnitudes are geometric with the mean of `bucket`.
fn prior(bucket: usize) -> Unary {
    let m = 1u64 << (bucket.min(40) / 2 + 8);
    let mean = if bucket % 2 == 1 { m } else { m + m / 2 };
    let shift = if bucket >= 23 { (bucket - 19) / 2 } else { 0 };
    let mean = mean >> shift;
    let p1 = (mean * 65536 / (mean + (1 << 16))).clamp(300, 65000);
    [Bit::with_prior(p1 as u32, 3); UNARY]
}

impl Models {
    fn new(channels: usize) -> Self {
        let expected: Vec<Unary> = (0..channels * BUCKETS).map(|i| prior(i % BUCKETS)).collect();
        Self {
            expected,
            parts: vec![[Bit::default(); UNARY]; 16 * CLASSES * CLASSES * 4],
            level: (0..64 * BUCKETS).map(|i| prior(i % BUCKETS)).collect(),
            mixers: vec![Mixer::new(68_000); channels * UNARY],
            escape: [Bit::default(); 32],
            sign: vec![Bit::default(); channels * 9 * 4],
        }
    }

    #[inline]
    fn magnitude<C: BinaryCoder>(&mut self, coder: &mut C, place: &Place, v: u32) -> u32 {
        let m = place.expected;
        // Low bits whose distribution is flat at this scale go out unmodelled.
        let shift = if m >= 8 << 8 { (m >> 10).ilog2() } else { 0 };
        let high = v >> shift;
        let [a, b, c] = place.tables;
        let (a, b, c) = (&mut self.expected[a], &mut self.parts[b], &mut self.level[c]);
        let mut u = 0;
        while u < UNARY {
            let inputs = [stretch(a[u].p1()), stretch(b[u].p1()), stretch(c[u].p1())];
            let mixer = &mut self.mixers[place.mixer + u];
            let p1 = mixer.mix(&inputs);
            let bit = coder.code(p1, high > u as u32);
            mixer.update(&inputs, p1, bit, 2);
            a[u].update(bit, LIMIT);
            b[u].update(bit, LIMIT);
            c[u].update(bit, LIMIT);
            if !bit {
                break;
            }
            u += 1;
        }
        let mut u = u as u32;
        if u as usize == UNARY {
            let rest = code_exp_golomb(coder, &mut self.escape, high.saturating_sub(u));
            u = u.saturating_add(rest).min(u32::MAX >> shift);
        }
        if shift == 0 {
            return u;
        }
        let low = coder.code_raw_wide(v & ((1 << shift) - 1), shift);
        (u << shift) | low
    }
}

/// Exponential Golomb with modelled prefix.
fn code_exp_golomb<C: BinaryCoder>(coder: &mut C, model: &mut [Bit; 32], v: u32) -> u32 {
    let v1 = u64::from(v) + 1;
    let bits = v1.ilog2();
    let mut k = 0;
    while k < 31 && model[k as usize].code(coder, bits > k, LIMIT) {
        k += 1;
    }
    let low = coder.code_raw_wide((v1 & ((1 << k) - 1)) as u32, k);
    (((1u64 << k) | u64::from(low)) - 1) as u32
}

/// Codes or decodes all channels; the decoder gets zeros and fills them in.
fn code_channels<C: BinaryCoder>(plan: &Plan, channels: &mut [Vec<i32>], coder: &mut C) {
    let n = plan.len();
    let width = channels.len();
    if n == 0 || width == 0 {
        return;
    }
    for c in channels.iter_mut() {
        c[0] = coder.code_raw_wide(c[0] as u32, 32) as i32;
    }
    let mut models = Models::new(width);
    let mut context: Vec<Magnitudes> = (0..width).map(|_| Magnitudes::new(plan)).collect();
    for (depth, level) in plan.levels().windows(2).enumerate() {
        context.iter_mut().for_each(Magnitudes::start_level);
        for k in level[0] as usize..level[1] as usize {
            if !C::ENCODING && coder.exhausted() {
                return;
            }
            let (parent, axis) = (plan.parents()[k - 1] as usize, plan.axes()[k - 1]);
            let mut coded = 0u32;
            let mut signs = 0;
            for ch in 0..width {
                let m = context[ch].expected(parent, axis, coded, ch as u32);
                let (activity, [p1, p2]) = context[ch].parts(parent, axis);
                let parts = (bucket(activity) / 2).min(15) * CLASSES + class(p1.saturating_add(p2));
                let place = Place {
                    expected: m,
                    tables: [
                        ch * BUCKETS + bucket(m),
                        (parts * CLASSES + class(coded)) * 4 + ch.min(3),
                        (depth * 3 + usize::from(axis)) * BUCKETS + bucket(m),
                    ],
                    mixer: ch * UNARY,
                };
                let value = channels[ch][k];
                let magnitude = models.magnitude(coder, &place, value.unsigned_abs());
                let mut negative = false;
                if magnitude != 0 {
                    let ctx = (ch * 9 + signs) * 4;
                    negative = models.sign[ctx].code(coder, value < 0, 1023);
                }
                signs =
                    (signs * 3 + if magnitude == 0 { 0 } else { 1 + usize::from(negative) }) % 9;
                channels[ch][k] =
                    if negative { (magnitude as i32).wrapping_neg() } else { magnitude as i32 };
                context[ch].update(k, parent, axis, magnitude);
                coded = coded.saturating_add(magnitude);
            }
        }
    }
}
