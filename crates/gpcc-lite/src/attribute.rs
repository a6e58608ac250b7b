//! Lossy attributes in one call: RAHT, prediction, quantisation, entropy coding.
//!
//! One call codes one group of channels that belong together (say Y, U, V of a colour); groups
//! are independent, so they can be coded on different cores.

mod decoder;
mod encoder;
mod exact;
mod lone;
mod plane;
mod rows;

use crate::bytes::{Reader, put_varint};
use crate::coeffs::{self, Levels, Mode, places};
use crate::context::{CHUNK, chunk_sizes};
use crate::error::{Error, Result};
use crate::quant::{Centroids, Step};
use crate::raht::{self, Lanes, Plan};
use decoder::{Dequantiser, Planar, Ranged};
use encoder::{Coded, encode_rows};
pub use rows::Rows;

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
    /// Predict the finest levels too. They have two thirds of what it costs; where attributes are
    /// smooth from voxel to voxel it saves up to 4 %, and where they are not next to nothing.
    pub fine_prediction: bool,
    /// Reconstruct values at the centres of their cells, not at the means of those in them. Means
    /// make the squared error least, and shrink values towards zero: which adds up where a caller
    /// sums many of them up, as a rendered pixel does.
    pub centres: bool,
    /// Code a channel on its own by the means of its nodes too, with [`Mode::Range`]: opacities take
    /// 1 to 10 % fewer bits, for their values keep to a range and many are at its end.
    pub by_means: bool,
    /// With [`Mode::Symbols`]: channels so many apart share their models. 3 suits colours of many
    /// coefficients, whose planes resemble each other: less is to be learnt. 255 shares none.
    pub period: u8,
    /// Return what the decoder will, at the cost of a decoding at most.
    pub reconstruction: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            mode: Mode::Range,
            lambda: 26,
            prediction: true,
            fine_prediction: true,
            centres: false,
            by_means: false,
            period: u8::MAX,
            reconstruction: true,
        }
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
/// Arithmetic is in single precision: means are exact to a few units of the last of 24 bits of the
/// largest value around. A level saturates at 2^31 - 1 steps: keep `|value| sqrt(points) / step`
/// below that. The reconstruction tells the truth either way.
///
/// # Errors
/// If a channel's length is not the number of points, or the steps are not one per channel.
pub fn encode(plan: &Plan, channels: &[&[i32]], steps: &[Step], o: &Options) -> Result<Encoded> {
    if steps.len() != channels.len() {
        return Err(Error::Count { what: "steps", got: steps.len(), want: channels.len() });
    }
    for (channel, c) in channels.iter().enumerate() {
        if c.len() != plan.len() {
            return Err(Error::ChannelLength { channel, got: c.len(), want: plan.len() });
        }
    }
    let width = chunk_sizes(channels.len()).len();
    let mut rows = vec![[0.0; CHUNK]; plan.len() * width];
    for (values, (chunk, i)) in channels.iter().zip(places(channels.len())) {
        for (row, &v) in rows.chunks_exact_mut(width).zip(*values) {
            row[chunk][i] = v as f32;
        }
    }
    let coded = encode_rows(plan, steps, o, rows)?;
    let reconstruction =
        if o.reconstruction { to_values(&coded.rows.lanes, steps.len()) } else { Vec::new() };
    Ok(Encoded { bytes: coded.bytes, reconstruction })
}

/// A coded group of real numbers.
#[derive(Clone, Debug, Default)]
pub struct EncodedRows {
    /// The stream.
    pub bytes: Vec<u8>,
    /// Every coefficient was quantised to zero: nothing is lost without the group.
    pub all_zero: bool,
    /// What [`decode_rows`] returns for it, bit for bit; empty unless asked for.
    pub reconstruction: Rows,
}

/// As [`encode`], of finite real numbers: `leaf(i, row)` is called for leaves `0..plan.len()` in
/// order and fills in one value per step.
///
/// # Errors
/// As [`encode`].
pub fn encode_with(
    plan: &Plan,
    steps: &[Step],
    o: &Options,
    mut leaf: impl FnMut(usize, &mut [f32]),
) -> Result<EncodedRows> {
    let places: Vec<(usize, usize)> = places(steps.len()).collect();
    let width = chunk_sizes(steps.len()).len();
    let mut rows = vec![[0.0; CHUNK]; plan.len() * width];
    let mut values = vec![0.0; steps.len()];
    for (at, row) in rows.chunks_exact_mut(width.max(1)).enumerate() {
        leaf(at, &mut values);
        for (&v, &(chunk, i)) in values.iter().zip(&places) {
            row[chunk][i] = v;
        }
    }
    // Whatever it holds is in the rows now.
    drop(leaf);
    let Coded { bytes, rows, all_zero } = encode_rows(plan, steps, o, rows)?;
    Ok(EncodedRows { bytes, all_zero, reconstruction: rows })
}

/// Decodes what [`encode`] wrote; `max_channels` bounds the memory.
///
/// # Errors
/// If the stream is truncated, corrupt or has more channels than allowed.
pub fn decode(plan: &Plan, bytes: &[u8], max_channels: usize) -> Result<Vec<Vec<i32>>> {
    let mut rows = Rows::default();
    decode_rows(plan, bytes, max_channels, &mut rows)?;
    Ok(to_values(&rows.lanes, rows.channels()))
}

