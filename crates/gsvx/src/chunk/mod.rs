//! One chunk of leaves: its layers as bytes, and its Gaussians.
//!
//! A chunk is a run of leaves in Morton order with an octree, transforms and models of its own, so it
//! needs nothing but the header. Its first layer makes a picture; each SH degree is a further layer.
//! Normative description: `docs/format.md`, "Base layer" and "SH layers".

#[cfg(feature = "encode")]
mod check;
#[cfg(feature = "encode")]
mod encode;
mod gaussians;
#[cfg_attr(not(feature = "encode"), allow(unreachable_pub, reason = "the module latents shows it"))]
mod groups;
mod skeleton;
mod values;

#[cfg(feature = "encode")]
pub(crate) use check::check;
#[cfg(feature = "encode")]
pub(crate) use encode::{ChunkEncoder, CodingSettings, LAMBDA_MOVED, Values};
#[cfg(feature = "encode")]
pub use encode::{Transform, TransformPrediction};
#[cfg(feature = "encode")]
pub use gaussians::GaussianGradient;
pub(crate) use gaussians::resize;
#[cfg(feature = "encode")]
pub(crate) use groups::coded;
#[cfg(feature = "encode")]
pub use groups::{Attribute, GROUPS, Group, PredictFrom};
#[cfg(not(feature = "encode"))]
pub(crate) use groups::{Attribute, Group};
pub(crate) use groups::{MOVING, coefficients};
pub(crate) use skeleton::Skeleton;
pub(crate) use values::ChunkValues;

use crate::importance;

/// Step of the importance classes: coarse, since the exact class matters little, and what is saved
/// here is saved for every Gaussian.
const CLASS_STEP: f32 = 1.0;

/// The transform's step, which is for weight 1, from that of the header, which is for the mean class.
pub(crate) fn step_of_unit_weight(step: f32) -> f32 {
    step * f32::from(1u16 << importance::MEAN_CLASS)
}

/// Steps of the transform for a group of channels.
pub(crate) fn steps_of(step: f32, channels: usize) -> Vec<f32> {
    vec![step_of_unit_weight(step); channels]
}
