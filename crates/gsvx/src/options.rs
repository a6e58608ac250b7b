//! What an encoder may choose, and the defaults measured best.

use crate::attributes::group::Coding;
use crate::error::{Error, Result};
use crate::slices;
use crate::stream::SectionKind;
use gs_model::Scene;
use std::num::NonZeroUsize;

/// Quantisation steps, in natural units, of a Gaussian of the mean importance class.
///
/// A Gaussian `c` classes above the mean gets steps `2^c` times finer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    /// Of `ln(alpha)`.
    pub opacity: f32,
    /// Of the DC coefficients, luma plane.
    pub dc: f32,
    /// Of the AC coefficients of SH degree 1, 2, 3, luma plane.
    pub sh: [f32; 3],
    /// Factor on the steps of the two chroma planes.
    pub chroma: f32,
    /// Of the six log-Euclidean covariance coordinates (natural logarithms).
    pub covariance: f32,
}

/// How covariances are coded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum CovarianceMode {
    /// Log-Euclidean coordinates through RAHT; the smallest at equal rendered error.
    #[default]
    Transform,
    /// A codebook of `2^bits` normalised covariances and one scale factor per Gaussian.
    Vq {
        /// Binary logarithm of the number of codewords, 8 to 16.
        bits: u8,
    },
    /// Log-scales and quaternions as integers of `bits` bits over each channel's range, coded
    /// without further loss by prediction from neighbours (the paper's lossless mode).
    Lossless {
        /// Bits per integer, 8 to 24; the paper uses 16.
        bits: u8,
    },
}

/// Entropy coder of transformed attributes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Entropy {
    /// Adaptive range coder: [`Entropy::Small`] of fewer than 2^16 leaves or at coarse steps (quality
    /// 40 and below), else [`Entropy::Symbols`].
    #[default]
    Range,
    /// Binary contexts, and prediction from the level above: smallest.
    Small,
    /// One symbol per magnitude, no prediction, and geometry with fewer contexts: 2 % larger, and
    /// decoded in three fifths of the time.
    Symbols,
    /// RLGR, and geometry with fewer contexts: fastest.
    Fast,
    /// RLGR and geometry as small as can be: what the paper names.
    Rlgr,
}

/// Steps of DC from here on, those of quality 40, leave so little to code that two cores decode binary
/// contexts at 1.6 million Gaussians a second; what symbols cost grows from 2 % of a stream to 4 %.
const COARSE: f32 = 0.26;

impl Entropy {
    /// What [`Entropy::Range`] is for a scene of so many leaves with these steps.
    #[must_use]
    pub fn of(self, leaves: usize, steps: &Steps) -> Self {
        match self {
            Self::Range if leaves < slices::TWO || steps.dc >= COARSE => Self::Small,
            Self::Range => Self::Symbols,
            named => named,
        }
    }
}

/// Quantisation parameters of the paper's profile; step `2^((qp - 4) / 6)` in units of a 255th
/// of each channel's range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PaperQp {
    /// Of all AC coefficients; the paper uses 4 to 40.
    pub ac: u8,
    /// Of the DC coefficients; the paper uses 4 to 28.
    pub dc: u8,
    /// Of the opacity logits; the paper uses 4 to 40.
    pub opacity: u8,
}

/// The quantity that opacity is coded as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OpacityDomain {
    /// `ln(alpha)`: an error is relative to alpha.
    #[default]
    LogAlpha,
    /// The trained logit, as the paper does.
    Logit,
    /// `alpha` itself.
    Alpha,
}

/// Options of [`crate::encode`].
#[derive(Clone, Debug, PartialEq)]
pub struct EncodeOptions {
    /// Quantisation steps.
    pub steps: Steps,
    /// Covariance mode.
    pub covariance: CovarianceMode,
    /// Entropy coder.
    pub entropy: Entropy,
    /// Highest SH degree kept; higher ones are dropped. 3 keeps all.
    pub max_sh_degree: u8,
    /// Per Gaussian importance (see [`crate::importance`]), in leaf order; any unit.
    /// `None` uses [`crate::importance::without_cameras`].
    pub importance: Option<Vec<f32>>,
    /// Per Gaussian, in leaf order and any unit: how much a change of its covariance shows, for
    /// the codebook of [`CovarianceMode::Vq`]. From cameras: the squared derivatives of the
    /// pixels. `None` uses the importance.
    pub covariance_sensitivity: Option<Vec<f32>>,
    /// What opacity is coded as.
    pub opacity_domain: OpacityDomain,
    /// Steps by the paper's rule instead of [`EncodeOptions::steps`] (covariance excepted).
    pub paper_qp: Option<PaperQp>,
    /// Code all Gaussians with the same precision: no importance section. The paper does this.
    pub uniform_precision: bool,
    /// Predict SH degrees 2 and 3 from the degree below where it pays; never with [`Entropy::Fast`],
    /// [`Entropy::Rlgr`] or the paper's steps.
    pub sh_prediction: bool,
    /// Gaussians coded bit for bit beside the leaves, such as those of
    /// [`crate::split_outliers`]; the decoder returns them after the leaves, in this order. Of at
    /// most the scene's SH degree; [`EncodeOptions::max_sh_degree`] holds for them too.
    pub outliers: Option<Scene>,
    /// Runs of leaves that are coded apart, on different cores: as many as asked for, of 4096
    /// leaves or more; `None` makes one of fewer than 2^16 leaves, else two or an even number of a
    /// quarter million leaves each. Codebooks,
    /// integers and the paper's steps hold for a whole scene: it has one then.
    pub slices: Option<NonZeroUsize>,
}

