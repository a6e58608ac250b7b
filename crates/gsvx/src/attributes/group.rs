//! A group of real-valued channels through weighted RAHT, as fixed-point integers.
//!
//! Values enter the transform in units of 2^-16 and are clamped to what `i32` holds (about
//! +-32768), far beyond any trained attribute.

use crate::error::{Error, Result};
use crate::importance;
use crate::options::Entropy;
use gpcc_lite::attribute;
use gpcc_lite::coeffs::Mode;
use gpcc_lite::quant::Step;
use gpcc_lite::raht::Plan;
use gpcc_lite::{Leaf, Limits};

/// Units of the fixed-point values per natural unit.
const UNITS: f64 = 65536.0;
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
        let (plan, step_factor) = match classes {
            Some(classes) => {
                let weights: Vec<u32> = classes.iter().map(|&c| importance::weight(c)).collect();
                (Plan::with_weights(leaves, j_high, &weights), STEP_OF_WEIGHT_ONE)
            }
            None => (Plan::new(leaves, j_high), 1.0),
        };
        Ok(Self { plan: plan.map_err(coding("transform"))?, step_factor })
    }

    /// Codes channels with one natural step each. `channel(i)` makes channel `i`, one value per
    /// leaf; it is asked in order and its answer soon dropped, so that a group of many channels
    /// needs the memory of a few. Also says whether all of it came out as zero.
    ///
    /// # Errors
    /// [`Error::Coding`].
    pub fn encode(
        &self,
        steps: &[f64],
        entropy: Entropy,
        channel: impl FnMut(usize) -> Vec<i32>,
    ) -> Result<(Vec<u8>, bool)> {
        let o = options(entropy);
        let coded = attribute::encode_with(&self.plan, &self.steps(steps), &o, channel);
        coded.map_err(coding("attribute"))
    }

    /// As [`Transform::encode`] for a single channel; also returns what the decoder will read.
    ///
    /// # Errors
    /// [`Error::Coding`].
    pub fn encode_one(
        &self,
        channel: &[i32],
        step: f64,
        entropy: Entropy,
    ) -> Result<(Vec<u8>, Vec<i32>)> {
        let coded =
            attribute::encode(&self.plan, &[channel], &self.steps(&[step]), &options(entropy));
        let mut coded = coded.map_err(coding("attribute"))?;
        Ok((coded.bytes, coded.reconstruction.pop().unwrap_or_default()))
    }

    fn steps(&self, steps: &[f64]) -> Vec<Step> {
        steps.iter().map(|&s| Step::new(s * self.step_factor * UNITS)).collect()
    }

    /// Decodes exactly `channels` channels: `channel(i, values)` is called for each, in order.
    ///
    /// # Errors
    /// [`Error::Coding`]; [`Error::Corrupt`] if the stream holds another number of channels.
    pub fn decode_with(
        &self,
        bytes: &[u8],
        channels: usize,
        channel: impl FnMut(usize, Vec<i32>),
    ) -> Result<()> {
        let n = attribute::decode_with(&self.plan, bytes, channels, channel)
            .map_err(coding("attribute"))?;
        if n != channels {
            return Err(Error::Corrupt { what: "channel count", value: n as u64 });
        }
        Ok(())
    }

    /// As [`Transform::decode_with`], all channels at once.
    ///
    /// # Errors
    /// As [`Transform::decode_with`].
    pub fn decode(&self, bytes: &[u8], channels: usize) -> Result<Vec<Vec<i32>>> {
        let mut all = Vec::new();
        self.decode_with(bytes, channels, |_, values| all.push(values))?;
        Ok(all)
    }
}

fn options(entropy: Entropy) -> attribute::Options {
    let mode = match entropy {
        Entropy::Range => Mode::Range,
        Entropy::Rlgr => Mode::Rlgr,
    };
    // RLGR is the fast mode; prediction from the parent level costs more than it does.
    let prediction = entropy == Entropy::Range;
    attribute::Options { mode, prediction, ..Default::default() }
}

/// Nearest multiple of 2^-16, as an integer of that unit; clamps, NaN gives 0.
#[must_use]
pub fn to_fixed(v: f64) -> i32 {
    libm::round(v * UNITS) as i32
}

/// The value of a fixed-point integer.
#[must_use]
pub fn from_fixed(v: i32) -> f64 {
    f64::from(v) * (1.0 / UNITS)
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