/// As [`decode`], of what [`encode_with`] wrote: `leaf(i, row)` is called for all leaves in order,
/// with one value per channel. Returns the number of channels.
///
/// # Errors
/// As [`decode`]; `leaf` is not called before everything has been decoded.
pub fn decode_with(
    plan: &Plan,
    bytes: &[u8],
    max_channels: usize,
    mut leaf: impl FnMut(usize, &[f32]),
) -> Result<usize> {
    let mut rows = Rows::default();
    decode_rows(plan, bytes, max_channels, &mut rows)?;
    let mut values = vec![0.0; rows.channels()];
    for at in 0..rows.leaves() {
        rows.copy(at, &mut values);
        leaf(at, &values);
    }
    Ok(rows.channels())
}

/// As [`decode`], of what [`encode_with`] wrote, into `rows`, whose memory is used again.
///
/// # Errors
/// As [`decode`]; `rows` then hold anything.
pub fn decode_rows(plan: &Plan, bytes: &[u8], max_channels: usize, rows: &mut Rows) -> Result<()> {
    let mut r = Reader::new(bytes);
    let channels = r.varint("channel count")?;
    if channels > max_channels as u64 {
        return Err(r.corrupt("channel count"));
    }
    let heads: Vec<Head> =
        (0..channels).map(|_| Head::read(&mut r, plan)).collect::<Result<_>>()?;
    let bytes = &bytes[r.pos()..];
    let channels = heads.len();
    plan.prepare_levels(heads.iter().map(Head::predicted_levels).max().unwrap_or(0));
    rows.resize(plan.len(), channels);
    match bytes.first() {
        Some(&coeffs::RANGE) => decode_ranged::<false>(plan, &heads, &bytes[1..], rows),
        Some(&coeffs::LONE) if !plan.is_empty() => {
            let (source, level) = lone::Ranged::new(plan, &heads, &bytes[1..])?;
            let mut source = Dequantiser::new(plan, &heads, source);
            reconstruct(plan, &heads, &[[level, 0, 0, 0]], &mut source, rows);
            source.inner.check(bytes.len())
        }
        Some(&coeffs::SYMBOLS) => decode_ranged::<true>(plan, &heads, &bytes[1..], rows),
        _ => {
            let source = Planar::new(coeffs::decode(plan, bytes, channels)?);
            let dc = source.dc();
            reconstruct(plan, &heads, &dc, &mut Dequantiser::new(plan, &heads, source), rows);
            Ok(())
        }
    }
}

/// Rows of values from a range-coded stream.
fn decode_ranged<const BY_SYMBOLS: bool>(
    plan: &Plan,
    heads: &[Head],
    bytes: &[u8],
    rows: &mut Rows,
) -> Result<()> {
    let (coder, period) = coeffs::open(BY_SYMBOLS, bytes)?;
    let mut source = Ranged::<BY_SYMBOLS>::new(plan, coder, heads.len(), period);
    let dc = source.dc(plan.len());
    let mut source = Dequantiser::new(plan, heads, source);
    reconstruct(plan, heads, &dc, &mut source, rows);
    if source.inner.exhausted() {
        return Err(Error::Truncated { offset: bytes.len(), what: "coefficients" });
    }
    Ok(())
}

/// Rows of values from the levels of coefficient 0 and a source of the others.
fn reconstruct(
    plan: &Plan,
    heads: &[Head],
    dc: &[Levels],
    source: &mut impl raht::Residual,
    rows: &mut Rows,
) {
    if plan.is_empty() {
        return;
    }
    // All other rows are written before they are read.
    rows.lanes[..dc.len()].fill([0.0; CHUNK]);
    for (head, (chunk, i)) in heads.iter().zip(places(heads.len())) {
        rows.lanes[chunk][i] = head.mean(plan, dc[chunk][i]);
    }
    raht::reconstruct(plan, dc.len(), &mut rows.lanes, usize::MAX, source);
}

/// Splits rows into channels and rounds.
fn to_values(rows: &[Lanes], channels: usize) -> Vec<Vec<i32>> {
    let width = chunk_sizes(channels).len();
    let channel = |(chunk, i): (usize, usize)| {
        rows.chunks_exact(width).map(|row: &[Lanes]| round_value(row[chunk][i])).collect()
    };
    places(channels).map(channel).collect()
}

/// Halves away from zero; saturates.
#[inline]
fn round_value(v: f32) -> i32 {
    (v + 0.5f32.copysign(v)) as i32
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

    /// Number of octree levels, from the top, after which nothing is predicted.
    fn predicted_levels(&self) -> usize {
        self.strength.iter().rposition(|&s| s != 0).map_or(0, |last| last + 1)
    }

    fn strength(&self, depth: usize) -> f32 {
        self.strength.get(depth).map_or(0.0, |&s| f32::from(s) / 16.0)
    }

    /// The level of coefficient 0 of a mean. Saturates: a level is an i32.
    fn level(&self, plan: &Plan, mean: f32) -> i32 {
        let exact = f64::from(mean) * plan.root_of_weight() / Step(self.step.0.max(1)).value();
        (exact + if exact < 0.0 { -0.5 } else { 0.5 }) as i32
    }

    /// The mean of all leaves, from the level of coefficient 0.
    fn mean(&self, plan: &Plan, dc: i32) -> f32 {
        (f64::from(dc) * self.step.value() / plan.root_of_weight()) as f32
    }
}

/// The strengths of one octree level, chunk by chunk; false if all are 0.
fn strengths(heads: &[Head], depth: usize, out: &mut [Lanes]) -> bool {
    let mut any = false;
    for (head, (chunk, i)) in heads.iter().zip(places(heads.len())) {
        out[chunk][i] = head.strength(depth);
        any |= out[chunk][i] != 0.0;
    }
    any
}
