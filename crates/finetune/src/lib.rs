//! A deterministic rasterizer of 3D Gaussians.

mod forward;
mod gradients;
mod image;
pub mod metrics;
mod options;
mod saliency;
mod simd;
mod stages;

pub use forward::render;
pub use gradients::{Gradients, gradients};
pub use image::Image;
pub use options::{LearningRates, Loss, Profile, RenderOptions};
pub use saliency::{Saliency, saliency, saliency_per_view};
