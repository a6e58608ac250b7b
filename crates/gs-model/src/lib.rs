//! 3D Gaussian splatting scenes in memory, and the files they live in.
//!
//! A [`Scene`] is a trained 3DGS model as a struct of arrays, in the parametrisation that it
//! was trained in (log-scales, opacity logits, quaternions). [`ply`] reads and writes it in
//! the layout of the Inria reference implementation; [`model`] reads every format of the table
//! [`Format::all`], some of which are written too; [`Dataset`] opens a folder with a model, cameras and photos that
//! COLMAP, the Inria trainer or a NeRF tool made. [`math`] has the rotations and covariances that the
//! other crates share.
//!
//! ```
//! use gs_model::{Scene, ply};
//!
//! // One opaque red Gaussian, a tenth of a unit wide, at (1, 2, 3).
//! let scene = Scene {
//!     means: vec![[1.0, 2.0, 3.0]],
//!     rotations: vec![[1.0, 0.0, 0.0, 0.0]],
//!     log_scales: vec![[0.1f32.ln(); 3]],
//!     opacity_logits: vec![6.0],
//!     sh_degree: 0,
//!     sh: vec![[0.5 / gs_model::SH_C0, -0.5 / gs_model::SH_C0, -0.5 / gs_model::SH_C0]],
//!     ..Scene::default()
//! };
//! scene.validate()?;
//!
//! let mut file = Vec::new();
//! ply::write_to(&mut file, &scene)?;
//! let (back, report) = ply::read_bytes(&file)?;
//! assert_eq!(back, scene);
//! assert_eq!((report.gaussians_in_file, &report.form[..]), (1, "PLY, binary little-endian"));
//!
//! // The error about a file that is cut short says where it ends and what its header promises.
//! let error = ply::read_bytes(&file[..file.len() - 1]).unwrap_err();
//! assert!(error.to_string().contains("promises 1 rows of element \"vertex\""));
//! # Ok::<(), gs_model::Error>(())
//! ```
//!
//! # Guarantees
//!
//! - No input makes a function panic, and no allocation exceeds a small multiple of the input's
//!   size, whatever counts the input claims. The sizes of images are bounded
//!   ([`Camera::image_fits`]).
//! - Writing a scene and reading it back gives the same bits.
//! - Results do not depend on the number of threads.
//! - A scene that [`ply::read`] returns is valid: every number finite, every quaternion with a
//!   direction ([`Scene::validate`]).
//!
//! The crate does not know how a scene is rendered or coded, and decodes no photos.

#![cfg_attr(docsrs, feature(doc_cfg))]

mod axes;
#[cfg(feature = "files")]
mod bytes;
#[cfg(feature = "cameras")]
mod cameras;
mod chain;
mod codec;
#[cfg(feature = "files")]
mod doubts;
#[cfg(feature = "files")]
pub mod error;
#[cfg(feature = "files")]
mod formats;
#[cfg(feature = "files")]
mod fs;
#[cfg(any(feature = "cameras", feature = "formats"))]
mod json;
#[cfg(feature = "layouts")]
pub mod layout;
#[cfg(feature = "files")]
mod limits;
pub mod math;
#[cfg(feature = "files")]
pub mod model;
#[cfg(feature = "files")]
mod order;
#[cfg(feature = "files")]
mod report;
#[cfg(feature = "files")]
mod rows;
pub mod scene;
#[cfg(feature = "files")]
pub mod validate;

pub use axes::Axes;
#[cfg(feature = "cameras")]
pub use cameras::{
    camera::{self, Camera, NEAR, View},
    colmap,
    dataset::{self, CameraSet, Dataset},
    inria, lens, nerf,
    photos::{photos_beside, unread_photos_beside},
    pinholes::{pinholes, refuse_wide, too_wide},
};
pub use chain::{chain, printable};
pub use codec::Codec;
#[cfg(feature = "files")]
pub use doubts::Doubts;
#[cfg(feature = "files")]
pub use error::{Error, Result};
#[cfg(feature = "sog")]
pub use formats::sog;
#[cfg(feature = "files")]
pub use formats::{Format, ply};
#[cfg(feature = "formats")]
pub use formats::{gltf, spz};
#[cfg(feature = "files")]
pub use limits::{CLAMPED_OPACITY_LOGIT, Limits, is_point};
#[cfg(feature = "files")]
pub use order::morton_order;
#[cfg(feature = "files")]
pub use report::{FileAxes, Invalid, ReadOptions, Report};
pub use scene::{LEAST_DRAWN_LOGIT, SH_C0, Scene, SceneMut, sh_len};

// The README's example is a test too.
#[cfg(all(doctest, feature = "files"))]
#[doc = include_str!("../README.md")]
struct Readme;
