//! Lifting: prediction from coarser levels of detail, with an update that keeps their means.
//!
//! Fine to coarse, every point of a level is replaced by its difference from a weighted mean of its
//! neighbours in coarser levels. A part of the differences, weighted, is then added to these
//! neighbours, so that they keep the mean of what they predict. All in integers: the inverse undoes
//! the same sums in the opposite order and is exact. Coefficients are quantised in proportion to
//! the square root of how much the reconstruction depends on them.

use super::neighbours::Neighbours;
use super::residual::Residual;
use crate::bytes::{ByteReader, put_varint};
use crate::coder::{Coder, RansDecoder, RansEncoder};
use crate::error::{Error, Result};
use crate::quant::{MAX_STEP, Step, VALUE_BITS};

/// Neighbours that predict a point.
const USED: usize = 3;
/// Fraction bits of the prediction weights, which sum to exactly one.
const WEIGHT_BITS: u32 = 12;
/// Fraction bits of a point's influence.
const INFLUENCE_BITS: u32 = 8;

/// The lifting steps of a set of leaves, shared by all channels.
#[derive(Clone, Debug)]
pub struct Lifting<'a> {
    near: &'a Neighbours,
    /// Per point in coding order.
    weights: Vec<[u16; USED]>,
    /// Per leaf: how much the reconstruction depends on its coefficient.
    influence: Vec<u64>,
}

impl<'a> Lifting<'a> {
    /// Weights and influences; `near` must come from [`Neighbours::coarser`].
    #[must_use]
    pub fn new(near: &'a Neighbours) -> Self {
        let weights: Vec<[u16; USED]> = (0..near.len()).map(|at| weights(near.of(at).1)).collect();
        let mut influence = vec![1u64 << INFLUENCE_BITS; near.len()];
        for at in (0..near.len()).rev() {
            let own = influence[near.order()[at] as usize];
            for (&j, &w) in near.of(at).0.iter().zip(&weights[at]) {
                influence[j as usize] += (own * u64::from(w)) >> WEIGHT_BITS;
            }
        }
        Self { near, weights, influence }
    }

    fn predicted(&self, at: usize, values: &[i64]) -> i64 {
        let terms = self.near.of(at).0.iter().zip(&self.weights[at]);
        let sum: i128 = terms.map(|(&j, &w)| i128::from(values[j as usize]) * i128::from(w)).sum();
        (sum >> WEIGHT_BITS) as i64
    }

    /// Adds (`sign` = 1) or subtracts (-1) what the points `level` of the coding order add to their
    /// neighbours.
    fn update(&self, level: std::ops::Range<usize>, values: &mut [i64], sign: i64) {
        let mut given: Vec<(u32, i128, u64)> = Vec::with_capacity(level.len() * USED);
        for at in level {
            let i = self.near.order()[at] as usize;
            for (&j, &w) in self.near.of(at).0.iter().zip(&self.weights[at]) {
                let share = u64::from(w) * self.influence[i];
                given.push((j, i128::from(values[i]) * i128::from(share), share));
            }
        }
        given.sort_unstable_by_key(|g| g.0);
        for run in given.chunk_by(|a, b| a.0 == b.0) {
            let sum: i128 = run.iter().map(|g| g.1).sum();
            let total: i128 = run.iter().map(|g| i128::from(g.2)).sum();
            // The neighbour's own value keeps a share. Otherwise one distant point could change it
            // completely.
            let own = i128::from(self.influence[run[0].0 as usize]) << WEIGHT_BITS;
            let change = (sum / (total + own).max(1)) as i64;
            let v = &mut values[run[0].0 as usize];
            *v = v.wrapping_add(sign * change);
        }
    }

    /// Forward transform of one channel in leaf order, in place.
    ///
    /// # Errors
    /// If `values` is not one per point.
    pub fn forward(&self, values: &mut [i64]) -> Result<()> {
        self.check(values.len())?;
        for level in self.near.levels().windows(2).skip(1).rev() {
            let level = level[0] as usize..level[1] as usize;
            for at in level.clone() {
                let i = self.near.order()[at] as usize;
                values[i] = values[i].wrapping_sub(self.predicted(at, values));
            }
            self.update(level, values, 1);
        }
        Ok(())
    }

    /// Exact inverse of [`Lifting::forward`].
    ///
    /// # Errors
    /// If `values` is not one per point.
    pub fn inverse(&self, values: &mut [i64]) -> Result<()> {
        self.check(values.len())?;
        for level in self.near.levels().windows(2).skip(1) {
            let level = level[0] as usize..level[1] as usize;
            self.update(level.clone(), values, -1);
            for at in level {
                let i = self.near.order()[at] as usize;
                values[i] = values[i].wrapping_add(self.predicted(at, values));
            }
        }
        Ok(())
    }

    fn check(&self, got: usize) -> Result<()> {
        if got == self.near.len() {
            return Ok(());
        }
        Err(Error::ChannelLength { channel: 0, got, want: self.near.len() })
    }

    /// The step of leaf `i`: `step / sqrt(influence)`.
    fn step_of(&self, i: usize, step: Step) -> Step {
        let root = (self.influence[i] << 8).isqrt();
        Step(((step.0 << INFLUENCE_BITS) / root.max(1)).max(1))
    }
}

