//! A deterministic rasterizer of 3D Gaussians.

mod forward;
mod image;
pub mod metrics;
mod options;
mod saliency;
mod simd;
mod stages;

pub use forward::render;
pub use image::Image;
pub use options::{Profile, RenderOptions};
pub use saliency::{Saliency, saliency, saliency_per_view};