impl Default for EncodeOptions {
    fn default() -> Self {
        Self::at(DEFAULT_QUALITY)
    }
}

/// Quality used when none is asked for: visually lossless on the scenes measured.
pub const DEFAULT_QUALITY: f32 = 60.0;

/// Step of the DC planes at quality 0, and the number of quality points that halve it: 0.165 at
/// quality 50, where renders are 35 to 38 dB from those of the input on the scenes measured.
const DC_STEP_AT_ZERO: f32 = 1.66;
const QUALITY_PER_OCTAVE: f32 = 15.0;
/// Steps relative to DC that equalise rendered error per bit (coordinate descent on `fox`,
/// render-to-render error on training views).
const OPACITY_PER_DC: f32 = 0.95;
const AC_PER_DC: f32 = 0.72;
const COVARIANCE_PER_DC: f32 = 1.4;
/// Multipliers of the rate, in 1/256 of `step^2` per bit, that go with them. What rate-distortion
/// optimisation zeroes is missing from every pixel the Gaussian is in, so they are below those of
/// least squared error; 10 points of AC are 0.7 % of a stream.
const LAMBDA: u8 = 18;
const LAMBDA_AC: u8 = 8;
const LAMBDA_COVARIANCE: u8 = 24;

impl EncodeOptions {
    /// Options for a quality from 0 (smallest) to 100 (best).
    ///
    /// Each 15 points halve all steps. The ratios between the attributes are those that
    /// equalise the rendered error per bit on the measured scenes (docs/results/rd.md).
    ///
    /// # Errors
    /// [`Error::Option`] if `quality` is outside 0 to 100 or NaN.
    pub fn from_quality(quality: f32) -> Result<Self> {
        if (0.0..=100.0).contains(&quality) {
            Ok(Self::at(quality))
        } else {
            Err(Error::Option {
                option: "quality",
                value: f64::from(quality),
                range: "between 0 and 100",
            })
        }
    }

    fn at(quality: f32) -> Self {
        let dc = DC_STEP_AT_ZERO * libm::exp2f(-quality / QUALITY_PER_OCTAVE);
        Self {
            steps: Steps::from_dc(dc),
            covariance: CovarianceMode::Transform,
            entropy: Entropy::Range,
            max_sh_degree: 3,
            importance: None,
            covariance_sensitivity: None,
            opacity_domain: OpacityDomain::LogAlpha,
            paper_qp: None,
            uniform_precision: false,
            sh_prediction: true,
            outliers: None,
            slices: None,
        }
    }

    /// Whether SH degrees 2 and 3 are predicted where it pays. It takes a tenth of an encoder's time,
    /// and the degrees one after another: not where speed is what is wanted, nor as the paper does.
    pub(crate) fn predicts_sh(&self) -> bool {
        let small = matches!(self.entropy, Entropy::Range | Entropy::Small | Entropy::Symbols);
        self.sh_prediction && small && self.paper_qp.is_none()
    }

    /// How a section's group is coded.
    pub(crate) fn coding(&self, kind: SectionKind) -> Coding {
        let lambda = match kind {
            SectionKind::Sh1 | SectionKind::Sh2 | SectionKind::Sh3 => LAMBDA_AC,
            SectionKind::Covariance => LAMBDA_COVARIANCE,
            _ => LAMBDA,
        };
        let is_ac = matches!(kind, SectionKind::Sh1 | SectionKind::Sh2 | SectionKind::Sh3);
        let period = if is_ac { 3 } else { u8::MAX };
        Coding { entropy: self.entropy, lambda, period }
    }

    /// The paper's coding choices: unweighted RAHT, RLGR, one QP each for AC, DC and opacity
    /// over min-max normalised channels, logit opacity.
    ///
    /// Where the paper's text and its released code differ, this follows the text (colour is
    /// decorrelated per SH coefficient; everything a decoder needs is counted).
    #[must_use]
    pub fn paper(qp: PaperQp, covariance: CovarianceMode) -> Self {
        Self {
            covariance,
            entropy: Entropy::Rlgr,
            opacity_domain: OpacityDomain::Logit,
            paper_qp: Some(qp),
            uniform_precision: true,
            ..Self::at(DEFAULT_QUALITY)
        }
    }
}

impl PaperQp {
    /// The triple at a quality of 0 to 100: those on the hulls of the authors' published curves,
    /// lowest rate first.
    #[must_use]
    pub fn of_quality(quality: f32) -> Self {
        let (ac, dc, opacity) = match quality {
            q if q < 27.0 => (40, 28, 40),
            q if q < 41.0 => (38, 16, 28),
            q if q < 55.0 => (34, 16, 16),
            q if q < 69.0 => (31, 4, 16),
            q if q < 83.0 => (28, 4, 4),
            _ => (16, 4, 4),
        };
        Self { ac, dc, opacity }
    }

    /// The step of `qp` for a channel: `2^((qp - 4) / 6)` 255ths of its range.
    #[must_use]
    pub fn step(qp: u8, channel: impl IntoIterator<Item = f64>) -> f64 {
        let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
        for v in channel {
            min = min.min(v);
            max = max.max(v);
        }
        let range = if max > min { max - min } else { 1.0 };
        range / 255.0 * libm::exp2((f64::from(qp) - 4.0) / 6.0)
    }
}

impl Steps {
    /// All steps from the DC step, in the default proportions.
    #[must_use]
    pub fn from_dc(dc: f32) -> Self {
        Self {
            opacity: dc * OPACITY_PER_DC,
            dc,
            sh: [dc * AC_PER_DC; 3],
            chroma: 1.0,
            covariance: dc * COVARIANCE_PER_DC,
        }
    }
}
