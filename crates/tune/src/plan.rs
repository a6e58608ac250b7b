//! [`TunePlan`]: how far to prune and how long to tune, from the target.
//!
//! All settings follow from one number, the quality, which sets the quantisation steps. A Gaussian is left
//! out if the views change less without it than by the quantisation error that the quality allows: see
//! [`Spare`].
//!
//! The settings are chosen by single runs on fox, bonsai and room at the held-out views; all but those of the loss and
//! the price were measured with squared error alone.
//! - Left out by removal effects, bonsai without 60 % has 30.14 dB, by squared blending weights 29.61 dB. Passes at every
//!   second view of at most 500 pixels: office 24.53 instead of 24.81 dB, in 144 s instead of 178 s.
//! - The octree is 14 points below the stream's quality: 20 below is worse on bonsai, 8 below is no better.
//! - 0.01 (1 - SSIM) in the loss, and a price of a bit of 16 times that of a uniform quantiser at high rates. BD-rate by
//!   PSNR and by SSIM against squared error alone at a price of 8: fox +1.0 and -20.7 %, bonsai -0.8 and -18.7 %, room
//!   -2.4 and -17.0 %; with a price of 12, fox +4.6 and -19.3 %; with 8, room +6.5 and -11.4 %. A
//!   price of 32 against 16: room normal -5.8 and -4.3 %, fox quick +2.9 and +1.2 %.
//! - Importances by what small errors cost in SSIM, 1 / (2 variance + C2) in the window, beside squared errors: BD-rate by
//!   PSNR and by SSIM, room quick, -0.4 and -2.6 % (a seed alone: 3 %); removal effects so weighted, +5.4 and +1.4 %. In
//!   streams without tuning, bonsai +4.1 and -1.3 %, fox +6.2 and +0.2 %.
//! - Rates that fall from the start of the loop and of the recoveries save 59 instead of 65 % (fox), 54 instead of 68 %
//!   (room). Rates of the loop that do not follow the step: bonsai at 90 has 39.8 instead of 44.6 dB elsewhere.
//! - Photos far from the model count less: 15 % of the bytes of bonsai. The codec at every step: the same bytes and dB.
//! - Nearby views count more from 50 on. From 42 instead of 58: bonsai at 66 has 30.17 instead of 29.81 dB, and 36.0
//!   instead of 34.8 elsewhere; room 31.36 instead of 31.47, and 36.3 instead of 36.0.
//! - Fox trained with 50,000 Gaussians instead of 120,000 is smaller up to 31 dB, and takes half the time.

use gs_model::Scene;
use gsvx::{PrepareOptions, Steps, VoxelScene};

use crate::error::{Error, Result};

/// A Gaussian is left out if its removal effect is below this many times that of an error of one DC step
/// (see above).
const LEFT_OUT_BELOW: f64 = 9.0;
/// Most that is left out.
const MOST_LEFT_OUT: f64 = 0.95;
/// The DC basis function.
pub(crate) const DC_BASIS: f64 = 0.282_094_791_773_878_14;
/// [`TuneEffort::Quick`] prunes as far as a quality so much higher.
const QUICK_PRUNES_AS: f32 = 4.0;
/// The octree is that of a quality so much lower: positions are fitted no better than that.
const VOXEL_QUALITY_BELOW: f32 = 14.0;
/// Steps over those of a stream without tuning, relative to the other channels.
const SH_STEP: f32 = 1.3;
const COVARIANCE_STEP: f32 = 1.4;

/// How long to tune.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TuneEffort {
    /// About 45 seconds for 120,000 Gaussians and photos of 265x474 pixels on one core.
    Quick,
    /// About three minutes for the same, and fewer bytes than quick at equal quality.
    #[default]
    Normal,
    /// About ten minutes for the same.
    Long,
}

impl TuneEffort {
    /// From the shortest to the longest.
    pub const ALL: [Self; 3] = [Self::Quick, Self::Normal, Self::Long];

    /// The effort of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|effort| effort.name() == name)
    }

    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Quick => "quick",
            Self::Normal => "normal",
            Self::Long => "long",
        }
    }

    /// Bytes over those of the quick effort at equal PSNR, about. Normal follows from docs/results/tune.md; long from
    /// `gsvx tune` of room (qualities 50 and 58) and fox (58), by the PSNR at the photos kept aside.
    #[must_use]
    pub fn bytes_over_quick(self) -> f64 {
        match self {
            Self::Quick => 1.0,
            Self::Normal => 0.7,
            Self::Long => 0.55,
        }
    }
}

