//! 3D Gaussian splatting scenes in memory, and the files they live in.

pub mod camera;
pub mod scene;

pub use camera::Camera;
pub use scene::{SH_C0, Scene};
