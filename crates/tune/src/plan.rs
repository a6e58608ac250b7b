//! [`Plan`]: how far to prune and how long to tune, from the target.
//!
//! All settings follow from one number, the quality, which sets the quantisation steps. Low rates want
//! fewer Gaussians at finer steps than a stream without tuning has. The fractions below are the convex
//! hull of measurements on one scene; the shares of blending weight that they give up are nearly the
//! same in others (docs/results/tune.md).

use gsvx::{EncodeOptions, Steps};

use crate::error::{Error, Result};
use crate::options::Effort;

/// Quality, and the fraction of the Gaussians that is left out there. Linear in between.
const FRACTIONS: [(f32, f64); 7] =
    [(30.0, 0.85), (42.0, 0.75), (54.0, 0.65), (58.0, 0.5), (63.0, 0.3), (70.0, 0.15), (85.0, 0.0)];
/// [`Effort::Quick`] prunes as far as a quality so much higher.
const QUICK_PRUNES_AS: f32 = 4.0;
/// The octree is that of a quality so much lower: positions are fitted no better than that.
const VOXEL_QUALITY_BELOW: f32 = 14.0;
/// Steps over those of a stream without tuning, relative to the other channels.
const SH_STEP: f32 = 1.3;
const COVARIANCE_STEP: f32 = 1.4;

/// What a run will do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Sets the quantisation steps.
    pub quality: f32,
    /// Fraction of the Gaussians that is left out.
    pub fraction: f64,
    /// Rounds of pruning.
    pub rounds: u64,
    /// Steps of fine-tuning after each round.
    pub round_steps: u64,
    /// Steps with the codec in the loop.
    pub loop_steps: u64,
}

impl Plan {
    /// The plan for a quality.
    ///
    /// # Errors
    /// [`Error::Option`] if `quality` is out of range.
    pub fn new(quality: f32, effort: Effort) -> Result<Self> {
        EncodeOptions::from_quality(quality)?;
        let (rounds, round_steps, loop_steps) = match effort {
            Effort::Quick => (3, 60, 240),
            Effort::Normal => (4, 250, 1400),
            Effort::Long => (5, 1000, 9000),
        };
        // A short run recovers from less pruning.
        let mild = if effort == Effort::Quick { QUICK_PRUNES_AS } else { 0.0 };
        let fraction = fraction(quality + mild);
        Ok(Self { quality, fraction, rounds, round_steps, loop_steps })
    }

    /// This plan, if a run can follow it.
    pub(crate) fn checked(self) -> Result<Self> {
        EncodeOptions::from_quality(self.quality)?;
        if !(0.0..1.0).contains(&self.fraction) {
            let range = "from 0 to below 1";
            return Err(Error::target("fraction", self.fraction, range));
        }
        if self.rounds == 0 || self.loop_steps == 0 {
            return Err(Error::target("rounds and steps of the loop", 0.0, "1 or more"));
        }
        Ok(self)
    }

    /// Steps of the whole run.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.rounds * self.round_steps + self.loop_steps
    }

    /// Gaussians that remain of `n` after round `round`, counted from 1: each round leaves out the same
    /// share.
    pub(crate) fn kept(&self, n: usize, round: u64) -> usize {
        let share = libm::pow(1.0 - self.fraction, round as f64 / self.rounds.max(1) as f64);
        ((n as f64 * share).ceil() as usize).clamp(1.min(n), n)
    }
}

/// The voxelization of a quality, with importances from cameras.
pub(crate) fn voxel_options(quality: f32, importance: Vec<f32>) -> gsvx::Result<EncodeOptions> {
    let mut options = EncodeOptions::from_quality((quality - VOXEL_QUALITY_BELOW).max(0.0))?;
    options.importance = Some(importance);
    options.drop_unseen = true;
    Ok(options)
}

/// The quantisation steps of a quality.
pub(crate) fn steps(quality: f32) -> Result<Steps> {
    let mut steps = EncodeOptions::from_quality(quality)?.steps;
    steps.sh = steps.sh.map(|s| s * SH_STEP);
    steps.covariance *= COVARIANCE_STEP;
    Ok(steps)
}

fn fraction(quality: f32) -> f64 {
    let [first, .., last] = FRACTIONS;
    if quality <= first.0 {
        return first.1;
    }
    let pair = FRACTIONS.windows(2).find(|w| quality <= w[1].0);
    pair.map_or(last.1, |w| {
        let t = f64::from((quality - w[0].0) / (w[1].0 - w[0].0));
        w[0].1 + t * (w[1].1 - w[0].1)
    })
}

/// How far the PSNR of a tuned stream is below that of the input model, dB, by quality. Where a search
/// for a PSNR begins.
const LOSSES: [(f32, f64); 6] =
    [(42.0, 1.83), (54.0, 0.9), (58.0, 0.5), (63.0, 0.22), (70.0, 0.05), (80.0, 0.0)];
/// Loss per quality point below all of these.
const LOSS_PER_POINT: f64 = 0.12;

/// Against renders of the input model there is no loss: the PSNR at quality 58, and dB per point.
const AGAINST_RENDERS: (f64, f64) = (36.0, 0.5);
/// What matches the views this well was made to, dB.
const IS_RENDERS: f64 = 60.0;

/// The quality at which a stream has a PSNR of `target` dB, about, where the input model has `input`.
pub(crate) fn quality_for_psnr(target: f64, input: f64) -> f32 {
    if input < IS_RENDERS {
        return quality_for_loss(input - target);
    }
    let (at_58, per_point) = AGAINST_RENDERS;
    (58.0 + (target - at_58) / per_point).clamp(5.0, 85.0) as f32
}

/// The quality at which a stream is `loss` dB below the input model, about.
fn quality_for_loss(loss: f64) -> f32 {
    let [first, .., last] = LOSSES;
    if loss >= first.1 {
        return (f64::from(first.0) - (loss - first.1) / LOSS_PER_POINT).max(5.0) as f32;
    }
    let pair = LOSSES.windows(2).find(|w| loss >= w[1].1);
    pair.map_or(last.0, |w| {
        let t = (w[0].1 - loss) / (w[0].1 - w[1].1);
        w[0].0 + t as f32 * (w[1].0 - w[0].0)
    })
}

impl Error {
    pub(crate) fn target(option: &'static str, value: f64, range: &'static str) -> Self {
        Self::Option { option, value, range }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lower_qualities_prune_more() {
        let fractions: Vec<f64> = (0..=100).map(|q| fraction(q as f32)).collect();
        assert!(fractions.windows(2).all(|w| w[0] >= w[1]), "{fractions:?}");
        assert_eq!((fraction(0.0), fraction(58.0), fraction(100.0)), (0.85, 0.5, 0.0));
        assert!(Plan::new(101.0, Effort::Quick).is_err());
    }

    #[test]
    fn rounds_leave_the_fraction() {
        let plan = Plan::new(58.0, Effort::Normal).unwrap();
        let kept: Vec<usize> = (1..=plan.rounds).map(|r| plan.kept(1000, r)).collect();
        assert_eq!(kept[3], 500);
        assert!(kept.windows(2).all(|w| w[0] > w[1]));
        assert_eq!((plan.kept(1, 4), plan.kept(0, 4)), (1, 0));
    }

    #[test]
    fn a_greater_loss_asks_for_a_lower_quality() {
        let found: Vec<f32> = (-10..60).map(|i| quality_for_loss(f64::from(i) * 0.1)).collect();
        assert!(found.windows(2).all(|w| w[0] >= w[1]), "{found:?}");
        assert!((quality_for_loss(0.5) - 58.0).abs() < 1e-3);
    }
}
