//! Lossy attributes in one call: RAHT, prediction, quantisation, entropy coding.
//!
//! One call codes one group of channels that belong together (say Y, U, V of a colour); groups
//! are independent, so they can be coded on different cores.

use std::borrow::Cow;

use crate::bytes::{Reader, put_varint};
use crate::coeffs::{self, Mode};
use crate::context::{Magnitudes, Packed, chunk_size};
use crate::error::{Error, Result};
use crate::quant::{CentroidSums, Centroids, Step, VALUE_BITS};
use crate::raht::{self, Forward, Plan, Residual};
use crate::rdoq::Thresholds;

/// What the encoder may choose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Entropy coder.
    pub mode: Mode,
    /// Lagrangian multiplier of the rate-distortion optimised quantiser, in 1/256 of
    /// `step^2` per bit; 0 rounds to nearest.
    pub lambda: u8,
    /// Allow prediction of each octree level from the one above.
    pub prediction: bool,
    /// Return what the decoder will, at the cost of half a decoding.
    pub reconstruction: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { mode: Mode::Range, lambda: 24, prediction: true, reconstruction: true }
    }
}

/// A coded group of channels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Encoded {
    /// The stream.
    pub bytes: Vec<u8>,
    /// What [`decode`] returns for it; empty unless asked for.
    pub reconstruction: Vec<Vec<i32>>,
}

/// What the decoder must know about a channel besides its coefficients.
#[derive(Clone, Debug)]
struct Head {
    step: Step,
    centroids: Centroids,
    /// Strength of the prediction per octree level, in 1/16; empty if all are 0.
    strength: Vec<u8>,
}

/// Codes `channels` (leaf order, one value per point) with a quantiser step each.
///
/// A level saturates at 2^31 - 1 steps: keep `|value| sqrt(points) / step` below that. The
/// reconstruction tells the truth either way.
///
/// # Errors
/// If a channel's length is not the number of points, or the steps are not one per channel.
pub fn encode(plan: &Plan, channels: &[&[i32]], steps: &[Step], o: &Options) -> Result<Encoded> {
    if steps.len() != channels.len() {
        return Err(Error::Count { what: "steps", got: steps.len(), want: channels.len() });
    }
    let (bytes, done) = encode_channels(plan, steps, o, |c| Cow::Borrowed(channels[c]))?;
    Ok(Encoded { bytes, reconstruction: done.values })
}

/// As [`encode`], for callers that make each channel when it is needed and want the stream only:
/// `channel(i)` is asked for channels `0..steps.len()` in order and its answer soon dropped. Also
/// says whether every coefficient was quantised to zero, so that nothing is lost without the group.
///
/// # Errors
/// As [`encode`].
pub fn encode_with(
    plan: &Plan,
    steps: &[Step],
    o: &Options,
    mut channel: impl FnMut(usize) -> Vec<i32>,
) -> Result<(Vec<u8>, bool)> {
    let o = Options { reconstruction: false, ..*o };
    let (bytes, done) = encode_channels(plan, steps, &o, |c| Cow::Owned(channel(c)))?;
    Ok((bytes, done.quantised.iter().all(|q| q.iter().all(|&level| level == 0))))
}

fn encode_channels<'a>(
    plan: &Plan,
    steps: &[Step],
    o: &Options,
    mut channel: impl FnMut(usize) -> Cow<'a, [i32]>,
) -> Result<(Vec<u8>, Quantised)> {
    let mut bytes = Vec::new();
    put_varint(&mut bytes, steps.len() as u64);
    let mut done = Quantised { coded: vec![0; plan.len()], ..Quantised::default() };
    let mut at = 0;
    while at < steps.len() {
        let size = chunk_size(steps.len() - at);
        let mut chunk = Vec::with_capacity(size);
        for channel_at in at..at + size {
            let values = channel(channel_at);
            if values.len() != plan.len() {
                let (got, want) = (values.len(), plan.len());
                return Err(Error::ChannelLength { channel: channel_at, got, want });
            }
            chunk.push(values);
        }
        let views: Vec<&[i32]> = chunk.iter().map(|values| &values[..]).collect();
        match (&views[..], &steps[at..at + size]) {
            (&[a, b, c, d], &[p, q, r, s]) => done.add(plan, [a, b, c, d], [p, q, r, s], o)?,
            (&[a, b, c], &[p, q, r]) => done.add(plan, [a, b, c], [p, q, r], o)?,
            (&[a, b], &[p, q]) => done.add(plan, [a, b], [p, q], o)?,
            (c, p) => done.add(plan, [c[0]], [p[0]], o)?,
        }
        at += size;
    }
    done.coded = Vec::new();
    done.heads.iter().for_each(|h| h.write(&mut bytes));
    let refs: Vec<&[i32]> = done.quantised.iter().map(Vec::as_slice).collect();
    bytes.extend(coeffs::encode(plan, &refs, o.mode)?);
    Ok((bytes, done))
}

