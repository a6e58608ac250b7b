//! Lossy attributes in one call: RAHT, quantisation, entropy coding.
//!
//! One call codes one group of channels that belong together (say Y, U, V of a colour); groups
//! are independent, so they can be coded on different cores.

use crate::bytes::{Reader, put_varint};
use crate::coeffs::{self, Mode};
use crate::error::{Error, Result};
use crate::quant::{Centroids, Step, VALUE_BITS};
use crate::raht::Plan;

/// What the encoder may choose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Entropy coder.
    pub mode: Mode,
    /// Rounding offset of the quantiser in 1/256 of a step: 128 rounds to nearest, less widens
    /// the dead zone.
    pub rounding: u8,
}

impl Default for Options {
    fn default() -> Self {
        Self { mode: Mode::Range, rounding: 96 }
    }
}

/// A coded group of channels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Encoded {
    /// The stream.
    pub bytes: Vec<u8>,
    /// What [`decode`] returns for it.
    pub reconstruction: Vec<Vec<i32>>,
}

/// Codes `channels` (leaf order, one value per point) with a quantiser step each.
///
/// # Errors
/// If a channel's length is not the number of points, or the steps are not one per channel.
pub fn encode(plan: &Plan, channels: &[&[i32]], steps: &[Step], o: &Options) -> Result<Encoded> {
    if steps.len() != channels.len() {
        return Err(Error::Count { what: "steps", got: steps.len(), want: channels.len() });
    }
    let mut bytes = Vec::new();
    put_varint(&mut bytes, channels.len() as u64);
    let mut quantised = Vec::with_capacity(channels.len());
    let mut reconstruction = Vec::with_capacity(channels.len());
    for (channel, (values, &step)) in channels.iter().zip(steps).enumerate() {
        if values.len() != plan.len() {
            return Err(Error::ChannelLength { channel, got: values.len(), want: plan.len() });
        }
        let mut c: Vec<i64> = values.iter().map(|&v| i64::from(v) << VALUE_BITS).collect();
        plan.forward_fixed(&mut c)?;
        let q = step.quantise(&c, o.rounding);
        let centroids = Centroids::measure(&c, &q, step);
        put_varint(&mut bytes, step.0);
        bytes.extend(centroids.to_bytes());
        reconstruction.push(reconstruct(plan, &q, step, centroids)?);
        quantised.push(q);
    }
    let refs: Vec<&[i32]> = quantised.iter().map(Vec::as_slice).collect();
    bytes.extend(coeffs::encode(plan, &refs, o.mode)?);
    Ok(Encoded { bytes, reconstruction })
}

/// Decodes what [`encode`] wrote; `max_channels` bounds the memory.
///
/// # Errors
/// If the stream is truncated, corrupt or has more channels than allowed.
pub fn decode(plan: &Plan, bytes: &[u8], max_channels: usize) -> Result<Vec<Vec<i32>>> {
    let mut r = Reader::new(bytes);
    let channels = r.varint("channel count")?;
    if channels > max_channels as u64 {
        return Err(r.corrupt("channel count"));
    }
    let mut heads = Vec::new();
    for _ in 0..channels {
        let step = Step(r.varint("step")?);
        let shift = r.bytes(3, "centroid shifts")?;
        heads.push((step, Centroids::from_bytes([shift[0], shift[1], shift[2]])));
    }
    let quantised = coeffs::decode(plan, &bytes[r.pos()..], heads.len())?;
    quantised.iter().zip(heads).map(|(q, (step, c))| reconstruct(plan, q, step, c)).collect()
}

fn reconstruct(plan: &Plan, q: &[i32], step: Step, centroids: Centroids) -> Result<Vec<i32>> {
    let mut c = step.dequantise(q, centroids);
    plan.inverse_fixed(&mut c)?;
    let half = 1i64 << (VALUE_BITS - 1);
    let clamp = |v: i64| v.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32;
    Ok(c.iter().map(|&v| clamp(v.saturating_add(half) >> VALUE_BITS)).collect())
}
