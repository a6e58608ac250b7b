//! Lossy attributes in one call: RAHT, prediction, quantisation, entropy coding.
//!
//! One call codes one group of channels that belong together (say Y, U, V of a colour); groups
//! are independent, so they can be coded on different cores.

use crate::bytes::{Reader, put_varint};
use crate::coeffs::{self, Mode};
use crate::context::Magnitudes;
use crate::error::{Error, Result};
use crate::quant::{CentroidSums, Centroids, Step, VALUE_BITS};
use crate::raht::{ClosedLoop, Plan, Residual};
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
}

impl Default for Options {
    fn default() -> Self {
        Self { mode: Mode::Range, lambda: std::env::var("LAM").map_or(28, |v| v.parse().unwrap()), prediction: true }
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
/// # Errors
/// If a channel's length is not the number of points, or the steps are not one per channel.
pub fn encode(plan: &Plan, channels: &[&[i32]], steps: &[Step], o: &Options) -> Result<Encoded> {
    if steps.len() != channels.len() {
        return Err(Error::Count { what: "steps", got: steps.len(), want: channels.len() });
    }
    let mut bytes = Vec::new();
    put_varint(&mut bytes, channels.len() as u64);
    let mut quantised: Vec<Vec<i32>> = Vec::with_capacity(channels.len());
    let mut reconstruction = Vec::with_capacity(channels.len());
    let mut coded = vec![0u32; plan.len()];
    for (channel, (values, &step)) in channels.iter().zip(steps).enumerate() {
        if values.len() != plan.len() {
            return Err(Error::ChannelLength { channel, got: values.len(), want: plan.len() });
        }
        let mut c: Vec<i64> = values.iter().map(|&v| i64::from(v) << VALUE_BITS).collect();
        plan.forward_fixed(&mut c)?;
        let mut head = Head { step, centroids: Centroids::default(), strength: Vec::new() };
        if o.prediction {
            head.strength = measure_strength(plan, &c);
        }
        let first = Quantiser::run(plan, &c, &coded, channel, &head, o.lambda);
        head.centroids = first.sums.centroids();
        let last = Quantiser::run(plan, &c, &coded, channel, &head, o.lambda);
        let (levels, low) = (last.quantised, last.low);
        head.write(&mut bytes);
        for (sum, q) in coded.iter_mut().zip(&levels) {
            *sum = sum.saturating_add(q.unsigned_abs());
        }
        quantised.push(levels);
        reconstruction.push(to_values(plan, low));
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
    let heads: Vec<Head> =
        (0..channels).map(|_| Head::read(&mut r, plan)).collect::<Result<_>>()?;
    let quantised = coeffs::decode(plan, &bytes[r.pos()..], heads.len())?;
    let reconstruct = |(q, head): (&Vec<i32>, &Head)| {
        let dc = q.first().map_or(0, |&q| head.step.dequantise_one(q, Centroids::default()));
        let mut source = Dequantiser { quantised: q, head };
        to_values(plan, ClosedLoop::run(plan, dc, &mut source))
    };
    Ok(quantised.iter().zip(&heads).map(reconstruct).collect())
}

fn to_values(plan: &Plan, mut low: Vec<i64>) -> Vec<i32> {
    plan.unweight(&mut low);
    let half = 1i64 << (VALUE_BITS - 1);
    let clamp = |v: i64| v.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32;
    low.iter().map(|&v| clamp(v.saturating_add(half) >> VALUE_BITS)).collect()
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

    fn strength(&self, depth: usize) -> i64 {
        self.strength.get(depth).map_or(0, |&s| i64::from(s))
    }
}

/// Decoder: residual from the stream.
struct Dequantiser<'a> {
    quantised: &'a [i32],
    head: &'a Head,
}

impl Residual for Dequantiser<'_> {
    fn start_level(&mut self, depth: usize) -> i64 {
        self.head.strength(depth)
    }

    #[inline]
    fn high(&mut self, k: usize, predicted: i64) -> i64 {
        let r = self.head.step.dequantise_one(self.quantised[k], self.head.centroids);
        r.wrapping_add(predicted)
    }
}

/// Encoder: quantises the residual as it goes.
struct Quantiser<'a> {
    plan: &'a Plan,
    exact: &'a [i64],
    coded: &'a [u32],
    channel: u32,
    head: &'a Head,
    thresholds: Thresholds,
    per_unit: f64,
    context: Magnitudes,
    quantised: Vec<i32>,
    sums: CentroidSums,
    low: Vec<i64>,
}

