//! Section 2.3, covariances: "represented by a quaternion vector and a scale vector", and coded either
//! lossy, by vector quantisation, or lossless.

mod lossless;
mod lossy;

use gpcc_lite::raht::RahtPlan;
use gs_model::Scene;

use crate::container::ContainerReader;
use crate::error::{Error, Result};

/// How covariances are coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CovarianceCoding {
    /// Vector quantisation: an index into a codebook of `2^codebook_bits` normalised covariances, and a
    /// scale factor. The authors use 12.
    Lossy {
        /// Binary logarithm of the number of codewords, 0 to 20.
        codebook_bits: u8,
    },
    /// Quaternions and log-scales as integers of 16 bits over each component's range, and these without
    /// loss by predictive lifting.
    Lossless,
}

/// The first byte of the block of covariances.
const LOSSY: u8 = 0;
const LOSSLESS: u8 = 1;

/// Rotations and log-scales.
pub(crate) type DecodedCovariances = (Vec<[f32; 4]>, Vec<[f32; 3]>);

impl CovarianceCoding {
    pub(crate) fn check(self) -> Result<()> {
        match self {
            Self::Lossy { codebook_bits: value @ 21.. } => {
                Err(Error::Option { name: "codebook_bits", value, range: "0 to 20" })
            }
            _ => Ok(()),
        }
    }

    /// The covariances of the Gaussians of `scene`, at the leaves of `plan`.
    pub(crate) fn encode(
        self,
        scene: &Scene,
        plan: &RahtPlan,
        sensitivities: Option<&[f32]>,
    ) -> Result<Vec<u8>> {
        let mode = if self == Self::Lossless { LOSSLESS } else { LOSSY };
        let mut out = vec![mode];
        out.extend(match self {
            _ if scene.is_empty() => Vec::new(),
            Self::Lossy { codebook_bits } => {
                lossy::encode(scene, plan, codebook_bits, sensitivities)?
            }
            Self::Lossless => lossless::encode(scene, plan.octree())?,
        });
        Ok(out)
    }
}

/// Decodes what [`CovarianceCoding::encode`] coded.
pub(crate) fn decode(coded: &[u8], plan: &RahtPlan) -> Result<DecodedCovariances> {
    let mut coded = ContainerReader(coded);
    let mode = coded.array("covariance")?;
    match mode {
        _ if plan.is_empty() => Ok(DecodedCovariances::default()),
        [LOSSY] => lossy::decode(coded, plan),
        [LOSSLESS] => lossless::decode(coded, plan.octree()),
        _ => Err(Error::Corrupt { what: "covariance mode" }),
    }
}
