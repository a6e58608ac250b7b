//! The paper's coding as a codec of its own, beside which gsvx is measured.
//!
//! A voxelized scene goes in: one Gaussian per leaf, in leaf order. Its leaves are coded by
//! [`gpcc_lite::geometry`]. Opacity logits and the three colour planes of each SH coefficient go, channel
//! by channel, through RAHT without weights, a quantiser whose step follows from a QP and the channel's
//! range, and RLGR. Covariances are indices into a codebook, or integers without further loss. All that a
//! decoder needs is in the stream and counts, which is more than the paper counts: it leaves out the
//! indices.

mod bytes;
mod channel;
mod covariance;

use anyhow::{Context, Result, ensure};
use gpcc_lite::raht::Plan;
use gpcc_lite::{Limits, geometry};
use gs_model::Scene;
use rayon::prelude::*;
use voxel::{Cube, Voxelization};

use crate::attributes::colour_planes;

pub(crate) use covariance::Covariance;

/// Opacity logits outside this range are moved to its ends: no rasterizer shows the difference.
const LOGITS: [f32; 2] = [-8.0, 12.0];

/// Quantisation parameters. The step is `2^((qp - 4) / 6)` 255ths of each channel's range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PaperQp {
    /// Of all AC coefficients; the paper uses 4 to 40.
    pub(crate) ac: u8,
    /// Of the DC coefficients; the paper uses 4 to 28.
    pub(crate) dc: u8,
    /// Of the opacity logits; the paper uses 4 to 40.
    pub(crate) opacity: u8,
}

/// The paper's coding at one setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PaperChain {
    /// Quantisation parameters.
    pub(crate) qp: PaperQp,
    /// How covariances are coded.
    pub(crate) covariance: Covariance,
}

/// A finished stream.
pub(crate) struct Encoded {
    /// The stream.
    pub(crate) bytes: Vec<u8>,
    /// Bytes by what they are for.
    pub(crate) parts: Vec<(&'static str, u64)>,
}

/// What a channel holds.
#[derive(Clone, Copy)]
enum Channel {
    Opacity,
    /// A plane of an SH coefficient.
    Colour {
        coefficient: usize,
        plane: usize,
    },
}

/// The channels in the order of the stream.
fn channels(sh_degree: u8) -> Vec<Channel> {
    let coefficients = (usize::from(sh_degree) + 1).pow(2);
    let colours =
        (0..3 * coefficients).map(|c| Channel::Colour { coefficient: c / 3, plane: c % 3 });
    std::iter::once(Channel::Opacity).chain(colours).collect()
}

impl Channel {
    fn qp(self, qp: &PaperQp) -> u8 {
        match self {
            Self::Opacity => qp.opacity,
            Self::Colour { coefficient: 0, .. } => qp.dc,
            Self::Colour { .. } => qp.ac,
        }
    }

    fn part(self) -> &'static str {
        match self {
            Self::Opacity => "opacity",
            Self::Colour { coefficient: 0, .. } => "DC",
            Self::Colour { coefficient: 1..4, .. } => "SH degree 1",
            Self::Colour { coefficient: 4..9, .. } => "SH degree 2",
            Self::Colour { .. } => "SH degree 3",
        }
    }

    /// Its values, one per Gaussian.
    fn values(self, scene: &Scene) -> Vec<f64> {
        match self {
            Self::Opacity => {
                let logit = |v: &f32| f64::from(v.clamp(LOGITS[0], LOGITS[1]));
                scene.opacity_logits.iter().map(logit).collect()
            }
            Self::Colour { coefficient, plane } => {
                let value = |i| colour_planes(scene.sh_of(i)[coefficient])[plane];
                (0..scene.len()).map(value).collect()
            }
        }
    }
}

impl PaperChain {
    /// Whether covariances are coded without further loss.
    pub(crate) fn lossless_covariance(&self) -> bool {
        matches!(self.covariance, Covariance::Integers { .. })
    }

