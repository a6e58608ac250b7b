//! Geometry and attribute coding of voxelized point clouds.

pub mod leaf;
pub mod morton;

pub use leaf::Leaf;
