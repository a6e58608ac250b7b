//! Flags of `cargo xtask rd-curve`.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use clap::{Args as _, FromArgMatches as _};
use finetune::Backend;
use tune::TuneEffort;
use voxel::{ReleasedRule, Strategy};

use crate::study::Study;

/// Reads the name of an effort.
fn effort(text: &str) -> Result<TuneEffort, String> {
    let names = TuneEffort::ALL.map(TuneEffort::name).join(", ");
    TuneEffort::named(text).ok_or_else(|| format!("use one of {names}"))
}

/// Parses `LOW:HIGH[:V:TAU1:TAU2]`, the paper's criteria, or `released:LOW`, its authors' code.
fn criteria(text: &str) -> Result<Strategy> {
    let number = |s: &str| s.parse::<f64>().with_context(|| format!("{s} is not a number"));
    let depth = |s: &str| match s.parse::<u8>() {
        Ok(depth @ 0..=21) => Ok(depth),
        _ => bail!("{s} is not a depth of 0 to 21"),
    };
    let parts: Vec<&str> = text.split(':').collect();
    let (j_low, j_high, rest) = match parts[..] {
        ["released", low] => return Ok(Strategy::Released(ReleasedRule::new(depth(low)?))),
        [low, high, ref rest @ ..] => (depth(low)?, depth(high)?, rest),
        _ => bail!("expected LOW:HIGH, for example 8:16, LOW:HIGH:V:TAU1:TAU2 or released:LOW"),
    };
    ensure!(j_low <= j_high, "depths must ascend: {j_low}:{j_high}");
    match *rest {
        [] => Ok(Strategy::paper(j_low, j_high)),
        [v, tau1, tau2] => {
            let tau1 =
                tau1.parse().with_context(|| format!("{tau1} is not a number of Gaussians"))?;
            let (large_percent, tau2) = (number(v)?, number(tau2)?);
            ensure!(
                (0.0..=100.0).contains(&large_percent) && tau2 >= 0.0,
                "V is 0 to 100, TAU2 0 or more"
            );
            Ok(Strategy::Paper { large_percent, j_low, j_high, tau1, tau2 })
        }
        _ => bail!("give V, TAU1 and TAU2 together, for example 8:16:20:30:0.5"),
    }
}

/// How a voxelized model is fine-tuned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tuning {
    /// Steps, one training view each.
    pub(crate) steps: u64,
    /// Whether it begins with the merged attributes, or with none.
    pub(crate) initialised: bool,
    /// Where it computes.
    pub(crate) backend: Backend,
}

impl Tuning {
    /// For file names.
    pub(crate) fn name(self) -> String {
        format!("{}{}", if self.initialised { "tuned" } else { "blank" }, self.steps)
    }
}

/// Flags of `cargo xtask rd-curve`.
#[derive(Clone, Debug, clap::Args)]
pub struct CurveOptions {
    /// A folder with model, cameras and photos, or a name from crates/eval/scenes.toml
    #[arg(default_value = crate::scenes::DEFAULT)]
    pub(crate) scene: String,
    /// Folder of the report [default: out/rd/SCENE]
    #[arg(long)]
    pub(crate) out: Option<PathBuf>,
    /// Measure at most this many held-out views
    #[arg(long)]
    pub(crate) views: Option<usize>,
    /// Rates per curve [default: 6]
    #[arg(long)]
    pub(crate) rates: Option<usize>,
    /// Two views, five rates
    #[arg(long)]
    pub(crate) quick: bool,
    /// Depth of the uniform octree [default: chosen by rendering, deeper at higher rates]
    #[arg(long)]
    pub(crate) depth: Option<u8>,
    /// The paper's criteria, LOW:HIGH or LOW:HIGH:V:TAU1:TAU2 (20 %, 30 Gaussians, 0.5 sides), or released:LOW for its
    /// authors' code [default: about the uniform depth, as in the paper]
    #[arg(long, value_name = "CRITERIA", value_parser = criteria)]
    pub(crate) adaptive: Option<Strategy>,
    /// Steps of the paper's fine-tune, one training photo each; 0 for none [default: 400, with --quick 0; the paper: 8000]
    #[arg(long, value_name = "STEPS")]
    pub(crate) finetune: Option<u64>,
    /// Where the paper's fine-tune computes: cpu, gpu, or auto for a GPU if there is one
    #[arg(long, value_name = "WHERE", default_value = "cpu")]
    pub(crate) backend: Backend,
    /// Draw the curve of `gsvx tune` too, by effort: quick, normal (the default) or long [default: quick for the room,
    /// unless --quick is given; none for other scenes]
    #[arg(long, value_name = "EFFORT", num_args = 0..=1, require_equals = true,
        default_missing_value = "normal", value_parser = effort)]
    pub(crate) tune: Option<TuneEffort>,
    /// Curves of gsvx without cameras, and with what they hardly see
    #[arg(skip)]
    pub(crate) sights: bool,
    /// Run every stage, done before or not
    #[arg(long)]
    pub(crate) fresh: bool,
}

