//! The measurements behind pages of docs/results.

pub mod gpcc;
pub mod gsvx;
mod gsvx_flags;
mod importance;
pub mod quality;
pub mod real_size;
mod scale;
mod speed;
mod sweep;
pub mod tune;
pub mod voxel;

pub use sweep::{ALLOWED_DB, Drop, Sweep, all_qualities};
