//! Flags of `cargo xtask rd-curve`.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::{Args as _, FromArgMatches as _};
use tune::TuneEffort;

/// Reads the name of an effort.
fn effort(text: &str) -> Result<TuneEffort, String> {
    let names = TuneEffort::ALL.map(TuneEffort::name).join(", ");
    TuneEffort::named(text).ok_or_else(|| format!("use one of {names}"))
}

/// Parses `LOW:HIGH`, two depths of an octree.
fn depths(text: &str) -> Result<(u8, u8)> {
    let (low, high) = text.split_once(':').context("expected LOW:HIGH, for example 9:14")?;
    let depth = |s: &str| s.parse::<u8>().with_context(|| format!("{s} is not a depth"));
    let (low, high) = (depth(low)?, depth(high)?);
    ensure!(low <= high && high <= 21, "depths must ascend and be at most 21: {low}:{high}");
    Ok((low, high))
}

/// An experiment of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Experiment {
    /// Fig. 6: uniform voxelization at two depths, fine-tuned without initialisation.
    Baseline,
    /// Fig. 7: fine-tuned with and without the initialisation, at two depths.
    Init,
    /// Fig. 8, Table 1: adaptive voxelization against uniform.
    Adaptive,
    /// Fig. 9: against other codecs.
    Sota,
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
    /// Depths of the adaptive octree, LOW:HIGH of the paper's criteria [default: about the uniform depth]
    #[arg(long, value_parser = depths)]
    pub(crate) adaptive: Option<(u8, u8)>,
    /// Fine-tune each voxelized model against the training photos for this many steps [default:
    /// none; experiments: 400]
    #[arg(long, value_name = "STEPS", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) finetune: Option<u64>,
    /// One of the paper's experiments instead of the default curves
    #[arg(long)]
    pub(crate) experiment: Option<Experiment>,
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

/// The first and the last quality of a curve.
const LOW: f32 = 20.0;
const HIGH: f32 = 90.0;
/// `--quick`: held-out views and rates.
const QUICK: (usize, usize) = (2, 5);

impl CurveOptions {
    /// Those of `cargo xtask rd-curve SCENE`, without flags.
    pub(crate) fn of(scene: &str) -> Result<Self> {
        let command = Self::augment_args(clap::Command::new("rd-curve").no_binary_name(true));
        Ok(Self::from_arg_matches(&command.try_get_matches_from([scene])?)?)
    }

    pub(crate) fn views(&self) -> usize {
        self.views.unwrap_or(if self.quick { QUICK.0 } else { usize::MAX })
    }

    /// What a newcomer runs shows the best: of the room the tuned curve takes seconds.
    pub(super) fn with_tuned_room(mut self) -> Self {
        let room = self.scene == crate::scenes::DEFAULT && !self.quick && self.experiment.is_none();
        self.tune = self.tune.or(room.then_some(TuneEffort::Quick));
        self
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
        crate::scenes::spread(super::streams::QUALITIES.to_vec(), self.rates())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_ascend_and_are_possible() {
        assert_eq!(depths("9:14").unwrap(), (9, 14));
        for bad in ["9", "9:x", "14:9", "9:22", ""] {
            assert!(depths(bad).is_err(), "{bad}");
        }
    }
}
