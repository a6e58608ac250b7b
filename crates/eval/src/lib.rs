//! Measures codecs of 3D Gaussian splatting scenes: give it a codec and a scene, it returns a
//! rate-distortion curve.
//!
//! A scene is a trained model with the cameras and photos it was trained on; every 8th photo is
//! held out. A codec is anything that implements [`Codec`]. [`curve`] encodes the model at each
//! quality, decodes the stream, renders the held-out cameras and compares the renders with the
//! photos.
//!
//! ```
//! use eval::{Codec, Gsvx, TestScene};
//! use gs_model::Scene;
//!
//! /// Not a codec yet: the model as a PLY file.
//! struct Ply;
//!
//! impl Codec for Ply {
//!     fn name(&self) -> String {
//!         "PLY".into()
//!     }
//!     fn encode(&self, scene: &TestScene, _quality: f32) -> anyhow::Result<Vec<u8>> {
//!         let mut bytes = Vec::new();
//!         gs_model::ply::write_to(&mut bytes, &scene.model)?;
//!         Ok(bytes)
//!     }
//!     fn decode(&self, stream: &[u8]) -> anyhow::Result<Scene> {
//!         Ok(gs_model::ply::read_bytes(stream)?.0)
//!     }
//! }
//!
//! # fn main() -> anyhow::Result<()> {
//! let scene = TestScene::open("room", 1)?; // a name of scenes.toml or a folder; one held-out view
//! let ply = eval::curve(&Ply, &scene, &[0.0])?;
//! let gsvx = eval::curve(&Gsvx::with_cameras(&scene), &scene, &[30.0, 80.0])?;
//! assert!(gsvx.points[1].bytes < ply.points[0].bytes / 10);
//! assert!(gsvx.points[1].score.psnr_db > ply.points[0].score.psnr_db - 1.0);
//! # Ok(())
//! # }
//! ```
//!
//! Two curves are compared by [`Curve::bd_rate`]. The codecs of [`peers`] run other projects' tools;
//! [`published`] has points that others published.
//!
//! The rest of the crate is this project's own measurements, which `cargo xtask` calls:
//! [`rd_curve`] with the paper's experiments, [`bench`], [`stress`] and [`room`], which makes the
//! default scene. They write reports for people, so their errors are `anyhow` errors of one line.
//!
//! Invariant: no library crate depends on this one, and nothing measured here changes a stream.
#![allow(
    clippy::disallowed_methods,
    reason = "reports and pictures, never the bitstream; the fixture uses libm"
)]

pub mod bd;
pub mod bench;
mod cache;
mod chart;
mod codec;
pub mod experiments;
mod manifest;
pub mod measure;
pub mod peers;
mod pictures;
pub mod progress;
pub mod published;
pub mod rd_curve;
mod report;
pub mod room;
pub mod scenes;
pub mod stress;
mod usage;

pub use codec::{Codec, Curve, Gsvx, Point, curve, measure_point};
pub use scenes::TestScene;
