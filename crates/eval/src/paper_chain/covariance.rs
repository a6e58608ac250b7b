//! Covariances: indices into a codebook with a scale factor each, or integers without further loss.

use anyhow::{Context, Result, bail, ensure};
use gpcc_lite::coder::{Coder, Decoder, Encoder};
use gpcc_lite::model::Bit;
use gpcc_lite::predict::{Neighbours, decode_lossless, encode_lossless};
use gpcc_lite::raht::Plan;
use gpcc_lite::rlgr;
use gs_model::Scene;
use vq::Codebook;

use super::{bytes, channel};

/// Step of the logarithms of the scale factors: as fine as gsvx codes covariances at quality 60.
const LOG_SCALE_FACTOR_STEP: f32 = 0.145;
/// Components of a covariance in integers: log-scales, then quaternions.
const CHANNELS: usize = 7;
/// Top bits of an index that are coded in the context of those of the index before.
const TOP_BITS: u32 = 5;
/// `tan(pi / 16)`: the greatest parameter of a codeword's rotation.
const ROTATION_RANGE: f64 = 0.198_912_367_379_658;
/// Observations that the model of a bit remembers.
const MEMORY: u32 = 160;

/// How covariances are coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Covariance {
    /// A codebook of `2^bits` normalised covariances: the paper's lossy mode.
    Codebook {
        /// Binary logarithm of the number of codewords.
        bits: u8,
    },
    /// Integers of `bits` bits over each component's range: the paper's lossless mode, with 16.
    Integers {
        /// Bits per integer.
        bits: u8,
    },
}

/// Rotations and log-scales.
type Decoded = (Vec<[f32; 4]>, Vec<[f32; 3]>);

const CODEBOOK: u8 = 0;
const INTEGERS: u8 = 1;

impl Covariance {
    pub(super) fn encode(
        self,
        scene: &Scene,
        plan: &Plan,
        j_high: u8,
        importance: &[f32],
    ) -> Result<Vec<u8>> {
        match self {
            Self::Codebook { bits } => encode_codebook(scene, plan, bits, importance),
            Self::Integers { bits } => encode_integers(scene, plan, j_high, bits),
        }
    }
}

/// Decodes what [`Covariance::encode`] coded, for the leaves of `plan`.
pub(super) fn decode(mut coded: &[u8], plan: &Plan, j_high: u8) -> Result<Decoded> {
    match coded.split_off_first() {
        Some(&CODEBOOK) => decode_codebook(coded, plan),
        Some(&INTEGERS) => decode_integers(coded, plan, j_high),
        _ => bail!("no such mode"),
    }
}

fn encode_codebook(scene: &Scene, plan: &Plan, bits: u8, importance: &[f32]) -> Result<Vec<u8>> {
    let mut out = vec![CODEBOOK];
    if scene.is_empty() {
        return Ok(out);
    }
    let split = |(&q, &l)| vq::Covariance::split(q, l);
    let both = scene.rotations.iter().zip(&scene.log_scales);
    let parts: Vec<(vq::Covariance, f32)> =
        both.map(split).collect::<Result<_, _>>().context("covariance")?;
    let (covariances, factors): (Vec<_>, Vec<f32>) = parts.into_iter().unzip();
    let options = vq::Options::with_codewords(1 << bits);
    let book = Codebook::train(&covariances, importance, &options)?;
    let (rotation_bits, log_scale_bits, codewords) = book.integers();
    out.extend([rotation_bits, log_scale_bits]);
    out.extend((codewords.len() as u32).to_le_bytes());
    // Neighbours in the codebook are alike.
    for k in 0..6 {
        let mut before = 0;
        let differences = codewords.iter().map(|w| w[k] - std::mem::replace(&mut before, w[k]));
        bytes::put_block(&mut out, &rlgr::encode(&differences.collect::<Vec<i32>>()));
    }
    let mut coder = Encoder::default();
    code_indices(&mut coder, &mut book.assign(&covariances), codewords.len());
    bytes::put_block(&mut out, &coder.finish());
    let factors = factors.into_iter().map(f64::from).collect();
    out.extend(channel::encode(plan, factors, LOG_SCALE_FACTOR_STEP)?);
    Ok(out)
}

