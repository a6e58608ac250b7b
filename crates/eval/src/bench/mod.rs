//! The measurements behind pages of docs/results.

mod distribution;
pub mod error;
pub mod gpcc;
pub mod gpu;
pub mod gsvx;
pub mod paper;
pub mod quality;
pub mod real_size;
pub mod sequences;
pub mod size;
pub mod tune;
