#![doc = include_str!("../README.md")]
#![allow(
    clippy::disallowed_methods,
    reason = "reports and pictures, never the bitstream; the fixture uses libm"
)]

mod attributes;
pub mod bd;
pub mod bench;
mod cache;
pub mod chart;
mod cloud;
mod codec;
mod experiments;
mod manifest;
pub mod measure;
pub mod page;
mod peers;
mod pictures;
mod process;
pub mod progress;
pub mod published;
pub mod rd_curve;
mod report;
pub mod scenes;
pub mod stress;
mod usage;
mod voxelized;

pub use codec::{Codec, CodecCurve, CodedPoint, Gsvx, curve, measure_point};
pub use process::gsvx_command;
pub use scenes::TestScene;
