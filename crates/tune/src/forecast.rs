//! [`Forecast`]: the time of a tune, from two measurements on its input.

use crate::plan::TunePlan;

/// A step of a recovery, and one of the loop, over a render with its gradients: the optimiser and the codec
/// take time too. These three are means over fox, bonsai, office, kacy and la_fontaine.
const RECOVERY_OVER_RENDER: f64 = 1.35;
const LOOP_OVER_RENDER: f64 = 1.5;
/// The pass before the loop, which needs importances alone, over one that finds removal effects.
const LAST_PASS: f64 = 0.35;
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
    /// Seconds of a plan after so many of its steps.
    pub(crate) fn seconds_after(&self, plan: &TunePlan, steps: u64) -> f64 {
        let share = |kept: f64| libm::pow(kept, TIME_EXPONENT);
        let rounds: f64 = (1..=plan.rounds)
            .map(|round| {
                let end = round * plan.round_steps;
                let left = end.saturating_sub(steps).min(plan.round_steps);
                let passes = match round {
                    _ if steps > end => 0.0,
                    _ if round == plan.rounds => LAST_PASS,
                    _ => 1.0,
                };
                let kept = plan.kept(self.input, round) as f64 / self.input.max(1) as f64;
                let renders = RECOVERY_OVER_RENDER * left as f64;
                share(kept) * (self.render * renders + self.pass * passes)
            })
            .sum();
        let left = plan.steps().saturating_sub(steps).min(plan.loop_steps);
        let renders = LOOP_OVER_RENDER * left as f64;
        rounds + share(1.0 - plan.fraction) * self.render * renders
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
        let after = |steps| forecast.seconds_after(&plan, steps);
        let hundredths = |a, b| (100.0 * (after(a) - after(b))).round();
        assert_eq!([hundredths(0, 9), hundredths(9, 10)], [9.0 * 135.0, 135.0]);
        assert_eq!([hundredths(10, 11), hundredths(20, 21)], [10_135.0, 3_650.0]);
        assert_eq!(after(plan.steps()), 0.0);
    }
}
