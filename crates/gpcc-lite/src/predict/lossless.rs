//! Lossless coding of integer channels: neighbour prediction and an adaptive residual coder.

use super::neighbours::Neighbours;
use crate::bytes::{BitReader, BitWriter, Reader, put_varint};
use crate::error::{Error, Result};
use crate::mix::{Mixer, stretch};
use crate::model::Bit;
use crate::range::{BinaryCoder, RangeDecoder, RangeEncoder};

const RAW: u8 = 0;
const PREDICTED: u8 = 1;

/// Codes `channels` (leaf order) losslessly; each channel is an independent stream.
///
/// A channel never exceeds its raw size (the bits its own range needs) plus 12 bytes.
///
/// # Errors
/// If a channel's length is not the number of points.
pub fn encode_lossless(near: &Neighbours, channels: &[&[i32]]) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    put_varint(&mut out, channels.len() as u64);
    for (channel, values) in channels.iter().enumerate() {
        if values.len() != near.len() {
            return Err(Error::ChannelLength { channel, got: values.len(), want: near.len() });
        }
        let min = values.iter().copied().min().unwrap_or(0);
        let max = values.iter().copied().max().unwrap_or(0);
        let width = 32 - max.wrapping_sub(min).cast_unsigned().leading_zeros();
        out.extend(min.to_le_bytes());
        out.push(width as u8);
        let mut coder = RangeEncoder::new();
        let mut copy = values.to_vec();
        code_channel(near, &mut copy, bounds(min, width), &mut coder);
        let coded = coder.finish();
        if coded.len() as u64 * 8 <= u64::from(width) * values.len() as u64 {
            out.push(PREDICTED);
            put_varint(&mut out, coded.len() as u64);
            out.extend(coded);
        } else {
            out.push(RAW);
            let mut w = BitWriter::default();
            for v in *values {
                w.put(v.wrapping_sub(min).cast_unsigned(), width);
            }
            let raw = w.finish();
            put_varint(&mut out, raw.len() as u64);
            out.extend(raw);
        }
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
    let mut r = Reader::new(bytes);
    let channels = r.varint("channel count")?;
    if channels > max_channels as u64 {
        return Err(r.corrupt("channel count"));
    }
    let mut out = Vec::new();
    for _ in 0..channels {
        let b = r.bytes(4, "channel minimum")?;
        let min = i32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        let width = u32::from(r.u8("channel width")?);
        if width > 32 {
            return Err(r.corrupt("channel width"));
        }
        let tag = r.u8("channel mode")?;
        let len = r.varint("channel length")?;
        let data = r.bytes(len, "channel")?;
        let mut values = vec![0i32; near.len()];
        match tag {
            RAW => {
                let mut b = BitReader::new(data);
                for v in &mut values {
                    *v = min.wrapping_add_unsigned(b.get(width));
                }
                if b.overrun() {
                    return Err(Error::Truncated { offset: r.pos(), what: "raw channel" });
                }
            }
            PREDICTED => {
                let mut coder = RangeDecoder::new(data);
                code_channel(near, &mut values, bounds(min, width), &mut coder);
                if coder.exhausted() {
                    return Err(Error::Truncated { offset: r.pos(), what: "channel" });
                }
            }
            _ => return Err(r.corrupt("channel mode")),
        }
        out.push(values);
    }
    Ok(out)
}

const BUCKETS: usize = 40;
const LIMIT: u32 = 255;

/// Two models of the class of a residual and a mixer for them.
struct Residual {
    class: [Vec<[Bit; 64]>; 2],
    mixers: Vec<Mixer<2>>,
    mantissa: Vec<[Bit; 8]>,
    sign: [Bit; 3],
}

impl Residual {
    fn new() -> Self {
        let table = || vec![[Bit::default(); 64]; BUCKETS];
        Self {
            class: [table(), table()],
            mixers: vec![Mixer::new(72_000); 64],
            mantissa: vec![[Bit::default(); 8]; 34],
            sign: [Bit::default(); 3],
        }
    }

    /// Codes `v` given two bucketed expectations of its magnitude.
    fn code<C: BinaryCoder>(&mut self, coder: &mut C, v: i64, ctx: [usize; 2]) -> i64 {
        let magnitude = v.unsigned_abs();
        let class = 64 - magnitude.leading_zeros();
        let mut node = 1usize;
        for level in (0..6).rev() {
            let [a, b] = &mut self.class;
            let (a, b) = (&mut a[ctx[0]][node], &mut b[ctx[1]][node]);
            let inputs = [stretch(a.p1()), stretch(b.p1())];
            let mixer = &mut self.mixers[node];
            let p1 = mixer.mix(&inputs);
            let bit = coder.code(p1, class >> level & 1 == 1);
            mixer.update(&inputs, p1, bit, 3);
            a.update(bit, LIMIT);
            b.update(bit, LIMIT);
            node = node * 2 + usize::from(bit);
        }
        let class = (node as u32 - 64).min(33);
        if class == 0 {
            return 0;
        }
        let mut magnitude = 1u64 << (class - 1) | (magnitude & ((1 << (class - 1)) - 1));
        let rest = class - 1;
        let modelled = rest.min(3);
        let mut prefix = 1usize;
        for i in 0..modelled {
            let at = rest - 1 - i;
            let bit =
                self.mantissa[class as usize][prefix].code(coder, magnitude >> at & 1 == 1, LIMIT);
            prefix = prefix * 2 + usize::from(bit);
        }
        let raw = rest - modelled;
        let low = coder.code_raw_wide((magnitude & ((1 << raw) - 1)) as u32, raw);
        magnitude = ((prefix as u64) << raw) | u64::from(low);
        let sign = &mut self.sign[0];
        let negative = sign.code(coder, v < 0, 1023);
        if negative { -(magnitude as i64) } else { magnitude as i64 }
    }
}

fn bucket(m: u64) -> usize {
    if m == 0 {
        return 0;
    }
    let log = m.ilog2();
    let half = if log == 0 { 0 } else { (m >> (log - 1)) & 1 };
    ((2 * log) as usize + half as usize + 1).min(BUCKETS - 1)
}

/// Least and greatest value of a channel whose offsets from `min` have `width` bits. Both sides
/// must derive them from the header: the first prediction is their middle.
fn bounds(min: i32, width: u32) -> (i64, i64) {
    (i64::from(min), (i64::from(min) + (1i64 << width) - 1).min(i64::from(i32::MAX)))
}

fn code_channel<C: BinaryCoder>(
    near: &Neighbours,
    values: &mut [i32],
    (lo, hi): (i64, i64),
    coder: &mut C,
) {
    let mut model = Residual::new();
    let mut error = vec![0u32; values.len()];
    for at in 0..near.len() {
        if !C::ENCODING && coder.exhausted() {
            return;
        }
        let i = near.order()[at] as usize;
        let (index, distance) = near.of(at);
        let (mut sum, mut total) = (0i64, 0i64);
        for (&j, &d) in index.iter().zip(distance) {
            let w = (1i64 << 20) / (i64::from(d) + 8);
            let w = w.max(1);
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
        let ctx = [bucket(8 * spread / n), bucket(8 * errors / n)];
        let residual = model.code(coder, i64::from(values[i]) - prediction, ctx);
        values[i] = (prediction + residual).clamp(lo, hi) as i32;
        error[i] = residual.unsigned_abs().min(u64::from(u32::MAX)) as u32;
    }
}
