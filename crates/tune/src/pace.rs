//! [`Pace`]: how long the rest of a run takes, from its forecast and from how fast it is.

use crate::progress::StageName;
use finetune::Backend;

/// Seconds for which what was known before counts: the first steps make room, and are slow.
const TRUSTED: f64 = 10.0;

/// What runs, and where.
type Stage = (StageName, Backend);

/// Seconds that a unit of the forecast takes. Stages differ, since some run on a GPU.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace {
    /// What was known when the stage began; `None` for nothing.
    before: Option<f64>,
    stage: Option<Stage>,
    /// The last report: seconds of the run, and the forecast of what was left then.
    last: (f64, f64),
    /// Seconds of this stage, and the forecast of them.
    here: (f64, f64),
}

impl Pace {
    /// Of a run that begins with a forecast of what is left: in seconds, or in any unit.
    pub(crate) fn new(left: f64, in_seconds: bool) -> Self {
        let before = in_seconds.then_some(1.0);
        Self { before, stage: None, last: (0.0, left), here: (0.0, 0.0) }
    }

    fn value(&self) -> f64 {
        let (seconds, forecast) = self.here;
        match self.before {
            Some(before) => (seconds + TRUSTED) / (forecast + TRUSTED / before),
            None if forecast > 0.0 => seconds / forecast,
            None => 1.0,
        }
    }

    /// Seconds that are left after so many seconds of the run, by the forecast of what is left.
    pub(crate) fn seconds_left(&mut self, stage: Stage, seconds: f64, left: f64) -> f64 {
        if self.stage.is_some_and(|before| before != stage) {
            (self.before, self.here) = (Some(self.value()), (0.0, 0.0));
        }
        self.here.0 += seconds - self.last.0;
        self.here.1 += (self.last.1 - left).max(0.0);
        (self.stage, self.last) = (Some(stage), (seconds, left));
        self.value() * left
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_first_steps_hardly_count_and_a_faster_stage_counts_at_once() {
        let mut pace = Pace::new(200.0, true);
        // 2 s of the forecast take 5 s, the others as long as it says.
        let round = (StageName::Round { round: 1, rounds: 1 }, Backend::Cpu);
        let first = pace.seconds_left(round, 5.0, 198.0);
        assert!((220.0..260.0).contains(&first), "{first}");
        let later = pace.seconds_left(round, 103.0, 100.0);
        assert!((100.0..105.0).contains(&later), "{later}");
        // A GPU is ten times as fast.
        let mut seconds = 103.0;
        let mut at = |left: f64| {
            seconds += 1.0;
            pace.seconds_left((StageName::CodecInTheLoop, Backend::Gpu), seconds, left)
        };
        let found: Vec<f64> = [90.0, 80.0, 70.0, 60.0, 50.0].into_iter().map(&mut at).collect();
        assert!(found[4] < 14.0 && found.is_sorted_by(|a, b| a > b), "{found:?}");
    }

    #[test]
    fn without_a_forecast_in_seconds_the_run_itself_tells() {
        let mut pace = Pace::new(1000.0, false);
        let stage = (StageName::Training, Backend::Cpu);
        assert_eq!(pace.seconds_left(stage, 5.0, 900.0), 45.0);
        assert_eq!(pace.seconds_left(stage, 10.0, 500.0), 10.0);
    }
}
