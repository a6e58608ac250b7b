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
mod exact;
mod manifest;
pub mod measure;
pub mod page;
mod peers;
mod process;
pub mod progress;
mod published;
pub mod rd_curve;
mod record;
mod report;
pub mod scenes;
pub mod stress;
mod study;

pub use cache::hash_bytes;
pub use process::{gsvx_command, printed};
pub use scenes::TestScene;