/// Decodes what [`encode`] wrote; `max_channels` bounds the memory.
///
/// # Errors
/// If the stream is truncated, corrupt or has more channels than allowed.
pub fn decode(plan: &Plan, bytes: &[u8], max_channels: usize) -> Result<Vec<Vec<i32>>> {
    let mut out = Vec::new();
    decode_with(plan, bytes, max_channels, |_, values| out.push(values))?;
    Ok(out)
}

/// As [`decode`], for callers that use up each channel when it is there: `channel(i, values)` is
/// called for every channel in order. Returns the number of channels.
///
/// # Errors
/// As [`decode`]; `channel` is not called before the levels of all channels have been read.
pub fn decode_with(
    plan: &Plan,
    bytes: &[u8],
    max_channels: usize,
    mut channel: impl FnMut(usize, Vec<i32>),
) -> Result<usize> {
    let mut r = Reader::new(bytes);
    let channels = r.varint("channel count")?;
    if channels > max_channels as u64 {
        return Err(r.corrupt("channel count"));
    }
    let heads: Vec<Head> =
        (0..channels).map(|_| Head::read(&mut r, plan)).collect::<Result<_>>()?;
    let quantised = coeffs::decode(plan, &bytes[r.pos()..], heads.len())?;
    let mut quantised = quantised.into_iter();
    let mut at = 0;
    while at < heads.len() {
        let size = chunk_size(heads.len() - at);
        // Levels are dropped as soon as they have become values.
        let levels: Vec<Vec<i32>> = quantised.by_ref().take(size).collect();
        let mut give = |values: &mut [Vec<i32>]| {
            for (i, v) in values.iter_mut().enumerate() {
                channel(at + i, std::mem::take(v));
            }
        };
        match (&levels[..], &heads[at..at + size]) {
            ([a, b, c, d], [p, q, r, s]) => {
                give(&mut reconstruct(plan, [a, b, c, d], [p, q, r, s])?);
            }
            ([a, b, c], [p, q, r]) => give(&mut reconstruct(plan, [a, b, c], [p, q, r])?),
            ([a, b], [p, q]) => give(&mut reconstruct(plan, [a, b], [p, q])?),
            (l, h) => give(&mut reconstruct(plan, [&l[0]], [&h[0]])?),
        }
        at += size;
    }
    Ok(heads.len())
}

/// Values of `C` channels from their coefficients.
fn reconstruct<const C: usize>(
    plan: &Plan,
    quantised: [&Vec<i32>; C],
    heads: [&Head; C],
) -> Result<[Vec<i32>; C]> {
    if heads.iter().any(|h| !h.strength.is_empty()) {
        let dc = std::array::from_fn(|i| dequantise_dc(quantised[i], heads[i]));
        let mut source = Dequantiser { quantised, heads };
        let low = vec![[0; C]; plan.len()];
        return Ok(to_values(plan, &raht::reconstruct(plan, dc, &mut source, low)));
    }
    let mut out = std::array::from_fn(|_| Vec::new());
    for (i, values) in out.iter_mut().enumerate() {
        let dequantise = |&q| heads[i].step.dequantise_one(q, heads[i].centroids);
        let mut c: Vec<i64> = quantised[i].iter().map(dequantise).collect();
        if let Some(dc) = c.first_mut() {
            *dc = dequantise_dc(quantised[i], heads[i]);
        }
        plan.inverse_fixed(&mut c)?;
        *values = c.iter().map(|&v| round_value(v)).collect();
    }
    Ok(out)
}

