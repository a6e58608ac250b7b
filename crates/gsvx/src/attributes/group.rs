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

    /// Codes channels (leaf order) with one natural step each.
    ///
    /// # Errors
    /// [`Error::Coding`].
    pub fn encode(
        &self,
        channels: &[Vec<f64>],
        steps: &[f64],
        entropy: Entropy,
    ) -> Result<Vec<u8>> {
        let fixed: Vec<Vec<i32>> =
            channels.iter().map(|c| c.iter().map(|&v| to_fixed(v)).collect()).collect();
        let views: Vec<&[i32]> = fixed.iter().map(Vec::as_slice).collect();
        let steps: Vec<Step> =
            steps.iter().map(|&s| Step::new(s * self.step_factor * UNITS)).collect();
        let mode = match entropy {
            Entropy::Range => Mode::Range,
            Entropy::Rlgr => Mode::Rlgr,
        };
        // RLGR is the fast mode; prediction from the parent level costs more than it does.
        let prediction = entropy == Entropy::Range;
        let options =
            attribute::Options { mode, prediction, reconstruction: false, ..Default::default() };
        let coded = attribute::encode(&self.plan, &views, &steps, &options);
        Ok(coded.map_err(coding("attribute"))?.bytes)
    }

    /// Decodes exactly `channels` channels.
    ///
    /// # Errors
    /// [`Error::Coding`]; [`Error::Corrupt`] if the stream holds another number of channels.
    pub fn decode(&self, bytes: &[u8], channels: usize) -> Result<Vec<Vec<f64>>> {
        let fixed = attribute::decode(&self.plan, bytes, channels).map_err(coding("attribute"))?;
        if fixed.len() != channels {
            return Err(Error::Corrupt { what: "channel count", value: fixed.len() as u64 });
        }
        Ok(fixed
            .iter()
            .map(|c| c.iter().map(|&v| f64::from(v) * (1.0 / UNITS)).collect())
            .collect())
    }
}

/// Nearest multiple of 2^-16; clamps, NaN gives 0.
fn to_fixed(v: f64) -> i32 {
    libm::round(v * UNITS) as i32
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
