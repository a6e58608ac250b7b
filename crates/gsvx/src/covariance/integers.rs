//! Covariances as integers over each channel's range, coded without further loss.
//!
//! The paper's "lossless" mode: three log-scales and four quaternion components, each an
//! integer of a stated width between the channel's minimum and maximum, predicted from coded
//! neighbours. Loss is that of the integers alone: half a step, `(max - min) / (2^bits - 1) / 2`.

use super::Covariances;
use crate::bytes::Reader;
#[cfg(feature = "encode")]
use crate::bytes::Writer;
use crate::error::{Error, Result, coding};
use gpcc_lite::Leaf;
#[cfg(feature = "encode")]
use gpcc_lite::predict::encode_lossless;
use gpcc_lite::predict::{Neighbours, decode_lossless};

const CHANNELS: usize = 7;
/// Widths an encoder may ask for.
const BITS: std::ops::RangeInclusive<u8> = 8..=24;

#[cfg(feature = "encode")]
pub(crate) fn encode(
    rotations: &[[f32; 4]],
    log_scales: &[[f32; 3]],
    leaves: &[Leaf],
    j_high: u8,
    bits: u8,
) -> Result<Vec<u8>> {
    if !BITS.contains(&bits) {
        return Err(Error::Option {
            option: "covariance bits",
            value: bits.into(),
            range: "between 8 and 24",
        });
    }
    let value = |k: usize, i: usize| {
        if k < 3 { log_scales[i][k] } else { rotations[i][k - 3] }
    };
    let mut out = Writer::default();
    out.u8(bits);
    let top = ((1u32 << bits) - 1) as f64;
    let mut channels = Vec::with_capacity(CHANNELS);
    for k in 0..CHANNELS {
        let (mut min, mut max) = (f32::INFINITY, f32::NEG_INFINITY);
        for i in 0..leaves.len() {
            min = min.min(value(k, i));
            max = max.max(value(k, i));
        }
        if leaves.is_empty() {
            (min, max) = (0.0, 0.0);
        }
        out.f32(min);
        out.f32(max);
        let range = f64::from(max) - f64::from(min);
        let scale = if range > 0.0 { top / range } else { 0.0 };
        channels.push(
            (0..leaves.len())
                .map(|i| libm::round((f64::from(value(k, i)) - f64::from(min)) * scale) as i32)
                .collect::<Vec<i32>>(),
        );
    }
    let near = Neighbours::new(leaves, j_high).map_err(coding("covariance"))?;
    let views: Vec<&[i32]> = channels.iter().map(Vec::as_slice).collect();
    out.bytes.extend(encode_lossless(&near, &views).map_err(coding("covariance"))?);
    Ok(out.bytes)
}

pub(crate) fn decode(payload: &[u8], leaves: &[Leaf], j_high: u8) -> Result<Covariances> {
    let mut r = Reader::new(payload, "covariance");
    let bits = r.u8()?;
    if !BITS.contains(&bits) {
        return Err(Error::Corrupt { what: "covariance bits", value: bits.into() });
    }
    let top = ((1u32 << bits) - 1) as f64;
    let mut ranges = [[0.0; 2]; CHANNELS];
    for range in &mut ranges {
        *range = [
            f64::from(r.finite_f32("covariance minimum")?),
            f64::from(r.finite_f32("covariance maximum")?),
        ];
    }
    let near = Neighbours::new(leaves, j_high).map_err(coding("covariance"))?;
    let rest = r.take(r.remaining())?;
    let channels = decode_lossless(&near, rest, CHANNELS).map_err(coding("covariance"))?;
    if channels.len() != CHANNELS {
        return Err(Error::Corrupt { what: "covariance channels", value: channels.len() as u64 });
    }
    // Beyond its range an integer stands for anything, up to infinite scales.
    let fits = |&v: &i32| (0..1 << bits).contains(&v);
    if let Some(&v) = channels.iter().flatten().find(|v| !fits(v)) {
        return Err(Error::Corrupt { what: "covariance integer", value: i64::from(v) as u64 });
    }
    let value = |k: usize, i: usize| {
        let [min, max] = ranges[k];
        (min + f64::from(channels[k][i]) * ((max - min) / top)) as f32
    };
    (0..leaves.len())
        .map(|i| {
            let q: [f32; 4] = std::array::from_fn(|k| value(k + 3, i));
            // Rounding may hit the zero quaternion, which means no rotation at all.
            let q = if q == [0.0; 4] { [1.0, 0.0, 0.0, 0.0] } else { q };
            // Hostile ranges make quaternions too long or too short to have a direction.
            let norm2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
            if !norm2.is_normal() {
                return Err(Error::Corrupt { what: "rotation of Gaussian", value: i as u64 });
            }
            Ok((q, std::array::from_fn(|k| value(k, i))))
        })
        .collect()
}
