//! 3D Gaussian splatting scenes in memory, and the files they live in.

pub mod camera;
pub mod colmap;
pub mod dataset;
pub mod error;
mod fs;
mod image_size;
pub mod inria;
pub mod nerf;
pub mod ply;
pub mod scene;
pub mod validate;

pub use camera::Camera;
pub use dataset::{Dataset, View};
pub use error::{Error, Result};
pub use scene::{SH_C0, Scene};