/// Inverse-distance weights of the nearest three, in 1/4096, summing to one.
fn weights(distance: &[u32]) -> [u16; USED] {
    let mut out = [0u16; USED];
    let used = distance.len().min(USED);
    let inverse = |d: u32| (1u64 << 32) / (u64::from(d) + 1) + 1;
    let total: u64 = distance[..used].iter().map(|&d| inverse(d)).sum();
    let mut left = 1u64 << WEIGHT_BITS;
    for i in (1..used).rev() {
        let w = (inverse(distance[i]) << WEIGHT_BITS) / total;
        out[i] = w as u16;
        left -= w;
    }
    if used > 0 {
        out[0] = left as u16;
    }
    out
}

/// Codes `channels` (leaf order) by lifting with a quantiser step each.
///
/// # Errors
/// If a channel's length is not the number of points, or the steps are not one per channel.
pub fn encode_lifting(lift: &Lifting<'_>, channels: &[&[i32]], steps: &[Step]) -> Result<Vec<u8>> {
    if steps.len() != channels.len() {
        return Err(Error::Count { what: "steps", got: steps.len(), want: channels.len() });
    }
    let mut out = Vec::new();
    put_varint(&mut out, channels.len() as u64);
    for (channel, (values, &step)) in channels.iter().zip(steps).enumerate() {
        if values.len() != lift.near.len() {
            return Err(Error::ChannelLength { channel, got: values.len(), want: lift.near.len() });
        }
        let step = step.min(MAX_STEP);
        let mut c: Vec<i64> = values.iter().map(|&v| i64::from(v) << VALUE_BITS).collect();
        lift.forward(&mut c)?;
        let mut q: Vec<i32> = c
            .iter()
            .enumerate()
            .map(|(i, &c)| {
                let x = c.unsigned_abs() as f64 * lift.step_of(i, step).per_unit();
                let m = (x + 0.4) as i32;
                if c < 0 { -m } else { m }
            })
            .collect();
        let mut coder = RansEncoder::default();
        code_levels(lift, &mut q, &mut coder);
        let coded = coder.finish();
        put_varint(&mut out, step.0);
        put_varint(&mut out, coded.len() as u64);
        out.extend(coded);
    }
    Ok(out)
}

/// Decodes what [`encode_lifting`] wrote; `max_channels` bounds the memory.
///
/// # Errors
/// If the stream is truncated, corrupt or has more channels than allowed.
pub fn decode_lifting(
    lift: &Lifting<'_>,
    bytes: &[u8],
    max_channels: usize,
) -> Result<Vec<Vec<i32>>> {
    let mut r = ByteReader::new(bytes);
    let channels = r.channels(max_channels)?;
    let mut out = Vec::new();
    for _ in 0..channels {
        let step = Step(r.varint("step")?).min(MAX_STEP);
        let len = r.varint("channel length")?;
        let mut coder = RansDecoder::new(r.bytes(len, "channel")?)?;
        let mut q = vec![0i32; lift.near.len()];
        code_levels(lift, &mut q, &mut coder);
        coder.finish()?;
        let one = |(i, &q): (usize, &i32)| lift.step_of(i, step).dequantise(q);
        let mut c: Vec<i64> = q.iter().enumerate().map(one).collect();
        lift.inverse(&mut c)?;
        let clamp = |v: i64| v.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32;
        let half = 1i64 << (VALUE_BITS - 1);
        out.push(c.iter().map(|&v| clamp(v.saturating_add(half) >> VALUE_BITS)).collect());
    }
    Ok(out)
}

/// Codes quantised coefficients in coding order. The magnitudes of the neighbours predict a
/// point's.
fn code_levels<C: Coder>(lift: &Lifting<'_>, q: &mut [i32], coder: &mut C) {
    let mut model = Residual::new();
    let mut last = 0u64;
    for at in 0..lift.near.len() {
        if !C::ENCODING && coder.exhausted() {
            return;
        }
        let i = lift.near.order()[at] as usize;
        let (index, _) = lift.near.of(at);
        let sum: u64 = index.iter().map(|&j| u64::from(q[j as usize].unsigned_abs())).sum();
        let expected = [8 * sum / index.len().max(1) as u64, last];
        let v = model.code(coder, i64::from(q[i]), expected);
        q[i] = v.clamp(i64::from(-i32::MAX), i64::from(i32::MAX)) as i32;
        last = (last * 3) / 4 + 2 * v.unsigned_abs();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Leaf, Octree};

    /// A step that is smaller by the root of the influence: errors of all coefficients then count alike.
    #[test]
    fn influence_is_shared_out_and_steps_fall_with_its_root() {
        let leaves = (0..900u64).map(|i| Leaf { morton: 4 * i + i % 3, depth: 5 }).collect();
        let near = Neighbours::coarser(&Octree::of_points(5, leaves).unwrap());
        let lift = Lifting::new(&near);
        let coarsest = &near.order()[..near.levels()[1] as usize];
        let sum: u64 = coarsest.iter().map(|&i| lift.influence[i as usize]).sum();
        let points = sum as f64 / f64::from(1 << INFLUENCE_BITS);
        assert!((points - 900.0).abs() < 9.0, "{points}");
        let step = Step::new(20.0);
        for i in [coarsest[0] as usize, 450, 899] {
            let influence = lift.influence[i] as f64 / f64::from(1 << INFLUENCE_BITS);
            let product = lift.step_of(i, step).value() * influence.sqrt();
            assert!((product - 20.0).abs() < 0.2, "{i}: {product}");
        }
        assert!(lift.influence[coarsest[0] as usize] > 100 << INFLUENCE_BITS);
    }
}
