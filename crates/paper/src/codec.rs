//! Section 2.2: the codec as a whole. Voxelized Gaussians go in; positions, opacity and SH coefficients, and
//! covariances are coded one after the other.

use gpcc_lite::raht::RahtPlan;
use gpcc_lite::{Limits, Octree};
use gs_model::Scene;

use crate::container::{ContainerReader, ContainerWriter};
use crate::covariance::{self, CovarianceCoding};
use crate::error::{Error, Result};
use crate::positions;
use crate::sh_and_opacity::{self, Qp};

/// What a stream is coded with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PaperOptions {
    /// Quantisation parameters.
    pub qp: Qp,
    /// How covariances are coded.
    pub covariance: CovarianceCoding,
}

/// A finished stream.
#[derive(Clone, Debug)]
pub struct PaperStream {
    /// The stream.
    pub bytes: Vec<u8>,
    /// Bytes by what they are for, in the order of the stream; `codebook indices` are inside `covariance`.
    pub parts: Vec<(&'static str, u64)>,
}

/// Encodes a voxelized scene: one Gaussian per leaf of `octree`, in leaf order, at the leaf's centre.
///
/// `sensitivities`, one per Gaussian, finite and >= 0, say how much an error of each matters to the
/// codebook of covariances, for example how much it shows in the training views. Without them opacity and
/// size stand in.
///
/// # Errors
/// [`Error::Scene`], [`Error::NotVoxelized`], [`Error::Option`]; [`Error::Codebook`] if sensitivities do not
/// fit the scene or a log-scale is beyond ±1e4.
pub fn encode(
    scene: &Scene,
    octree: &Octree,
    sensitivities: Option<&[f32]>,
    options: &PaperOptions,
) -> Result<PaperStream> {
    let PaperOptions { qp, covariance } = options;
    qp.check()?;
    covariance.check()?;
    scene.validate()?;
    check_means(scene, octree)?;
    let plan = RahtPlan::new(octree.clone());
    let mut out = ContainerWriter::new(scene.sh_degree, scene.antialiased);
    positions::encode(octree, &mut out)?;
    sh_and_opacity::encode(scene, &plan, qp, &mut out)?;
    let (covariances, indices) = covariance.encode(scene, &plan, sensitivities)?;
    out.block("covariance", &covariances);
    let ContainerWriter { bytes, mut parts } = out;
    if let Some((_, rest)) = parts.last_mut().filter(|_| indices > 0) {
        *rest -= indices as u64;
        parts.push(("codebook indices", indices as u64));
    }
    Ok(PaperStream { bytes, parts })
}

fn check_means(scene: &Scene, octree: &Octree) -> Result<()> {
    let (gaussians, leaves) = (scene.len(), octree.len());
    let shared = gaussians.min(leaves);
    let moved = (0..shared).find(|&i| scene.means[i] != octree.centre(i));
    match moved.or((gaussians != leaves).then_some(shared)) {
        Some(index) => Err(Error::NotVoxelized { index, gaussians, leaves }),
        None => Ok(()),
    }
}

/// Decodes a stream of [`encode`] that holds at most 4 Gaussians a byte and 65 536 more. The scene is valid.
///
/// # Errors
/// [`Error::Signature`], [`Error::Truncated`], [`Error::Corrupt`], [`Error::Coding`], [`Error::Codebook`].
pub fn decode(bytes: &[u8]) -> Result<Scene> {
    let max_points = bytes.len().saturating_mul(4).saturating_add(1 << 16);
    decode_within(bytes, &Limits { max_points })
}

/// As [`decode`], with a limit of the caller's on the number of Gaussians. Memory is proportional to it, about
/// 500 bytes a Gaussian, whatever the stream claims.
///
/// # Errors
/// As [`decode`].
pub fn decode_within(bytes: &[u8], limits: &Limits) -> Result<Scene> {
    let (mut input, sh_degree, antialiased) = ContainerReader::open(bytes)?;
    let octree = positions::decode(&mut input, limits)?;
    let means = (0..octree.len()).map(|i| octree.centre(i)).collect();
    let plan = RahtPlan::new(octree);
    let (opacity_logits, sh) = sh_and_opacity::decode(&mut input, &plan, sh_degree)?;
    let coded = input.block("covariance")?;
    let (rotations, log_scales) = covariance::decode(coded, &plan)?;
    input.finish()?;
    let empty = Scene { sh_degree, antialiased, ..Scene::default() };
    Ok(Scene { means, rotations, log_scales, opacity_logits, sh, ..empty })
}
