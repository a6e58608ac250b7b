//! The quantisation steps that keep bounds on errors.

use super::errors::Ratios;
use crate::encoder::options::MaxError;
use crate::head::Steps;

/// Ratio of step to bound in the first encode, and the smallest. Below the smallest, a finer step does not reduce
/// the error.
const FIRST_STEP: f32 = 1.0;
const MIN_STEP: f32 = 0.02;
/// Greatest factor by which a step grows.
const MAX_GROWTH: f32 = 4.0;
/// A group that broke its bound then aims at this fraction of it, since changes of other steps move all errors a
/// little.
const SAFETY: f32 = 0.98;

/// Those of the first encode.
pub(super) fn first(bounds: &MaxError) -> Steps {
    steps_over(bounds, FIRST_STEP)
}

/// Steps of this many bounds.
fn steps_over(bounds: &MaxError, factor: f32) -> Steps {
    let mut steps = Steps::from_dc(factor * bounds.sh);
    steps.opacity = factor * bounds.opacity;
    steps.sh = [factor * bounds.sh; 3];
    steps.covariance = factor * bounds.shape;
    steps
}

/// New steps, from the worst errors at the present ones. Errors are about proportional to steps. Steps may grow
/// after the `first` encode only.
pub(super) fn next(mut steps: Steps, worst: &Ratios, first: bool, bounds: &MaxError) -> Steps {
    let least = steps_over(bounds, MIN_STEP);
    let times = |step: &mut f32, worst: f32, least: f32| {
        let scale = match worst {
            w if first => (1.0 / w).min(MAX_GROWTH),
            w if w > 1.0 => SAFETY / w,
            _ => 1.0,
        };
        *step = (*step * scale).max(least);
    };
    let [_, opacity, dc, sh1, sh2, sh3, shape] = *worst;
    times(&mut steps.opacity, opacity, least.opacity);
    times(&mut steps.dc, dc, least.dc);
    for (k, worst) in [sh1, sh2, sh3].into_iter().enumerate() {
        times(&mut steps.sh[k], worst, least.sh[k]);
    }
    times(&mut steps.covariance, shape, least.covariance);
    steps
}
