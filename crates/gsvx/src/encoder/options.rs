//! What an encoder may choose, and the defaults measured best.

use crate::error::{Error, Result};
use crate::head::Steps;
use std::num::NonZeroUsize;

/// Which cells of the octree become leaves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Leaves {
    /// Those that cost the fewest bits at the distortion that the quality allows.
    #[default]
    RateDistortion,
    /// All occupied cells at one depth (the paper's section 3.1).
    Uniform {
        /// From 0 to 21.
        depth: u8,
    },
    /// The paper's criteria (section 3.2.2), with the thresholds of its authors' code.
    Paper {
        /// Lowest depth, from 0 to `j_high`.
        j_low: u8,
        /// Highest depth, up to 21.
        j_high: u8,
    },
}

/// Where importances come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum ImportanceFrom {
    /// Visibility, the rasterizer's sum of squared blending weights over cameras, and something of what they hardly
    /// see: see [`crate::importance::with_unseen`]. What is too little to pay for its bits is left out.
    Cameras,
    /// The same from cameras that show all that counts: what they hardly see is left out.
    CamerasAlone,
    /// [`crate::importance::without_cameras`]: a guess, on which nothing is left out.
    Guess,
}

impl ImportanceFrom {
    /// The source, if importances come from cameras or not.
    #[must_use]
    pub(crate) fn of(by_cameras: bool, drop_unseen: bool) -> Self {
        match (by_cameras, drop_unseen) {
            (false, _) => Self::Guess,
            (true, false) => Self::Cameras,
            (true, true) => Self::CamerasAlone,
        }
    }
}

/// The greatest error of each attribute, as a bound or as measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaxError {
    /// Distance of a mean from where it was, in standard deviations along the Gaussian's longest axis.
    pub mean: f32,
    /// Of an opacity, from 0 to 1.
    pub opacity: f32,
    /// Frobenius norm of the difference of the matrices `R diag(log-scales) R^T`: no log-scale is off by
    /// more, and an axis that is `r` times as long as another turns towards it by at most about
    /// `shape / (1.4 ln r)`.
    pub shape: f32,
    /// Of an SH coefficient, DC included.
    pub sh: f32,
}

impl Leaves {
    /// By rate and distortion without a depth, uniform at a depth alone, and by the paper's criteria from `j_low` on.
    #[must_use]
    pub fn of_depths(depth: Option<u8>, j_low: Option<u8>) -> Self {
        match (depth, j_low) {
            (Some(depth), Some(j_low)) => Self::Paper { j_low: j_low.min(depth), j_high: depth },
            (Some(depth), None) => Self::Uniform { depth },
            (None, _) => Self::RateDistortion,
        }
    }
}

impl MaxError {
    /// The same number for all attributes.
    #[must_use]
    pub fn all(error: f32) -> Self {
        Self { mean: error, opacity: error, shape: error, sh: error }
    }

    /// Whether all are bounds that an encoder takes: from 1e-6 to 1000.
    ///
    /// # Errors
    /// [`Error::Option`] names one that is not.
    pub fn check(&self) -> Result<()> {
        let all = [
            ("bound on the mean", self.mean),
            ("bound on the opacity", self.opacity),
            ("bound on the shape", self.shape),
            ("bound on SH coefficients", self.sh),
        ];
        match all.into_iter().find(|(_, v)| !(1e-6..=1e3).contains(v)) {
            Some((option, v)) => {
                Err(Error::Option { option, value: v.into(), range: "from 1e-6 to 1000" })
            }
            None => Ok(()),
        }
    }
}

/// What becomes of a model before it is coded: see [`crate::prepare`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PrepareOptions {
    /// Which cells of the octree become leaves.
    pub leaves: Leaves,
    /// Fraction of the Gaussians that is left out first, those of least importance; from 0 to below 1.
    pub prune: f64,
    /// With importances from cameras: leave out what they see too little of to pay for its bits, and above all what
    /// they do not see. Otherwise the most prominent part of that is kept, coarsely
    /// ([`crate::importance::with_unseen`]).
    pub drop_unseen: bool,
}

/// How leaves are coded: see [`crate::encode_voxels`].
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CodeOptions {
    /// Highest SH degree kept; higher ones are dropped. 3 keeps all.
    pub max_sh_degree: u8,
    /// Code all Gaussians with the same precision, as the paper does.
    pub uniform_precision: bool,
    /// Store coarser levels of detail in front of the finest.
    pub lod: bool,
    /// Most leaves of a chunk. Smaller chunks cost bytes, since each learns its statistics anew; larger ones
    /// cost memory, and fewer of them can be decoded at once.
    pub chunk_leaves: NonZeroUsize,
}

/// What becomes of a model, and how its leaves are coded: see [`crate::encode`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EncodeOptions {
    /// What becomes of the model before it is coded.
    pub prepare: PrepareOptions,
    /// How leaves are coded.
    pub code: CodeOptions,
}

/// Leaves of a chunk for the web: a page shows it, and a worker holds it, at once.
const WEB_CHUNK: NonZeroUsize = NonZeroUsize::MIN.saturating_add((1 << 14) - 1);

/// Leaves of a chunk by default.
const CHUNK_LEAVES: NonZeroUsize = NonZeroUsize::MIN.saturating_add((1 << 15) - 1);

impl Default for CodeOptions {
    fn default() -> Self {
        Self { max_sh_degree: 3, uniform_precision: false, lod: false, chunk_leaves: CHUNK_LEAVES }
    }
}

impl CodeOptions {
    /// Makes what a web page wants: a coarse scene first, and small chunks. The quality for it is that of
    /// [`crate::Preset::WEB`].
    pub fn for_web(&mut self) {
        self.lod = true;
        self.chunk_leaves = WEB_CHUNK;
    }
}

/// Quality used when none is asked for: the least at which nobody should see a difference, on the models that
/// `cargo xtask bench-quality` measures.
pub const DEFAULT_QUALITY: f32 = 80.0;

/// Step of the DC planes at quality 0, and the number of quality points that halve it: 0.165 at
/// quality 50, where renders are 35 to 38 dB from those of the input on the scenes measured.
const DC_STEP_AT_ZERO: f32 = 1.66;
pub(super) const QUALITY_PER_OCTAVE: f32 = 15.0;
/// Steps relative to DC that equalise rendered error per bit (coordinate descent on `fox`,
/// render-to-render error on training views).
const OPACITY_PER_DC: f32 = 0.95;
const SH_PER_DC: f32 = 0.72;
const COVARIANCE_PER_DC: f32 = 1.4;

impl Steps {
    /// The steps of a quality from 0 (smallest) to 100 (best). Each 15 points halve all steps.
    ///
    /// # Errors
    /// [`Error::Option`] if `quality` is outside 0 to 100 or NaN.
    pub fn of_quality(quality: f32) -> Result<Self> {
        if (0.0..=100.0).contains(&quality) {
            return Ok(Self::from_dc(DC_STEP_AT_ZERO * libm::exp2f(-quality / QUALITY_PER_OCTAVE)));
        }
        let (value, range) = (f64::from(quality), "between 0 and 100");
        Err(Error::Option { option: "quality", value, range })
    }

    /// All steps from the DC step, in the default proportions.
    pub(crate) fn from_dc(dc: f32) -> Self {
        Self {
            opacity: dc * OPACITY_PER_DC,
            dc,
            sh: [dc * SH_PER_DC; 3],
            covariance: dc * COVARIANCE_PER_DC,
        }
    }
}
