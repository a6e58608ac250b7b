//! Lossy attributes: weighted RAHT, quantisation and entropy coding of a group of channels.
//!
//! The channels of a group belong together (the planes of a colour, the entries of a covariance):
//! where one has large coefficients, so have the others, and the coder's contexts use that. Groups
//! are coded one after another and do not depend on each other.
//!
//! Invariant: [`encode`] leaves in its rows the values that [`decode`] returns, bit for bit.
//!
//! Normative description: `docs/format.md`, "Attributes".

mod quantiser;
mod reconstruct;

use crate::coder::{Coder, RansDecoder, code_signed};
pub use crate::coefficients::CLASSES;
use crate::coefficients::{LevelRows, RowCoder};
use crate::error::{Error, Result};
use crate::raht::{self, LANES, RahtPlan, Rows};
use quantiser::{Quantiser, Row};
use reconstruct::reconstruct;

/// How an encoder quantises.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantisation<'a> {
    /// The step of each channel.
    pub steps: &'a [f32],
    /// Lagrangian multiplier of the rate-distortion optimised quantiser, in `step^2` per bit; 0
    /// rounds to nearest.
    pub lambda: f32,
}

impl<'a> Quantisation<'a> {
    /// These steps, and a `lambda` of 0.1.
    #[must_use]
    pub fn new(steps: &'a [f32]) -> Self {
        Self { steps, lambda: 0.1 }
    }
}

/// Codes the values in `rows` with a step for each channel, and replaces them by what a decoder
/// will return, bit for bit. Returns whether every level is zero.
///
/// The coder is a [`RansEncoder`](crate::coder::RansEncoder), or a [`Tally`](crate::coder::Tally) if only
/// the size and the values are wanted. A level saturates at `2^31 - 1` steps.
///
/// # Errors
/// If there is not one row per leaf and one positive step per channel.
pub fn encode<C: Coder>(
    coder: &mut C,
    plan: &RahtPlan,
    quantisation: &Quantisation<'_>,
    rows: &mut Rows,
) -> Result<bool> {
    encode_with_prices(coder, plan, quantisation, rows, None)
}

/// As [`encode`]; `prices`, if they are wanted, become the derivatives of the number of bits by the values.
///
/// Levels are integers, so the derivatives are those of a smooth estimate: the bits that a
/// magnitude costs where the coder expects what it expects there, as a function of the value
/// before quantisation. Magnitudes far below a step have next to no price.
///
/// # Errors
/// As [`encode`].
pub fn encode_with_prices<C: Coder>(
    coder: &mut C,
    plan: &RahtPlan,
    quantisation: &Quantisation<'_>,
    rows: &mut Rows,
    mut prices: Option<&mut Rows>,
) -> Result<bool> {
    let steps = quantisation.steps;
    if let Some(prices) = &mut prices {
        prices.resize(plan.len(), steps.len());
    }
    check_steps(steps, rows.channels())?;
    if plan.is_empty() || steps.is_empty() {
        return Ok(true);
    }
    raht::forward(plan, rows)?;
    let quantiser = Quantiser::new(quantisation);
    let mut all_zero = true;
    for (v, &step) in rows.row_mut(0).iter_mut().zip(steps) {
        let level = level_of_mean(plan, *v, step);
        code_signed(coder, level);
        *v = mean_of_level(plan, level, step);
        all_zero &= level == 0;
    }
    if let Some(prices) = &mut prices {
        prices.row_mut(0).fill(0.0);
    }
    let mut context = RowCoder::new(plan, steps.len());
    let mut level = LevelRows::default();
    let mut row = Row::new(rows.width());
    for range in plan.levels().windows(2) {
        if range[0] == range[1] {
            continue;
        }
        context.next_level(plan, &mut level, range[0], range[1]);
        for i in 0..level.count {
            let k = level.first + i;
            let to_high_pass = 1.0 / plan.scale_of(k);
            let large = quantiser.load(rows.lanes_of(plan.split_leaf(k)), to_high_pass, &mut row);
            let any = large && quantiser.quantise(&context, i, &mut row);
            if let Some(prices) = &mut prices {
                if !large {
                    quantiser.expect_of_zeros(&context, i, &mut row);
                }
                quantiser.price(&row, to_high_pass, prices.lanes_of_mut(plan.split_leaf(k)));
            }
            if any {
                level.active.push(i as u32);
                level.levels.extend_from_slice(&row.levels);
                all_zero = false;
            }
        }
        context.code(coder, &mut level);
        reconstruct(plan, &level, steps, rows);
    }
    if let Some(prices) = prices {
        to_prices_of_values(plan, prices)?;
    }
    Ok(all_zero)
}

/// Takes prices of coefficients to those of the values.
fn to_prices_of_values(plan: &RahtPlan, prices: &mut Rows) -> Result<()> {
    // The transform of the weighted values is orthonormal, so its inverse is its transpose.
    raht::inverse(plan, prices)?;
    for leaf in 0..plan.len() {
        let weight = plan.weight_of_leaf(leaf) as f32;
        prices.row_mut(leaf).iter_mut().for_each(|v| *v *= weight);
    }
    Ok(())
}

/// Decodes what [`encode`] coded into `rows`, which have one channel per step.
///
/// # Errors
/// If there is not one row per leaf and one positive step per channel, or the stream is truncated.
pub fn decode(
    coder: &mut RansDecoder<'_>,
    plan: &RahtPlan,
    steps: &[f32],
    rows: &mut Rows,
) -> Result<()> {
    check_steps(steps, rows.channels())?;
    if rows.leaves() != plan.len() {
        return Err(Error::ChannelLength { channel: 0, got: rows.leaves(), want: plan.len() });
    }
    if plan.is_empty() || steps.is_empty() {
        return Ok(());
    }
    let width = rows.width();
    rows.lanes[..width].fill([0.0; LANES]);
    for (v, &step) in rows.row_mut(0).iter_mut().zip(steps) {
        *v = mean_of_level(plan, code_signed(coder, 0), step);
    }
    let mut context = RowCoder::new(plan, steps.len());
    let mut level = LevelRows::default();
    for range in plan.levels().windows(2) {
        if range[0] == range[1] {
            continue;
        }
        context.next_level(plan, &mut level, range[0], range[1]);
        context.code(coder, &mut level);
        if coder.exhausted() {
            return Err(Error::Truncated { offset: 0, what: "coefficients" });
        }
        reconstruct(plan, &level, steps, rows);
    }
    Ok(())
}

fn check_steps(steps: &[f32], channels: usize) -> Result<()> {
    if steps.len() != channels {
        return Err(Error::Count { what: "steps", got: steps.len(), want: channels });
    }
    match steps.iter().position(|s| !(s.is_normal() && *s > 0.0)) {
        Some(channel) => Err(Error::Step { channel }),
        None => Ok(()),
    }
}

/// The level of coefficient 0, which is the mean of all leaves times the root of the sum of
/// weights.
fn level_of_mean(plan: &RahtPlan, mean: f32, step: f32) -> i32 {
    let exact = f64::from(mean) * plan.root_of_weight() / f64::from(step);
    // Saturates: the sign takes one bit of 32.
    ((exact + 0.5f64.copysign(exact)) as i32).clamp(-(1 << 30), 1 << 30)
}

fn mean_of_level(plan: &RahtPlan, level: i32, step: f32) -> f32 {
    (f64::from(level) * f64::from(step) / plan.root_of_weight()) as f32
}