/// Qualities of tuned curves: from 2 dB or more below the model as it was trained to above it or near it.
pub(crate) const TUNED_QUALITIES: [f32; 6] = [42.0, 50.0, 58.0, 66.0, 78.0, 90.0];

/// The first and the last quality of a curve.
const LOW: f32 = 20.0;
const HIGH: f32 = 90.0;
/// `--quick`: held-out views and rates.
const QUICK: (usize, usize) = (2, 5);
/// Steps of the paper's fine-tune: about a minute on two cores. The paper takes 8000.
const STEPS: u64 = 400;

impl CurveOptions {
    /// Those of `cargo xtask rd-curve SCENE`, without flags.
    pub(crate) fn of(scene: &str) -> Result<Self> {
        let command = Self::augment_args(clap::Command::new("rd-curve").no_binary_name(true));
        Ok(Self::from_arg_matches(&command.try_get_matches_from([scene])?)?)
    }

    /// Opens the scene.
    pub(crate) fn study(&self) -> Result<Study> {
        let views = self.views.unwrap_or(if self.quick { QUICK.0 } else { usize::MAX });
        ensure!(views > 0, "--views must be at least 1");
        Study::open(&self.scene, views, self.out.as_deref(), self.fresh)
    }

    /// What a newcomer runs shows the best: of the room the tuned curve takes seconds.
    pub(super) fn with_tuned_room(mut self) -> Self {
        let room = self.scene == crate::scenes::DEFAULT && !self.quick;
        self.tune = self.tune.or(room.then_some(TuneEffort::Quick));
        self
    }

    /// The paper's fine-tune, if there is to be one.
    pub(super) fn tuning(&self) -> Option<Tuning> {
        let steps = self.finetune.unwrap_or(if self.quick { 0 } else { STEPS });
        (steps > 0).then_some(Tuning { steps, initialised: true, backend: self.backend })
    }

    fn rates(&self) -> usize {
        self.rates.unwrap_or(if self.quick { QUICK.1 } else { 6 })
    }

    /// Qualities of the encoder, from low to high.
    pub(crate) fn qualities(&self) -> Result<Vec<f32>> {
        let count = self.rates();
        ensure!(count >= 2, "--rates must be at least 2, is {count}");
        Ok((0..count).map(|i| LOW + (HIGH - LOW) * i as f32 / (count - 1) as f32).collect())
    }

    pub(super) fn tuned_qualities(&self) -> Vec<f32> {
        crate::scenes::spread(TUNED_QUALITIES.to_vec(), self.rates())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn criteria_are_read() {
        assert_eq!(criteria("9:14").unwrap(), Strategy::paper(9, 14));
        assert_eq!(criteria("9:14:20:30:0.5").unwrap(), Strategy::paper(9, 14));
        assert_eq!(criteria("released:9").unwrap(), Strategy::Released(ReleasedRule::new(9)));
        for bad in
            ["9", "9:x", "14:9", "9:22", "", "9:14:1", "9:14:200:3:1", "9:14:1:3:NaN", "released:x"]
        {
            assert!(criteria(bad).is_err(), "{bad}");
        }
    }
}