fn dequantise_dc(quantised: &[i32], head: &Head) -> i64 {
    quantised.first().map_or(0, |&q| head.step.dequantise_one(q, Centroids::default()))
}

fn round_value(v: i64) -> i32 {
    let half = 1i64 << (VALUE_BITS - 1);
    let v = v.saturating_add(half) >> VALUE_BITS;
    v.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
}

/// Splits interleaved channels, takes the leaf weights out and rounds.
fn to_values<const C: usize>(plan: &Plan, low: &[[i64; C]]) -> [Vec<i32>; C] {
    std::array::from_fn(|i| {
        let one = low.iter().enumerate();
        one.map(|(leaf, v)| round_value(plan.unweight_one(leaf, v[i]))).collect()
    })
}

impl Head {
    fn write(&self, out: &mut Vec<u8>) {
        put_varint(out, self.step.0);
        out.extend(self.centroids.to_bytes());
        out.push(u8::from(!self.strength.is_empty()));
        for pair in self.strength.chunks(2) {
            out.push(pair[0] | (pair.get(1).copied().unwrap_or(0) << 4));
        }
    }

    fn read(r: &mut Reader<'_>, plan: &Plan) -> Result<Self> {
        let step = Step(r.varint("step")?);
        let c = r.bytes(3, "centroid shifts")?;
        let centroids = Centroids::from_bytes([c[0], c[1], c[2]]);
        let mut strength = Vec::new();
        match r.u8("prediction flag")? {
            0 => {}
            1 => {
                let levels = plan.levels().len() - 1;
                let packed = r.bytes(levels.div_ceil(2) as u64, "prediction strengths")?;
                strength = packed.iter().flat_map(|b| [b & 15, b >> 4]).take(levels).collect();
            }
            _ => return Err(r.corrupt("prediction flag")),
        }
        Ok(Self { step, centroids, strength })
    }

    fn strength(&self, depth: usize) -> f32 {
        self.strength.get(depth).map_or(0.0, |&s| f32::from(s) / 16.0)
    }
}

/// Decoder: residual from the stream.
struct Dequantiser<'a, const C: usize> {
    quantised: [&'a Vec<i32>; C],
    heads: [&'a Head; C],
}

impl<const C: usize> Residual<C> for Dequantiser<'_, C> {
    fn start_level(&mut self, depth: usize) -> [f32; C] {
        self.heads.map(|h| h.strength(depth))
    }

    #[inline]
    fn high(&mut self, k: usize, predicted: [i64; C], _: [i64; C]) -> [i64; C] {
        let mut high = predicted;
        for i in 0..C {
            let h = self.heads[i];
            let r = h.step.dequantise_one(self.quantised[i][k], h.centroids);
            high[i] = high[i].wrapping_add(r);
        }
        high
    }
}

/// Channels that are done, as the encoder goes through a group.
#[derive(Default)]
struct Quantised {
    heads: Vec<Head>,
    quantised: Vec<Vec<i32>>,
    values: Vec<Vec<i32>>,
    /// Per coefficient: sum of the magnitudes of the channels done.
    coded: Vec<u32>,
}

impl Quantised {
    /// Quantises the next `C` channels.
    fn add<const C: usize>(
        &mut self,
        plan: &Plan,
        channels: [&[i32]; C],
        steps: [Step; C],
        o: &Options,
    ) -> Result<()> {
        let mut heads =
            steps.map(|step| Head { step, centroids: Centroids::TYPICAL, strength: Vec::new() });
        let mut forward = Forward::new(plan, channels, VALUE_BITS, o.prediction);
        if o.prediction {
            for (h, s) in heads.iter_mut().zip(forward.measure_strength(plan)) {
                h.strength = s;
            }
        }
        let (levels, sums, low) = self.quantise(plan, forward.exact, &heads, o.lambda);
        if low.is_none() {
            // Nothing was predicted from reconstructed values, so the shifts can still be chosen.
            for (h, s) in heads.iter_mut().zip(&sums) {
                h.centroids = s.centroids();
            }
        }
        if o.reconstruction {
            self.values.extend(match low {
                Some(low) => to_values(plan, &low),
                None => reconstruct(plan, levels.each_ref(), heads.each_ref())?,
            });
        }
        self.quantised.extend(levels);
        self.heads.extend(heads);
        Ok(())
    }

