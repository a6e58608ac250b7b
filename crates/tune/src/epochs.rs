//! [`Epochs`]: how well the views are matched, pass by pass, and when that ends a run.

use crate::progress::StopReason;

/// A gain in dB that counts.
const LEAST_GAIN: f64 = 0.01;

/// Mean PSNR of each whole pass over the views, each as rendered in its step, and the steps of the pass under way.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Epochs {
    pub(crate) past: Vec<f64>,
    pub(crate) current: Vec<f64>,
}

impl Epochs {
    /// Adds a step of a run on so many views.
    pub(crate) fn add(&mut self, psnr: f64, views: usize) {
        self.current.push(psnr);
        if self.current.len() >= views {
            self.past.extend(mean(&self.current));
            self.current.clear();
        }
    }

    /// The last whole pass, or what there is of the first.
    pub(crate) fn psnr(&self) -> Option<f64> {
        self.past.last().copied().or_else(|| mean(&self.current))
    }

    /// Why a run ends at the end of a pass, if it does: it reached `target` dB, or the best of the last `patience`
    /// passes is no better than the best before.
    pub(crate) fn stop(&self, target: Option<f64>, patience: Option<u32>) -> Option<StopReason> {
        if !self.current.is_empty() {
            return None;
        }
        let last = *self.past.last()?;
        if target.is_some_and(|target| last >= target) {
            return Some(StopReason::TargetReached);
        }
        let since = self.past.len().checked_sub(patience? as usize)?;
        let best = |e: &[f64]| e.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let (before, after) = self.past.split_at(since);
        let stale = !before.is_empty() && best(after) < best(before) + LEAST_GAIN;
        stale.then_some(StopReason::NoImprovement)
    }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(psnr: &[f64]) -> Epochs {
        let mut epochs = Epochs::default();
        // Passes of two steps, half a dB apart.
        psnr.iter().for_each(|db| [-0.25, 0.25].iter().for_each(|d| epochs.add(db + d, 2)));
        epochs
    }

    #[test]
    fn a_run_ends_at_its_target_and_where_nothing_improves() {
        let rising = of(&[20.0, 21.0, 22.0]);
        assert_eq!((rising.psnr(), rising.stop(Some(22.1), Some(1))), (Some(22.0), None));
        assert_eq!(rising.stop(Some(22.0), None), Some(StopReason::TargetReached));
        let flat = of(&[20.0, 20.005, 19.0, 20.009]);
        assert_eq!(flat.stop(None, Some(3)), Some(StopReason::NoImprovement));
        assert_eq!((flat.stop(None, Some(4)), flat.stop(None, None)), (None, None));
        // A run does not end within a pass.
        let mut within = flat.clone();
        within.add(30.0, 2);
        assert_eq!((within.psnr(), within.stop(Some(1.0), Some(1))), (Some(20.009), None));
    }
}
