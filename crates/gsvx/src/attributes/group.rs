//! A group of real-valued channels through weighted RAHT.
//!
//! Values enter the transform in units of 2^-16, in single precision.

use crate::error::{Error, Result};
use crate::importance;
use crate::options::Entropy;
use gpcc_lite::attribute::{self, EncodedRows, Rows};
use gpcc_lite::coeffs::Mode;
use gpcc_lite::quant::Step;
use gpcc_lite::raht::Plan;
use gpcc_lite::{Leaf, Limits};
use std::sync::Arc;

/// Units of the transform's values per natural unit.
pub(crate) const UNITS: f64 = 65536.0;
/// Effective step of a class is `step / 2^(class - MEAN_CLASS)`; RAHT's step is that of weight 1.
const STEP_OF_WEIGHT_ONE: f64 = (1u32 << importance::MEAN_CLASS) as f64;

/// A transform plan and the factor from natural steps to transform steps.
#[derive(Debug)]
pub struct Transform {
    plan: Plan,
    step_factor: f64,
}

impl Transform {
    /// The transform of `leaves`, weighted by importance class where classes are given.
    ///
    /// # Errors
    /// [`Error::Coding`] if the leaves are not a valid pruned octree.
    pub fn new(leaves: &[Leaf], j_high: u8, classes: Option<&[u8]>) -> Result<Self> {
        let plain = Self::of(leaves.to_vec(), j_high)?;
        match classes {
            Some(classes) => plain.weighted(classes),
            None => Ok(plain),
        }
    }

    /// The transform of `leaves` without weights and without a copy of them.
    pub(crate) fn of(leaves: impl Into<Arc<Vec<Leaf>>>, j_high: u8) -> Result<Self> {
        let plan = Plan::of(leaves, j_high).map_err(coding("transform"))?;
        Ok(Self { plan, step_factor: 1.0 })
    }

    /// The leaves.
    pub(crate) fn leaves(&self) -> &[Leaf] {
        self.plan.leaves()
    }

    /// The leaves, of a transform that is not needed any more.
    pub(crate) fn into_leaves(self) -> Vec<Leaf> {
        self.plan.into_leaves()
    }

    /// The same weighted by importance class.
    ///
    /// # Errors
    /// [`Error::Coding`] if the classes are not one per leaf.
    pub fn weighted(self, classes: &[u8]) -> Result<Self> {
        let weights: Vec<u32> = classes.iter().map(|&c| importance::weight(c)).collect();
        let plan = self.plan.weighted(&weights).map_err(coding("transform"))?;
        Ok(Self { plan, step_factor: STEP_OF_WEIGHT_ONE })
    }

    /// Number of leaves.
    pub(crate) fn len(&self) -> usize {
        self.plan.len()
    }

    /// Codes channels with one natural step each. `leaf(i, row)` fills in the values of leaf `i`,
    /// one per step; it is called for all leaves in order. Also says whether all of it came out as
    /// zero.
    ///
    /// # Errors
    /// [`Error::Coding`].
    pub fn encode(
        &self,
        steps: &[f64],
        how: Coding,
        leaf: impl FnMut(usize, &mut [f64]),
    ) -> Result<(Vec<u8>, bool)> {
        let coded = self.encode_rows(steps, how, false, leaf)?;
        Ok((coded.bytes, coded.all_zero))
    }

    /// As [`Transform::encode`], with what [`Transform::decode_rows`] will return if it is `wanted`.
    pub(crate) fn encode_rows(
        &self,
        steps: &[f64],
        how: Coding,
        wanted: bool,
        mut leaf: impl FnMut(usize, &mut [f64]),
    ) -> Result<EncodedRows> {
        let o = attribute::Options { reconstruction: wanted, ..how.options(steps.len()) };
        let mut values = vec![0.0; steps.len()];
        let scaled = move |i: usize, row: &mut [f32]| {
            leaf(i, &mut values);
            for (out, v) in row.iter_mut().zip(&values) {
                *out = (v * UNITS) as f32;
            }
        };
        let coded = attribute::encode_with(&self.plan, &self.steps(steps), &o, scaled);
        coded.map_err(coding("attribute"))
    }

