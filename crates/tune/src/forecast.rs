//! [`Forecast`]: the time of a tune, from two measurements on its input.

use crate::plan::TunePlan;

/// A step takes this much longer than a render with its gradients: the optimiser and the codec take time too.
/// Runs on fox, bonsai, kacy and la_fontaine took 0.8 to 1.3 times what follows from it.
const STEP_OVER_RENDER: f64 = 1.35;
/// Time of a step grows with the number of Gaussians to this power.
const TIME_EXPONENT: f64 = 0.6;

/// Seconds of work on the input.
#[derive(Clone, Copy)]
pub(crate) struct Forecast {
    /// Gaussians of the input.
    pub(crate) input: usize,
    /// A render with its gradients.
    pub(crate) render: f64,
    /// A pass over all views that finds what the Gaussians are worth. Each round ends with one.
    pub(crate) pass: f64,
}

impl Forecast {
    /// Seconds of plans, one after the other, after so many steps of them.
    pub(crate) fn seconds_after(&self, plans: &[TunePlan], steps: u64) -> f64 {
        let mut before = 0;
        let of_one = |plan: &TunePlan| {
            let done = steps.saturating_sub(before);
            before += plan.steps();
            self.seconds_of(plan, done)
        };
        plans.iter().map(of_one).sum()
    }

    /// Seconds of a plan after so many of its steps.
    fn seconds_of(&self, plan: &TunePlan, steps: u64) -> f64 {
        let share = |kept: f64| libm::pow(kept, TIME_EXPONENT);
        let step = STEP_OVER_RENDER * self.render;
        let of_round = |round: u64| {
            let end = round * plan.round_steps;
            let left = end.saturating_sub(steps).min(plan.round_steps);
            let pass = if steps <= end { self.pass } else { 0.0 };
            let kept = plan.kept(self.input, round) as f64 / self.input.max(1) as f64;
            share(kept) * (step * left as f64 + pass)
        };
        let left = plan.steps().saturating_sub(steps).min(plan.loop_steps);
        let in_loop = share(1.0 - plan.fraction) * step * left as f64;
        (1..=plan.rounds).map(of_round).sum::<f64>() + in_loop
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pass_after_a_round_counts_until_the_next_step() {
        let plan =
            TunePlan { quality: 50.0, fraction: 0.0, rounds: 2, round_steps: 10, loop_steps: 5 };
        let forecast = Forecast { input: 1000, render: 1.0, pass: 100.0 };
        let after = |steps| forecast.seconds_after(&[plan], steps);
        let hundredths = |a, b| (100.0 * (after(a) - after(b))).round();
        assert_eq!([hundredths(0, 9), hundredths(9, 10)], [9.0 * 135.0, 135.0]);
        assert_eq!([hundredths(10, 11), hundredths(20, 21)], [10_135.0, 10_135.0]);
        assert_eq!(after(plan.steps()), 0.0);
    }
}
