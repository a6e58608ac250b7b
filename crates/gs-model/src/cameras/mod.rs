//! Cameras of COLMAP, the Inria trainer and NeRF tools: their files, where these lie, their lenses and photos.

pub mod camera;
pub mod colmap;
pub mod dataset;
pub mod inria;
mod json;
pub mod lens;
pub mod nerf;
mod nerfstudio;
pub(crate) mod photos;
pub(crate) mod pinholes;
mod places;