impl<'a> Quantiser<'a> {
    fn run(
        plan: &'a Plan,
        exact: &'a [i64],
        coded: &'a [u32],
        channel: usize,
        head: &'a Head,
        lambda: u8,
    ) -> Self {
        let mut this = Self {
            plan,
            exact,
            coded,
            channel: channel as u32,
            head,
            thresholds: Thresholds::new(lambda),
            per_unit: head.step.per_unit(),
            context: Magnitudes::new(plan),
            quantised: vec![0; plan.len()],
            sums: CentroidSums::default(),
            low: Vec::new(),
        };
        let mut dc = 0;
        if let Some(&exact) = exact.first() {
            let q = (exact.unsigned_abs() as f64 * this.per_unit + 0.5) as i32;
            this.quantised[0] = if exact < 0 { -q } else { q };
            dc = head.step.dequantise_one(this.quantised[0], Centroids::default());
        }
        this.low = ClosedLoop::run(plan, dc, &mut this);
        this
    }
}

impl Residual for Quantiser<'_> {
    fn start_level(&mut self, depth: usize) -> i64 {
        self.context.start_level();
        self.head.strength(depth)
    }

    #[inline]
    fn high(&mut self, k: usize, predicted: i64) -> i64 {
        let residual = self.exact[k] - predicted;
        let (parent, axis) = (self.plan.parents()[k - 1] as usize, self.plan.axes()[k - 1]);
        let m = self.context.expected(parent, axis, self.coded[k], self.channel);
        let x = residual.unsigned_abs() as f64 * self.per_unit;
        let magnitude = self.thresholds.quantise(x, m);
        self.context.update(k, parent, axis, magnitude);
        if magnitude == 0 {
            return predicted;
        }
        self.sums.add(magnitude, x);
        let q = if residual < 0 { -(magnitude as i32) } else { magnitude as i32 };
        self.quantised[k] = q;
        predicted.wrapping_add(self.head.step.dequantise_one(q, self.head.centroids))
    }
}

/// How much of each level its prediction explains, from the exact coefficients; empty if little.
fn measure_strength(plan: &Plan, exact: &[i64]) -> Vec<u8> {
    struct Measure<'a> {
        exact: &'a [i64],
        /// Per level: sums of `exact * predicted` and `predicted^2`.
        sums: Vec<[f64; 2]>,
    }
    impl Residual for Measure<'_> {
        fn start_level(&mut self, _depth: usize) -> i64 {
            self.sums.push([0.0; 2]);
            16
        }

        #[inline]
        fn high(&mut self, k: usize, predicted: i64) -> i64 {
            if predicted != 0 {
                if let Some(s) = self.sums.last_mut() {
                    let (e, p) = (self.exact[k] as f64, predicted as f64);
                    s[0] += e * p;
                    s[1] += p * p;
                }
            }
            self.exact[k]
        }
    }
    let mut m = Measure { exact, sums: Vec::new() };
    let dc = exact.first().copied().unwrap_or(0);
    let _ = ClosedLoop::run(plan, dc, &mut m);
    let strength: Vec<u8> = m
        .sums
        .iter()
        .map(|s| if s[1] > 0.0 { (16.0 * s[0] / s[1] + 0.5).clamp(0.0, 15.0) as u8 } else { 0 })
        .collect();
    if strength.iter().all(|&s| s == 0) { Vec::new() } else { strength }
}
