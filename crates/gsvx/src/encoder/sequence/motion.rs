//! What moves in a chunk, as bytes.

use super::curves::{curves_of, fit};
use crate::bytes::Writer;
use crate::chunk::{ChunkValues, MOVING, step_of_unit_weight, steps_of};
use crate::error::{Result, coding};
use crate::head::Steps;
use crate::sequence::motion::{BIRTHS, base_of, code_alive, code_flags, flagged, plan_of};
use gpcc_lite::attribute::{self, Quantisation};
use gpcc_lite::coder::{RansEncoder, Tally};
use gpcc_lite::raht::Rows;
use gs_model::Scene;

/// A leaf moves if a value leaves that of the static stream by more than this, in steps.
const LEAST: f64 = 0.5;

/// Step of a position per step of a covariance, in sizes of a typical Gaussian. Finer costs little, since Gaussians move
/// alike.
const POSITION: f32 = 0.25;

/// The Gaussians of the leaves of a group of frames.
pub(super) struct MovedLeaves {
    /// As the static stream has them, but for its quantisation.
    pub(super) reference: Scene,
    pub(super) frames: Vec<Scene>,
    /// Whether each leaf is there, frame by frame; empty if all always are.
    pub(super) alive: Vec<bool>,
    /// Steps of what moves, by number in [`MOVING`].
    pub(super) steps: [f32; MOVING.len()],
}

impl MovedLeaves {
    /// The steps of all groups, for Gaussians of a typical size.
    pub(super) fn steps(steps: &Steps, size: f32) -> [f32; MOVING.len()] {
        let mut all = MOVING.map(|group| group.step(steps));
        all[0] *= POSITION * size;
        all
    }

    /// What moves in the leaves of a chunk, of which `first` is the first; nothing if nothing moves.
    pub(super) fn encode(&self, first: usize, values: &ChunkValues) -> Result<Vec<u8>> {
        let (count, leaves) = (self.frames.len(), values.octree().len());
        let (mut flags, mut head, mut coder) = (0, Writer::default(), RansEncoder::default());
        if !self.alive.is_empty() {
            let mut alive = self.alive[first * count..(first + leaves) * count].to_vec();
            if alive.contains(&false) {
                flags |= BIRTHS;
                code_alive(&mut coder, count, &mut alive);
            }
        }
        for number in 0..=values.groups() {
            let (group, step) = (&MOVING[number], self.steps[number]);
            let unit = f64::from(step_of_unit_weight(step));
            let (mut moves, deltas) = self.deltas(first, values, number);
            let some = flagged(&moves);
            if some.is_empty() {
                continue;
            }
            let plan = plan_of(values, &some)?;
            let weights: Vec<f64> = (0..some.len()).map(|i| plan.weight_of_leaf(i)).collect();
            let least = f64::from(group.lambda()) * (16 * count) as f64 * unit * unit;
            let base = base_of(values, number, &some);
            let steps = steps_of(step, group.channels);
            let quantisation = Quantisation { steps: &steps, lambda: group.lambda() };
            let mut kept = Vec::new();
            for mut curve in curves_of(&deltas, &weights, count, group.channels, least) {
                let mut rows = Rows::new(some.len(), group.channels);
                for (i, delta) in deltas.chunks_exact(count * group.channels).enumerate() {
                    curve.project(delta, rows.row_mut(i));
                }
                let without = energy(&rows, &weights);
                curve.factors = fit(&base, &rows, &weights, unit);
                (0..some.len()).for_each(|i| curve.predict(base.row(i), -1.0, rows.row_mut(i)));
                let (mut tally, mut rest) = (Tally::default(), rows.clone());
                attribute::encode(&mut tally, &plan, &quantisation, &mut rest)
                    .map_err(coding("motion"))?;
                rest.add(-1.0, &rows);
                // Small coefficients become zeros: then the curve is not worth its own bits.
                let bits = tally.bits() as f64 + (16 * count + 32 * curve.factors.len()) as f64;
                let saved = without - energy(&rest, &weights);
                if saved >= f64::from(group.lambda()) * bits * unit * unit {
                    kept.push((curve, rows));
                }
            }
            if kept.is_empty() {
                continue;
            }
            flags |= 1 << number;
            code_flags(&mut coder, &mut moves);
            head.f32(step);
            head.u8(kept.len() as u8 - 1);
            for (curve, rows) in &mut kept {
                attribute::encode(&mut coder, &plan, &quantisation, rows)
                    .map_err(coding("motion"))?;
                curve.values.iter().for_each(|v| head.bytes.extend(v.to_le_bytes()));
                head.u8(u8::from(!curve.factors.is_empty()));
                curve.factors.iter().for_each(|&f| head.f32(f));
            }
        }
        if flags == 0 {
            return Ok(Vec::new());
        }
        Ok([vec![flags], head.bytes, coder.finish()].concat())
    }

    /// Which leaves of a chunk move, and their values without those of the reference: leaf by leaf, frame by frame.
    fn deltas(&self, first: usize, values: &ChunkValues, number: usize) -> (Vec<bool>, Vec<f32>) {
        let (group, leaves) = (&MOVING[number], values.octree().len());
        let unit = f64::from(self.steps[number]) * LEAST;
        let (mut moves, mut deltas) = (vec![false; leaves], Vec::new());
        let (mut own, mut delta) = (vec![0.0; group.channels], vec![0.0; group.channels]);
        for (i, moves) in moves.iter_mut().enumerate() {
            let (start, mut greatest) = (deltas.len(), 0.0f64);
            group.values(&self.reference, first + i, &mut own);
            for frame in &self.frames {
                group.values(frame, first + i, &mut delta);
                delta.iter_mut().zip(&own).for_each(|(d, v)| *d -= v);
                greatest = greatest.max(delta.iter().map(|&d| f64::from(d * d)).sum());
                deltas.extend_from_slice(&delta);
            }
            let finer = f64::from(1u32 << values.classes()[i])
                / f64::from(1u32 << crate::importance::MEAN_CLASS);
            *moves = greatest.sqrt() * finer > unit;
            if !*moves {
                deltas.truncate(start);
            }
        }
        (moves, deltas)
    }
}

/// The weighted sum of squares.
fn energy(rows: &Rows, weights: &[f64]) -> f64 {
    let square = |i: usize| rows.row(i).iter().map(|&v| f64::from(v * v)).sum::<f64>();
    weights.iter().enumerate().map(|(i, weight)| weight * square(i)).sum()
}
