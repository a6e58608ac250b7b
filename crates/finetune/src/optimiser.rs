//! Adam and the order of views, for callers whose parameters are not those of a scene.

pub use crate::shuffle::permutation;
use crate::simd;
use crate::stages::adam::{BETA1, BETA2, update};

/// The part of a step that all parameters share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adam {
    /// What a rate is divided by: the first bias correction.
    inverse_bias1: f32,
    inv_sqrt_bias2: f32,
}

impl Adam {
    /// `step` counts from 1.
    #[must_use]
    pub fn new(step: u64) -> Self {
        let t = step.clamp(1, 1 << 30) as f64;
        let bias = |beta: f32| 1.0 - libm::pow(f64::from(beta), t);
        Self {
            inverse_bias1: (1.0 / bias(BETA1)) as f32,
            inv_sqrt_bias2: (1.0 / bias(BETA2).sqrt()) as f32,
        }
    }

    /// What a rate is multiplied by, and the root of the second moment.
    #[cfg(feature = "gpu")]
    pub(crate) fn corrections(&self) -> (f32, f32) {
        (self.inverse_bias1, self.inv_sqrt_bias2)
    }

    /// Moves parameters against their gradient. `moments` are the first and the second, zero before the
    /// first step. A gradient that is not finite counts as zero.
    pub fn update(
        &self,
        parameters: &mut [f32],
        moments: [&mut [f32]; 2],
        gradient: &[f32],
        rates: &[f32],
    ) {
        simd::run(Update { adam: self, parameters, moments, gradient, rates });
    }
}

struct Update<'a> {
    adam: &'a Adam,
    parameters: &'a mut [f32],
    moments: [&'a mut [f32]; 2],
    gradient: &'a [f32],
    rates: &'a [f32],
}

impl simd::Kernel for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { adam, parameters, moments: [m, v], gradient, rates } = self;
        for ((((p, m), v), &g), &rate) in
            parameters.iter_mut().zip(m).zip(v).zip(gradient).zip(rates)
        {
            update(p, m, v, g, rate * adam.inverse_bias1, adam.inv_sqrt_bias2);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_descended() {
        let (mut p, mut m, mut v) = ([3.0f32, -2.0], [0.0; 2], [0.0; 2]);
        for step in 1..=2000 {
            let gradient = p.map(|p| 2.0 * p);
            let rate = 0.05 * (1.0 - step as f32 / 2000.0);
            Adam::new(step).update(&mut p, [&mut m, &mut v], &gradient, &[rate; 2]);
        }
        assert!(p.iter().all(|p| p.abs() < 1e-2), "{p:?}");
        Adam::new(1).update(&mut p, [&mut m, &mut v], &[f32::NAN, 0.0], &[1e-3; 2]);
        assert!(p.iter().all(|p| p.is_finite()));
    }
}
