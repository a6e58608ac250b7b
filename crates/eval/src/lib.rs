#![doc = include_str!("../README.md")]
#![allow(
    clippy::disallowed_methods,
    reason = "reports and pictures, never the bitstream; the fixture uses libm"
)]

mod attributes;
mod bd;
pub mod bench;
mod cache;
mod chart;
mod manifest;
pub mod measure;
pub mod page;
mod peers;
mod process;
pub mod progress;
mod published;
pub mod rd_curve;
mod report;
mod round_trip;
pub mod scenes;
pub mod stress;
mod usage;

pub use process::gsvx_command;
pub use scenes::TestScene;
