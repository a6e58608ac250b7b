//! Lossless coding of integer channels: prediction from neighbours, and an adaptive coder of
//! residuals.
//!
//! The encoder tries each mode of a channel and keeps the smallest: prediction, a histogram of the
//! values, or plain bits.

use super::neighbours::Neighbours;
use super::palette;
use super::residual::Residual;
use crate::bytes::{BitReader, BitWriter, ByteReader, put_varint};
use crate::coder::{Coder, RansDecoder, RansEncoder};
use crate::error::{Error, Result};
use crate::model::Bit;

/// Modes of a channel.
const RAW: u8 = 0;
const PREDICTED: u8 = 1;
const HISTOGRAM: u8 = 2;
/// Added to a mode whose values are indices into a palette.
const PALETTE: u8 = 4;
/// Widest channel whose histogram is worth learning.
const HISTOGRAM_BITS: u32 = 12;

/// Codes `channels` (leaf order) losslessly; each channel is an independent stream.
///
/// A channel never exceeds its raw size (the bits its own range needs) plus 16 bytes.
///
/// # Errors
/// If a channel's length is not the number of points.
pub fn encode_lossless(near: &Neighbours, channels: &[&[i32]]) -> Result<Vec<u8>> {
    for (channel, values) in channels.iter().enumerate() {
        if values.len() != near.len() {
            return Err(Error::ChannelLength { channel, got: values.len(), want: near.len() });
        }
    }
    let streams: Vec<Vec<u8>> = channels.iter().map(|v| encode_channel(near, v)).collect();
    let mut out = Vec::new();
    put_varint(&mut out, channels.len() as u64);
    for s in streams {
        put_varint(&mut out, s.len() as u64);
        out.extend(s);
    }
    Ok(out)
}

/// Decodes what [`encode_lossless`] wrote; `max_channels` bounds the memory.
///
/// # Errors
/// If the stream is truncated, corrupt or has more channels than allowed.
pub fn decode_lossless(
    near: &Neighbours,
    bytes: &[u8],
    max_channels: usize,
) -> Result<Vec<Vec<i32>>> {
    let mut r = ByteReader::new(bytes);
    let channels = r.channels(max_channels)?;
    let mut streams = Vec::new();
    for _ in 0..channels {
        let len = r.varint("channel length")?;
        streams.push(r.bytes(len, "channel")?);
    }
    streams.iter().map(|s| decode_channel(near, s)).collect()
}

fn encode_channel(near: &Neighbours, values: &[i32]) -> Vec<u8> {
    let plain = encode_values(near, values, 0);
    if let Some(p) = palette::find(values) {
        let mut out = Vec::new();
        palette::write(&mut out, &p);
        let body = encode_values(near, &palette::indices(values, &p), PALETTE);
        // The mode byte comes first, the palette after it.
        out.splice(0..0, body[..1].iter().copied());
        out.extend(&body[1..]);
        if out.len() < plain.len() {
            return out;
        }
    }
    plain
}

/// The stream of a channel: its mode (plus `flag`), minimum and width, then its values in the
/// smallest mode.
fn encode_values(near: &Neighbours, values: &[i32], flag: u8) -> Vec<u8> {
    let min = values.iter().copied().min().unwrap_or(0);
    let max = values.iter().copied().max().unwrap_or(0);
    let width = 32 - max.wrapping_sub(min).cast_unsigned().leading_zeros();
    let mut values = values.to_vec();
    let mut predicted = RansEncoder::default();
    code_predicted(near, &mut values, bounds(min, width), &mut predicted);
    let histogram = (width <= HISTOGRAM_BITS).then(|| {
        let mut coder = RansEncoder::default();
        code_histogram(&mut values, min, width, &mut coder);
        (HISTOGRAM, coder.finish())
    });
    let mut raw = BitWriter::default();
    for v in &values {
        raw.put(v.wrapping_sub(min).cast_unsigned(), width);
    }
    let bodies = [Some((PREDICTED, predicted.finish())), histogram, Some((RAW, raw.finish()))];
    let smallest = bodies.into_iter().flatten().min_by_key(|(_, body)| body.len());
    let (mode, body) = smallest.unwrap_or_default();
    let mut out = vec![mode | flag];
    out.extend(min.to_le_bytes());
    out.push(width as u8);
    out.extend(body);
    out
}