    fn steps(&self, steps: &[f64]) -> Vec<Step> {
        steps.iter().map(|&s| Step::new(s * self.step_factor * UNITS)).collect()
    }

    /// Decodes exactly `channels` channels: `leaf(i, row)` is called for all leaves in order, with
    /// one value per channel.
    ///
    /// # Errors
    /// [`Error::Coding`]; [`Error::Corrupt`] if the stream holds another number of channels.
    pub fn decode(
        &self,
        bytes: &[u8],
        channels: usize,
        mut leaf: impl FnMut(usize, &[f64]),
    ) -> Result<()> {
        let mut values = vec![0.0; channels];
        let n = attribute::decode_with(&self.plan, bytes, channels, |i, row| {
            for (out, &v) in values.iter_mut().zip(row) {
                *out = f64::from(v) * (1.0 / UNITS);
            }
            leaf(i, &values);
        })
        .map_err(coding("attribute"))?;
        if n != channels {
            return Err(Error::Corrupt { what: "channel count", value: n as u64 });
        }
        Ok(())
    }

    /// As [`Transform::decode`], into `rows`, in units of the transform ([`UNITS`]).
    pub(crate) fn decode_rows(&self, bytes: &[u8], channels: usize, rows: &mut Rows) -> Result<()> {
        attribute::decode_rows(&self.plan, bytes, channels, rows).map_err(coding("attribute"))?;
        if rows.channels() != channels {
            return Err(Error::Corrupt { what: "channel count", value: rows.channels() as u64 });
        }
        Ok(())
    }
}

/// How the encoder quantises and codes a group.
#[derive(Clone, Copy, Debug)]
pub struct Coding {
    /// Entropy coder, [resolved](Entropy::of).
    pub entropy: Entropy,
    /// See [`attribute::Options::lambda`]; the paper's profile has the coder's default.
    pub lambda: u8,
    /// See [`attribute::Options::period`].
    pub period: u8,
}

impl Coding {
    /// The entropy coder of groups.
    pub(crate) fn mode(self) -> Mode {
        match self.entropy {
            Entropy::Small => Mode::Range,
            Entropy::Range | Entropy::Symbols => Mode::Symbols,
            Entropy::Fast | Entropy::Rlgr => Mode::Rlgr,
        }
    }

    fn options(self, channels: usize) -> attribute::Options {
        let o = attribute::Options {
            // A channel on its own is 4 to 8 % smaller by the means of its nodes, which are coded by
            // binary contexts: 0.3 % of a stream for 4 % of a decoder's time.
            mode: match self.mode() {
                Mode::Symbols if channels == 1 => Mode::Range,
                mode => mode,
            },
            // Prediction from the level above takes a sixth of a decoder's time.
            prediction: self.mode() == Mode::Range,
            // Leaves are as deep as it takes to tell Gaussians apart, which then have little in
            // common.
            fine_prediction: false,
            by_means: true,
            period: self.period,
            ..Default::default()
        };
        match self.entropy {
            Entropy::Rlgr => o,
            // A pixel is a sum of Gaussians: 0.9 % fewer bytes at equal rendered error.
            _ => attribute::Options { lambda: self.lambda, centres: true, ..o },
        }
    }
}

/// Wraps an error of the coder with the part it happened in.
pub fn coding(what: &'static str) -> impl Fn(gpcc_lite::Error) -> Error {
    move |source| Error::Coding { what, source }
}

/// Limits for a stream that claims `count` Gaussians.
#[must_use]
pub fn limits(count: u64) -> Limits {
    Limits { max_points: usize::try_from(count).unwrap_or(usize::MAX) }
}
