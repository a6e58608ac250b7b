//! Octree voxelization of 3D Gaussians, uniform and adaptive.

pub mod cube;

pub use cube::Cube;
