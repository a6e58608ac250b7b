//! One channel of values: RAHT, a uniform quantiser, RLGR.

use anyhow::Result;
use gpcc_lite::raht::Plan;
use gpcc_lite::rlgr;

use super::bytes;

/// A level is the magnitude in steps plus this, rounded down: what TMC13 does with RAHT coefficients.
const ROUNDING: f64 = 1.0 / 3.0;

/// The step of a QP for a channel.
pub(super) fn step(qp: u8, values: &[f64]) -> f32 {
    let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
    for &v in values {
        min = min.min(v);
        max = max.max(v);
    }
    let range = if max > min { max - min } else { 1.0 };
    (range / 255.0 * libm::exp2((f64::from(qp) - 4.0) / 6.0)) as f32
}

/// Codes the values of all leaves, step first.
pub(super) fn encode(plan: &Plan, mut values: Vec<f64>, step: f32) -> Result<Vec<u8>> {
    plan.forward_f64(&mut values)?;
    let level = |v: &f64| {
        let steps = v / f64::from(step);
        (steps.abs() + ROUNDING).floor().copysign(steps) as i32
    };
    let levels: Vec<i32> = values.iter().map(level).collect();
    let mut out = step.to_le_bytes().to_vec();
    out.extend(rlgr::encode(&levels));
    Ok(out)
}

/// Decodes what [`encode`] coded.
pub(super) fn decode(plan: &Plan, mut coded: &[u8]) -> Result<Vec<f64>> {
    let step = f64::from(f32::from_le_bytes(bytes::array(&mut coded)?));
    let levels = rlgr::decode(coded, plan.len())?;
    let mut values: Vec<f64> = levels.into_iter().map(|l| f64::from(l) * step).collect();
    plan.inverse_f64(&mut values)?;
    Ok(values)
}

const LUMA: f64 = 0.577_350_269_189_625_8;
const ORANGE: f64 = std::f64::consts::FRAC_1_SQRT_2;
const GREEN: f64 = 0.408_248_290_463_863;

/// The inverse of [`crate::attributes::colour_planes`].
pub(super) fn colour([y, o, g]: [f64; 3]) -> [f32; 3] {
    let [y, o, g] = [y * LUMA, o * ORANGE, g * GREEN];
    [(y + o - g) as f32, (y + g + g) as f32, (y - o - g) as f32]
}
