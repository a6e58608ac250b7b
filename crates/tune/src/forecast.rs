//! [`Forecast`]: the time of a tune, from two measurements on its input.

use crate::plan::TunePlan;

/// A step of the loop takes this much longer than one without the codec.
const LOOP_OVER_STEP: f64 = 1.6;
/// Time of a step grows with the number of Gaussians to this power.
const TIME_EXPONENT: f64 = 0.6;

/// Seconds of work on the input.
#[derive(Clone, Copy)]
pub(crate) struct Forecast {
    /// Gaussians of the input.
    pub(crate) input: usize,
    /// A step without the codec.
    pub(crate) step: f64,
    /// What the Gaussians are worth to all views: after each round, for the next one or the loop.
    pub(crate) worth: f64,
}

impl Forecast {
    /// Seconds of a plan after so many of its steps.
    pub(crate) fn seconds_after(&self, plan: &TunePlan, steps: u64) -> f64 {
        let share = |kept: f64| libm::pow(kept, TIME_EXPONENT);
        let rounds: f64 = (1..=plan.rounds)
            .map(|round| {
                let end = round * plan.round_steps;
                let left = end.saturating_sub(steps).min(plan.round_steps);
                let worth = if steps <= end { self.worth } else { 0.0 };
                let kept = plan.kept(self.input, round) as f64 / self.input.max(1) as f64;
                share(kept) * (self.step * left as f64 + worth)
            })
            .sum();
        let left = plan.steps().saturating_sub(steps).min(plan.loop_steps);
        rounds + LOOP_OVER_STEP * share(1.0 - plan.fraction) * self.step * left as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pass_after_a_round_counts_until_the_next_step() {
        let plan =
            TunePlan { quality: 50.0, fraction: 0.0, rounds: 2, round_steps: 10, loop_steps: 5 };
        let forecast = Forecast { input: 1000, step: 1.0, worth: 100.0 };
        let after = |steps| forecast.seconds_after(&plan, steps);
        assert_eq!([0, 9, 10, 11].map(after), [228.0, 219.0, 218.0, 117.0]);
        assert_eq!([20, 24, 25].map(after), [108.0, 1.6, 0.0]);
    }
}