/// What a run will do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TunePlan {
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

impl TunePlan {
    /// The plan for a quality.
    pub(crate) fn new(quality: f32, effort: TuneEffort, spare: &Spare) -> gsvx::Result<Self> {
        Steps::of_quality(quality)?;
        // A short run recovers from less pruning.
        let mild = if effort == TuneEffort::Quick { QUICK_PRUNES_AS } else { 0.0 };
        let fraction = spare.fraction((quality + mild).min(100.0))?;
        let empty = Self { quality, fraction, rounds: 0, round_steps: 0, loop_steps: 0 };
        Ok(empty.with(effort))
    }

    /// This plan with the rounds and steps of an effort.
    pub(crate) fn with(self, effort: TuneEffort) -> Self {
        let (rounds, round_steps, loop_steps) = match effort {
            TuneEffort::Quick => (3, 80, 270),
            TuneEffort::Normal => (4, 300, 1200),
            TuneEffort::Long => (5, 1000, 9000),
        };
        Self { rounds, round_steps, loop_steps, ..self }
    }

    /// This plan for a stream that goes on from that of a higher quality: one round, and shorter. A run of five qualities
    /// takes twice the time of its first stream: docs/results/tune.md.
    pub(crate) fn further(self) -> Self {
        let (round_steps, loop_steps) = (self.round_steps / 2, self.loop_steps * 2 / 5);
        Self { rounds: 1, round_steps, loop_steps, ..self }
    }

    /// This plan, if a run can follow it.
    pub(crate) fn checked(self) -> Result<Self> {
        Steps::of_quality(self.quality)?;
        if !(0.0..1.0).contains(&self.fraction) {
            let (value, range) = (self.fraction, "from 0 to below 1");
            return Err(Error::Option { option: "fraction", value, range });
        }
        if self.rounds == 0 || self.loop_steps == 0 {
            let option = "rounds and steps of the loop";
            return Err(Error::Option { option, value: 0.0, range: "1 or more" });
        }
        Ok(self)
    }

    /// Steps of the whole run.
    #[must_use]
    pub(crate) fn steps(&self) -> u64 {
        self.rounds * self.round_steps + self.loop_steps
    }

    /// Gaussians that remain of `n` after round `round`, counted from 1. The first rounds leave out most:
    /// what hardly shows needs no recovery, and steps with fewer Gaussians take less time.
    pub(crate) fn kept(&self, n: usize, round: u64) -> usize {
        let to_come = 1.0 - round as f64 / self.rounds.max(1) as f64;
        let share = libm::pow(1.0 - self.fraction, 1.0 - to_come * to_come);
        ((n as f64 * share).ceil() as usize).clamp(1.min(n), n)
    }
}

/// The leaves of a quality, with importances from cameras. `drop_unseen` leaves out what they do not see.
pub(crate) fn prepare(
    scene: &Scene,
    importance: &[f32],
    quality: f32,
    drop_unseen: bool,
) -> gsvx::Result<VoxelScene> {
    let options = PrepareOptions { drop_unseen, ..PrepareOptions::default() };
    gsvx::prepare(scene, Some(importance), (quality - VOXEL_QUALITY_BELOW).max(0.0), &options)
}

/// The quantisation steps of a quality.
pub(crate) fn steps(quality: f32) -> gsvx::Result<Steps> {
    let mut steps = Steps::of_quality(quality)?;
    steps.sh = steps.sh.map(|s| s * SH_STEP);
    steps.covariance *= COVARIANCE_STEP;
    Ok(steps)
}

/// How many Gaussians a scene can spare.
pub(crate) struct Spare {
    /// Of each Gaussian, ascending: its removal effect over that of an error of 1 in the DC value of a
    /// Gaussian of mean importance.
    ratios: Vec<f64>,
}

impl Spare {
    /// Of all Gaussians the removal effects and the sums of squared blending weights, as in `finetune::Removal`.
    pub(crate) fn new(effects: &[f32], importance: &[f32]) -> Self {
        let sum: f64 = importance.iter().map(|&v| f64::from(v)).sum();
        let mean = sum / importance.len().max(1) as f64;
        // Such an error shows in all three colour channels.
        let of_one = 3.0 * DC_BASIS * DC_BASIS * mean;
        let mut ratios: Vec<f64> = effects.iter().map(|&e| f64::from(e) / of_one).collect();
        ratios.sort_unstable_by(f64::total_cmp);
        Self { ratios }
    }