    /// Encodes the Gaussians of `scene`, one per leaf of `voxels`. `importance`, one per Gaussian, says
    /// how much an error of each matters to the codebook.
    ///
    /// # Errors
    /// If scene and leaves do not go together, or a value is not finite.
    pub(crate) fn encode(
        &self,
        scene: &Scene,
        voxels: &Voxelization,
        importance: &[f32],
    ) -> Result<Encoded> {
        let n = scene.len();
        ensure!(n == voxels.len(), "{n} Gaussians for {} leaves", voxels.len());
        let leaves = voxels.octree().leaves().as_slice();
        let plan = Plan::new(leaves, voxels.octree().depth())?;
        let mut out = vec![scene.sh_degree];
        for v in voxels.octree().cube().origin.into_iter().chain([voxels.octree().cube().side]) {
            out.extend(v.to_le_bytes());
        }
        let mut parts = vec![("head", out.len() as u64)];
        let mut add = |part: &'static str, bytes: &[u8]| {
            let before = out.len();
            bytes::put_block(&mut out, bytes);
            let size = (out.len() - before) as u64;
            match parts.last_mut() {
                Some((last, sum)) if *last == part => *sum += size,
                _ => parts.push((part, size)),
            }
        };
        add("geometry", &geometry::encode(leaves, voxels.octree().depth())?);
        let all = channels(scene.sh_degree);
        let code = |c: &Channel| {
            let values = c.values(scene);
            let step = channel::step(c.qp(&self.qp), &values);
            channel::encode(&plan, values, step)
        };
        let coded: Vec<Vec<u8>> = all.par_iter().map(code).collect::<Result<_>>()?;
        all.iter().zip(&coded).for_each(|(channel, bytes)| add(channel.part(), bytes));
        add(
            "covariance",
            &self.covariance.encode(scene, &plan, voxels.octree().depth(), importance)?,
        );
        Ok(Encoded { bytes: out, parts })
    }
}

/// Decodes a stream of [`PaperChain::encode`].
///
/// # Errors
/// If the stream is cut off or damaged.
pub(crate) fn decode(bytes: &[u8]) -> Result<Scene> {
    let mut rest = bytes;
    let &sh_degree = rest.split_off_first().context("no SH degree")?;
    ensure!(sh_degree <= 3, "SH degree {sh_degree}");
    let mut number = || Ok::<_, anyhow::Error>(f64::from_le_bytes(bytes::array(&mut rest)?));
    let cube = Cube { origin: [number()?, number()?, number()?], side: number()? };
    let limits = Limits::for_stream(bytes.len());
    let shape = geometry::decode(bytes::block(&mut rest)?, &limits).context("geometry")?;
    let plan = Plan::new(&shape.leaves, shape.j_high)?;
    let all = channels(sh_degree);
    let blocks: Vec<&[u8]> =
        all.iter().map(|_| bytes::block(&mut rest)).collect::<Result<_>>().context("channels")?;
    let values: Vec<Vec<f64>> =
        blocks.par_iter().map(|b| channel::decode(&plan, b)).collect::<Result<_>>()?;
    let (rotations, log_scales) =
        covariance::decode(bytes::block(&mut rest)?, &plan, shape.j_high).context("covariance")?;
    let colour = |i: usize, k: usize| {
        channel::colour(std::array::from_fn(|plane| values[1 + 3 * k + plane][i]))
    };
    let k = (usize::from(sh_degree) + 1).pow(2);
    Ok(Scene {
        means: shape.leaves.iter().map(|&l| cube.leaf_centre(l, shape.j_high)).collect(),
        rotations,
        log_scales,
        opacity_logits: values[0].iter().map(|&v| v as f32).collect(),
        sh_degree,
        sh: (0..shape.leaves.len() * k).map(|i| colour(i / k, i % k)).collect(),
    })
}

#[cfg(test)]
mod tests;