fn decode_channel(near: &Neighbours, bytes: &[u8]) -> Result<Vec<i32>> {
    let mut r = ByteReader::new(bytes);
    let tag = r.u8("channel mode")?;
    let palette = if tag & PALETTE != 0 { Some(palette::read(&mut r)?) } else { None };
    let b = r.bytes(4, "channel minimum")?;
    let min = i32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let width = u32::from(r.u8("channel width")?);
    if width > 32 {
        return Err(r.corrupt("channel width"));
    }
    let data = &bytes[r.pos()..];
    let truncated = Error::Truncated { offset: bytes.len(), what: "channel" };
    let mut values = vec![0i32; near.len()];
    match tag & !PALETTE {
        RAW => {
            let mut b = BitReader::new(data);
            for v in &mut values {
                *v = min.wrapping_add_unsigned(b.get(width));
            }
            if b.overrun() {
                return Err(truncated);
            }
        }
        PREDICTED => {
            let mut coder = RansDecoder::new(data)?;
            code_predicted(near, &mut values, bounds(min, width), &mut coder);
            coder.finish()?;
        }
        HISTOGRAM if width <= HISTOGRAM_BITS => {
            let mut coder = RansDecoder::new(data)?;
            code_histogram(&mut values, min, width, &mut coder);
            coder.finish()?;
        }
        _ => return Err(r.corrupt("channel mode")),
    }
    if let Some(p) = palette {
        values.iter_mut().for_each(|v| *v = palette::value(&p, *v));
    }
    Ok(values)
}

/// Least and greatest value of a channel whose offsets from `min` have `width` bits. Encoder and
/// decoder derive them from the header, because the first prediction is their middle.
fn bounds(min: i32, width: u32) -> [i64; 2] {
    [i64::from(min), (i64::from(min) + (1i64 << width) - 1).min(i64::from(i32::MAX))]
}

/// Coding without prediction: a binary tree of models over the offsets from `min`.
fn code_histogram<C: Coder>(values: &mut [i32], min: i32, width: u32, coder: &mut C) {
    let mut tree = vec![Bit::default(); 1 << width];
    for v in values {
        let offset = v.wrapping_sub(min).cast_unsigned();
        let mut node = 1usize;
        for level in (0..width).rev() {
            let bit = tree[node].code(coder, offset >> level & 1 == 1, 1023);
            node = node * 2 + usize::from(bit);
        }
        *v = min.wrapping_add_unsigned((node - (1 << width)) as u32);
    }
}

/// Inverse-distance prediction and residual coding in coding order.
fn code_predicted<C: Coder>(
    near: &Neighbours,
    values: &mut [i32],
    [lo, hi]: [i64; 2],
    coder: &mut C,
) {
    let mut model = Residual::new();
    let mut error = vec![0u32; values.len()];
    for at in 0..near.len() {
        let i = near.order()[at] as usize;
        let (index, distance) = near.of(at);
        let (mut sum, mut total) = (0i64, 0i64);
        for (&j, &d) in index.iter().zip(distance) {
            let w = ((1i64 << 20) / (i64::from(d) + 8)).max(1);
            sum += w * i64::from(values[j as usize]);
            total += w;
        }
        let prediction = if total == 0 { (lo + hi) / 2 } else { sum.div_euclid(total) };
        let (mut spread, mut errors) = (0u64, 0u64);
        for &j in index {
            spread += i64::from(values[j as usize]).abs_diff(prediction);
            errors += u64::from(error[j as usize]);
        }
        let n = index.len().max(1) as u64;
        let residual = i64::from(values[i]) - prediction;
        let residual = model.code(coder, residual, [8 * spread / n, 8 * errors / n]);
        values[i] = (prediction + residual).clamp(lo, hi) as i32;
        error[i] = residual.unsigned_abs().min(u64::from(u32::MAX)) as u32;
    }
}