fn decode_codebook(mut coded: &[u8], plan: &Plan) -> Result<Decoded> {
    if plan.is_empty() {
        return Ok(Decoded::default());
    }
    let [rotation_bits, log_scale_bits] = bytes::array(&mut coded)?;
    let count = u32::from_le_bytes(bytes::array(&mut coded)?) as usize;
    ensure!((1..=vq::MAX_CODEWORDS).contains(&count), "{count} codewords");
    let mut words = vec![[0i32; 6]; count];
    for k in 0..6 {
        let mut sum = 0i32;
        for (word, d) in words.iter_mut().zip(rlgr::decode(bytes::block(&mut coded)?, count)?) {
            sum = sum.wrapping_add(d);
            word[k] = sum;
        }
    }
    ensure!((2..=24).contains(&rotation_bits), "{rotation_bits} bits of a rotation");
    let step = ROTATION_RANGE / f64::from((1u32 << (rotation_bits - 1)) - 1);
    let unit = libm::exp2f(-f32::from(log_scale_bits));
    let mut indices = vec![0; plan.len()];
    let mut decoder = Decoder::new(bytes::block(&mut coded)?)?;
    code_indices(&mut decoder, &mut indices, count);
    decoder.finish()?;
    let factors = channel::decode(plan, coded)?;
    let covariance = |(&index, factor): (&u32, f64)| {
        let [x, y, z, a, b, c] = *words.get(index as usize).context("no such codeword")?;
        let log_scale = |v: i32| (f64::from(0.0 - v as f32 * unit) + factor) as f32;
        Ok((rotation([x, y, z].map(|v| f64::from(v) * step)), [a, b, c].map(log_scale)))
    };
    indices.iter().zip(factors).map(covariance).collect()
}

/// The unit quaternion of modified Rodrigues parameters, `(x, y, z) / (1 + w)`.
fn rotation([x, y, z]: [f64; 3]) -> [f32; 4] {
    let square = x * x + y * y + z * z;
    let inverse = 1.0 / (1.0 + square);
    let twice = 2.0 * inverse;
    [(1.0 - square) * inverse, x * twice, y * twice, z * twice].map(|v| v as f32)
}

/// Codes one index per leaf, bit by bit from the top. A bit's context is the bits above it and, for the
/// top bits, those of the index before. A decoder fills `indices` in.
fn code_indices<C: Coder>(coder: &mut C, indices: &mut [u32], codewords: usize) {
    let bits = usize::BITS - codewords.saturating_sub(1).leading_zeros();
    let mut top = vec![Bit::default(); 1 << (2 * TOP_BITS)];
    let mut rest = vec![Bit::default(); 1 << bits];
    let mut before = 0usize;
    for index in indices {
        let mut prefix = 0u32;
        for depth in 0..bits {
            let node = 1usize << depth | prefix as usize;
            let model = match depth {
                d if d < TOP_BITS => &mut top[before << TOP_BITS | node],
                _ => &mut rest[node],
            };
            let bit = model.code(coder, *index >> (bits - 1 - depth) & 1 == 1, MEMORY);
            prefix = prefix << 1 | u32::from(bit);
        }
        before = (prefix >> bits.saturating_sub(TOP_BITS)) as usize;
        *index = prefix;
    }
}

fn encode_integers(scene: &Scene, plan: &Plan, j_high: u8, bits: u8) -> Result<Vec<u8>> {
    let mut out = vec![INTEGERS, bits];
    let top = f64::from((1u32 << bits) - 1);
    let mut channels: Vec<Vec<i32>> = Vec::with_capacity(CHANNELS);
    for k in 0..CHANNELS {
        let value = |i: usize| {
            if k < 3 { scene.log_scales[i][k] } else { scene.rotations[i][k - 3] }
        };
        let (mut min, mut max) = (f32::INFINITY, f32::NEG_INFINITY);
        for v in (0..scene.len()).map(value) {
            min = min.min(v);
            max = max.max(v);
        }
        out.extend(min.to_le_bytes());
        out.extend(max.to_le_bytes());
        let (min, range) = (f64::from(min), f64::from(max) - f64::from(min));
        let scale = if range > 0.0 { top / range } else { 0.0 };
        let integer = |i| ((f64::from(value(i)) - min) * scale).round() as i32;
        channels.push((0..scene.len()).map(integer).collect());
    }
    let near = Neighbours::new(plan.leaves(), j_high)?;
    let channels: Vec<&[i32]> = channels.iter().map(Vec::as_slice).collect();
    out.extend(encode_lossless(&near, &channels)?);
    Ok(out)
}

fn decode_integers(mut coded: &[u8], plan: &Plan, j_high: u8) -> Result<Decoded> {
    let [bits] = bytes::array(&mut coded)?;
    ensure!((1..=24).contains(&bits), "{bits} bits");
    let top = f64::from((1u32 << bits) - 1);
    let mut ranges = [[0.0; 2]; CHANNELS];
    for v in ranges.as_flattened_mut() {
        *v = f64::from(f32::from_le_bytes(bytes::array(&mut coded)?));
    }
    let near = Neighbours::new(plan.leaves(), j_high)?;
    let channels = decode_lossless(&near, coded, CHANNELS)?;
    ensure!(channels.len() == CHANNELS, "{} channels", channels.len());
    let value = |k: usize, i: usize| {
        let [min, max] = ranges[k];
        (min + f64::from(channels[k][i]) * ((max - min) / top)) as f32
    };
    let covariance = |i| {
        let log_scales = std::array::from_fn(|k| value(k, i));
        (std::array::from_fn(|k| value(3 + k, i)), log_scales)
    };
    Ok((0..plan.len()).map(covariance).collect())
}
