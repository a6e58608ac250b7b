//! Geometry and attribute coding of voxelized point clouds.

pub mod attribute;
mod bytes;
pub mod coeffs;
mod context;
mod error;
pub mod geometry;
mod hood;
pub mod leaf;
mod limits;
pub mod mix;
pub mod model;
pub mod morton;
pub mod predict;
pub mod quant;
pub mod raht;
pub mod range;
mod rdoq;
pub mod rlgr;

pub use error::{Error, Result};
pub use leaf::Leaf;
pub use limits::Limits;
