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
    /// loss, each predicted from its neighbours.
    Lossless,
}

/// The first byte of the block of covariances.
const LOSSY: u8 = 0;
const LOSSLESS: u8 = 1;

/// Rotations and log-scales.
pub(crate) type DecodedCovariances = (Vec<[f32; 4]>, Vec<[f32; 3]>);

/// The authors' codebook, and how many Gaussians each codeword has in a smaller scene: what costs the fewest bytes at
/// equal quality in a scene of 11,001.
const CODEBOOK_BITS: u32 = 12;
const GAUSSIANS_PER_CODEWORD: usize = 8;

impl CovarianceCoding {
    /// A codebook that pays for itself: the authors' 12 bits, and fewer for scenes of less than 32768 Gaussians.
    #[must_use]
    pub fn codebook_for(gaussians: usize) -> Self {
        let fitting = (gaussians / GAUSSIANS_PER_CODEWORD).max(1).ilog2();
        Self::Lossy { codebook_bits: fitting.min(CODEBOOK_BITS) as u8 }
    }

    pub(crate) fn check(self) -> Result<()> {
        match self {
            Self::Lossy { codebook_bits: value @ 21.. } => {
                Err(Error::Option { name: "codebook_bits", value, range: "0 to 20" })
            }
            _ => Ok(()),
        }
    }

    /// The covariances of the Gaussians of `scene`, at the leaves of `plan`, and how many of the bytes are indices.
    pub(crate) fn encode(
        self,
        scene: &Scene,
        plan: &RahtPlan,
        sensitivities: Option<&[f32]>,
    ) -> Result<(Vec<u8>, usize)> {
        let mode = if self == Self::Lossless { LOSSLESS } else { LOSSY };
        let mut out = vec![mode];
        let (coded, indices) = match self {
            _ if scene.is_empty() => (Vec::new(), 0),
            Self::Lossy { codebook_bits } => {
                lossy::encode(scene, plan, codebook_bits, sensitivities)?
            }
            Self::Lossless => (lossless::encode(scene, plan.octree())?, 0),
        };
        out.extend(coded);
        Ok((out, indices))
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