    /// One pass of the encoder over `C` channels.
    fn quantise<const C: usize>(
        &mut self,
        plan: &Plan,
        exact: Vec<[i64; C]>,
        heads: &[Head; C],
        lambda: u8,
    ) -> Pass<C> {
        let n = plan.len();
        let mut q = Quantiser {
            plan,
            first: self.heads.len(),
            coded: &mut self.coded,
            heads,
            thresholds: Thresholds::new(lambda),
            per_unit: std::array::from_fn(|i| heads[i].step.per_unit()),
            context: Magnitudes::new(n, 1),
            quantised: std::array::from_fn(|_| vec![0; n]),
            sums: [CentroidSums::default(); C],
        };
        let mut dc = [0; C];
        if let Some(exact) = exact.first() {
            for i in 0..C {
                let level = (exact[i].unsigned_abs() as f64 * q.per_unit[i] + 0.5) as i32;
                q.quantised[i][0] = if exact[i] < 0 { -level } else { level };
                dc[i] = dequantise_dc(&q.quantised[i], &heads[i]);
            }
        }
        let mut low = None;
        if heads.iter().any(|h| !h.strength.is_empty()) {
            low = Some(raht::reconstruct(plan, dc, &mut q, exact));
        } else {
            for (depth, level) in plan.levels().windows(2).enumerate() {
                q.start_level(depth);
                for k in level[0] as usize..level[1] as usize {
                    q.high(k, [0; C], exact[plan.split_leaf(k)]);
                }
            }
        }
        (q.quantised, q.sums, low)
    }
}

/// Quantised coefficients, centroid sums and, if anything was predicted, reconstructed values.
type Pass<const C: usize> = ([Vec<i32>; C], [CentroidSums; C], Option<Vec<[i64; C]>>);

/// Encoder: quantises the residual as it goes.
struct Quantiser<'a, const C: usize> {
    plan: &'a Plan,
    /// Number of channels done before these, and the sums of their magnitudes.
    first: usize,
    coded: &'a mut [u32],
    heads: &'a [Head; C],
    thresholds: Thresholds,
    per_unit: [f64; C],
    context: Magnitudes,
    quantised: [Vec<i32>; C],
    sums: [CentroidSums; C],
}

impl<const C: usize> Residual<C> for Quantiser<'_, C> {
    fn start_level(&mut self, depth: usize) -> [f32; C] {
        self.context.start_level();
        std::array::from_fn(|i| self.heads[i].strength(depth))
    }

    #[inline]
    fn high(&mut self, k: usize, predicted: [i64; C], exact: [i64; C]) -> [i64; C] {
        let (parent, axis) = (self.plan.parents()[k - 1], self.plan.axes()[k - 1]);
        let here = self.context.at(k, parent, axis, 0, self.first);
        let mut coded = self.coded[k];
        let mut high = predicted;
        let mut magnitudes = Packed::default();
        for i in 0..C {
            let residual = exact[i].wrapping_sub(predicted[i]);
            let m = here.expected(i, coded);
            let x = residual.unsigned_abs() as f64 * self.per_unit[i];
            let magnitude = self.thresholds.quantise(x, m);
            magnitudes.set(i, magnitude);
            coded = coded.saturating_add(magnitude);
            if magnitude != 0 {
                self.sums[i].add(magnitude, x);
                let q = if residual < 0 { -(magnitude as i32) } else { magnitude as i32 };
                self.quantised[i][k] = q;
                let h = &self.heads[i];
                high[i] = high[i].wrapping_add(h.step.dequantise_one(q, h.centroids));
            }
        }
        self.context.update(&here, magnitudes);
        self.coded[k] = coded;
        high
    }
}