    /// The fraction that is left out at a quality.
    fn fraction(&self, quality: f32) -> gsvx::Result<f64> {
        let step = f64::from(Steps::of_quality(quality)?.dc);
        let most = LEFT_OUT_BELOW * step * step;
        let out = self.ratios.partition_point(|&r| r < most);
        Ok((out as f64 / self.ratios.len().max(1) as f64).min(MOST_LEFT_OUT))
    }
}

/// The loss of a tuned stream by quality: how far its PSNR is below that of the input model, dB. A search for a PSNR
/// begins with it.
const LOSSES: [(f32, f64); 6] =
    [(42.0, 3.0), (50.0, 1.7), (58.0, 0.9), (66.0, 0.45), (78.0, 0.1), (90.0, 0.0)];
/// Loss per quality point below all of these.
const LOSS_PER_POINT: f64 = 0.12;

/// Against renders of the input model there is no loss: the PSNR at quality 58, and dB per point.
const AGAINST_RENDERS: (f64, f64) = (36.0, 0.5);
/// From this PSNR on, the views are renders of the model, dB.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lower_qualities_prune_more() {
        let spare = spare();
        let fractions: Vec<f64> = (0..=100).map(|q| spare.fraction(q as f32).unwrap()).collect();
        assert!(fractions.windows(2).all(|w| w[0] >= w[1]), "{fractions:?}");
        assert!(fractions[20] > fractions[58] && fractions[58] > fractions[90], "{fractions:?}");
        assert!(TunePlan::new(101.0, TuneEffort::Quick, &spare).is_err());
    }

    #[test]
    fn what_shows_nothing_is_always_left_out_but_never_all() {
        let half = Spare::new(&[0.0, 1e9, 0.0, 1e9], &[1.0; 4]);
        assert_eq!((half.fraction(0.0).unwrap(), half.fraction(100.0).unwrap()), (0.5, 0.5));
        let none = Spare::new(&[0.0; 4], &[1.0; 4]);
        assert_eq!(none.fraction(50.0).unwrap(), MOST_LEFT_OUT);
        assert_eq!(Spare::new(&[], &[]).fraction(50.0).unwrap(), 0.0);
    }

    #[test]
    fn brighter_importance_units_change_nothing() {
        let effects: Vec<f32> = (0..50).map(|i| libm::exp2f(i as f32 * 0.5 - 20.0)).collect();
        let scaled: Vec<f32> = effects.iter().map(|e| e * 8.0).collect();
        let (a, b) = (Spare::new(&effects, &[1.0; 50]), Spare::new(&scaled, &[8.0; 50]));
        assert_eq!(a.fraction(55.0).unwrap(), b.fraction(55.0).unwrap());
    }

    /// Effects over 16 orders of magnitude.
    fn spare() -> Spare {
        let effects: Vec<f32> = (0..1000).map(|i| libm::exp10f(i as f32 * 0.016 - 12.0)).collect();
        Spare::new(&effects, &[1.0; 1000])
    }

    #[test]
    fn rounds_leave_the_fraction_and_the_first_ones_leave_out_most() {
        let plan = TunePlan {
            fraction: 0.5,
            ..TunePlan::new(58.0, TuneEffort::Normal, &spare()).unwrap()
        };
        let kept: Vec<usize> = (1..=plan.rounds).map(|r| plan.kept(1000, r)).collect();
        assert_eq!(kept[3], 500);
        let left_out: Vec<usize> = kept.windows(2).map(|w| w[0] - w[1]).collect();
        assert!(1000 - kept[0] > left_out[0] && left_out[2] > 0, "{kept:?}");
        assert!(left_out.windows(2).all(|w| w[0] > w[1]), "{kept:?}");
        assert_eq!((plan.kept(1, 4), plan.kept(0, 4)), (1, 0));
    }

    #[test]
    fn a_greater_loss_asks_for_a_lower_quality() {
        let found: Vec<f32> = (-10..60).map(|i| quality_for_loss(f64::from(i) * 0.1)).collect();
        assert!(found.windows(2).all(|w| w[0] >= w[1]), "{found:?}");
        assert!((quality_for_loss(0.9) - 58.0).abs() < 1e-3);
    }
}
