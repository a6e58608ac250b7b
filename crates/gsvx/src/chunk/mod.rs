//! One chunk of leaves: its layers as bytes, and its Gaussians.
//!
//! A chunk is a run of leaves in Morton order with an octree, transforms and models of its own, so it
//! needs nothing but the header. Its first layer makes a picture; each SH degree is a further layer.
//! Normative description: `docs/format.md`, "Base layer" and "SH layers".

mod decode;
#[cfg(feature = "encode")]
mod encode;
mod gaussians;
#[cfg(feature = "encode")]
mod latents;

pub(crate) use decode::ChunkDecoder;
#[cfg(feature = "encode")]
pub(crate) use encode::{ChunkInput, Quantisation, check, check_sh, encode};
pub(crate) use gaussians::{GaussiansMut, resize};
#[cfg(feature = "encode")]
pub use latents::Transform;
#[cfg(feature = "encode")]
pub(crate) use latents::{ChunkLatents, Coding, LAMBDA, Values};

use crate::attributes::side::Factors;
use crate::importance;

/// Step of the importance classes: coarse, since the exact class matters little, and what is saved
/// here is saved for every Gaussian.
const CLASS_STEP: f32 = 1.0;

/// The transform's step, which is for weight 1, from that of the header, which is for the mean class.
pub(crate) fn step_of_unit_weight(step: f32) -> f32 {
    step * f32::from(1u16 << importance::MEAN_CLASS)
}

/// Steps of the transform for a group of channels.
fn steps_of(step: f32, channels: usize) -> Vec<f32> {
    vec![step_of_unit_weight(step); channels]
}

/// What is predicted from the depth and class of each leaf.
#[derive(Clone, Copy, Debug, Default)]
struct SideFactors {
    importance: Factors,
    opacity: Factors,
    /// Of the trace of the log-scales.
    size: Factors,
}

impl SideFactors {
    const LEN: usize = 5;

    #[cfg(feature = "encode")]
    fn to_bytes(self) -> [u8; Self::LEN] {
        let Self { importance: i, opacity: o, size: s } = self;
        [i.depth, o.depth, o.class, s.depth, s.class].map(|v| v as u8)
    }

    fn from_bytes(bytes: &[u8]) -> Self {
        let at = |i: usize| bytes.get(i).map_or(0, |&b| b as i8);
        Self {
            importance: Factors { depth: at(0), class: 0 },
            opacity: Factors { depth: at(1), class: at(2) },
            size: Factors { depth: at(3), class: at(4) },
        }
    }
}
