//! A deterministic rasterizer of 3D Gaussians.

pub mod backend;
mod error;
mod forward;
#[cfg(feature = "gpu")]
mod gpu;
mod gradients;
mod image;
pub mod metrics;
mod options;
mod quantization;
mod saliency;
#[cfg(any(test, feature = "gpu"))]
mod shaders;
mod shuffle;
mod simd;
mod stages;
mod train;

pub use backend::{Backend, BackendReport};
pub use error::{Error, Result};
pub use forward::render;
pub use gradients::{Gradients, gradients};
pub use image::Image;
pub use options::{LearningRates, Loss, Profile, RenderOptions};
pub use quantization::{Quantization, QuantizationMode};
pub use saliency::{Saliency, saliency, saliency_per_view};
pub use train::{
    FineTune, FineTuneOptions, MAX_IMAGE_EDGE, Outcome, Progress, StopReason, TrainView,
};
