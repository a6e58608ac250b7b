//! Lossy covariance compression: a codebook designed "based on the relative impact of each Gaussian on the
//! rendered images", an index into it per Gaussian, and a scale factor per Gaussian.

use gpcc_lite::coder::{Coder, RansDecoder, RansEncoder};
use gpcc_lite::model::Bit;
use gpcc_lite::paper::rlgr;
use gpcc_lite::raht::RahtPlan;
use gs_model::Scene;
use vq::{Codebook, default_sensitivity};

use super::DecodedCovariances;
use crate::container::{ContainerReader, put_block};
use crate::error::{Error, Result, coding};
use crate::sh_and_opacity::{decode_channel, encode_channel, finite};

/// Step of the logarithms of the scale factors: as fine as gsvx codes covariances at quality 60.
const LOG_SCALE_FACTOR_STEP: f32 = 0.145;
/// Top bits of an index that are coded in the context of those of the index before.
const TOP_BITS: u32 = 5;
/// Observations that the model of a bit remembers.
const MEMORY: u32 = 160;

const CODEBOOK: &str = "codebook";
const INDICES: &str = "codebook indices";
const FACTORS: &str = "scale factors";

/// Codes the covariances of a scene that has Gaussians, and says how many of the bytes are indices. Without
/// sensitivities, opacity and size stand in.
pub(super) fn encode(
    scene: &Scene,
    plan: &RahtPlan,
    codebook_bits: u8,
    sensitivities: Option<&[f32]>,
) -> Result<(Vec<u8>, usize)> {
    let both = scene.rotations.iter().zip(&scene.log_scales);
    let split: Vec<_> =
        both.map(|(&q, &l)| vq::Covariance::split(q, l)).collect::<Result<_, _>>()?;
    let (covariances, factors): (Vec<_>, Vec<f32>) = split.into_iter().unzip();
    let sensitivity =
        |(&logit, &l): (&f32, &[f32; 3])| default_sensitivity(1.0 / (1.0 + libm::expf(-logit)), l);
    let guess = || scene.opacity_logits.iter().zip(&scene.log_scales).map(sensitivity).collect();
    let sensitivities = sensitivities.map_or_else(guess, <[f32]>::to_vec);
    let book = Codebook::train(&covariances, &sensitivities, 1 << codebook_bits)?;

    let codewords = book.integers();
    let mut out = (codewords.len() as u32).to_le_bytes().to_vec();
    // Neighbours in the codebook are alike.
    for k in 0..6 {
        let mut before = 0;
        let differences = codewords.iter().map(|w| w[k] - std::mem::replace(&mut before, w[k]));
        put_block(&mut out, &rlgr::encode(&differences.collect::<Vec<i32>>()));
    }
    let mut coder = RansEncoder::default();
    code_indices(&mut coder, &mut book.assign(&covariances), codewords.len());
    let before = out.len();
    put_block(&mut out, &coder.finish());
    let indices = out.len() - before;
    let factors = factors.into_iter().map(f64::from).collect();
    out.extend(encode_channel(plan, factors, LOG_SCALE_FACTOR_STEP, FACTORS)?);
    Ok((out, indices))
}

/// Decodes what [`encode`] coded.
pub(super) fn decode(
    mut coded: ContainerReader<'_>,
    plan: &RahtPlan,
) -> Result<DecodedCovariances> {
    let count = u32::from_le_bytes(coded.array(CODEBOOK)?) as usize;
    // Each codeword was trained on a Gaussian of its own.
    if count > plan.len() {
        return Err(Error::Corrupt { what: "more codewords than Gaussians" });
    }
    let mut codewords = vec![[0i32; 6]; count];
    for k in 0..6 {
        let block = coded.block(CODEBOOK)?;
        let mut sum = 0i32;
        let differences = rlgr::decode(block, count).map_err(coding(CODEBOOK))?;
        for (word, difference) in codewords.iter_mut().zip(differences) {
            sum = sum.wrapping_add(difference);
            word[k] = sum;
        }
    }
    let book = Codebook::from_integers(&codewords)?;
    let mut indices = vec![0; plan.len()];
    let mut coder = RansDecoder::new(coded.block(INDICES)?).map_err(coding(INDICES))?;
    code_indices(&mut coder, &mut indices, count);
    coder.finish().map_err(coding(INDICES))?;
    let factors = decode_channel(plan, coded.0, FACTORS)?;
    let covariance = |(index, factor): (u32, f64)| {
        let (rotation, log_scales) = book.decode(index)?;
        Ok((rotation, log_scales.map(|l| finite(f64::from(l) + factor))))
    };
    indices.into_iter().zip(factors).map(covariance).collect()
}

/// Codes one index per leaf, bit by bit from the top. A bit's context is the bits above it and, for the
/// top bits, those of the index before. A decoder fills `indices` in.
fn code_indices<C: Coder>(coder: &mut C, indices: &mut [u32], codewords: usize) {
    let bits = usize::BITS - codewords.saturating_sub(1).leading_zeros();
    let mut top = vec![Bit::default(); 1 << (2 * TOP_BITS)];
    let mut rest = vec![Bit::default(); 1 << bits];
    let mut before = 0usize;
    for index in indices {
        let mut prefix = 0u32;
        for depth in 0..bits {
            let node = 1usize << depth | prefix as usize;
            let model = match depth {
                d if d < TOP_BITS => &mut top[before << TOP_BITS | node],
                _ => &mut rest[node],
            };
            let bit = model.code(coder, *index >> (bits - 1 - depth) & 1 == 1, MEMORY);
            prefix = prefix << 1 | u32::from(bit);
        }
        before = (prefix >> bits.saturating_sub(TOP_BITS)) as usize;
        *index = prefix;
    }
}
