//! A deterministic, differentiable rasterizer of 3D Gaussians, with losses, metrics and an optimiser.
//!
//! - [`render`] draws a scene, [`metrics`] compares images, [`Visibility`] measures how much each
//!   Gaussian contributes to a set of views.
//! - [`framing`] finds cameras for a scene that has none; [`estimate_loss`] tells how alike two versions of a scene
//!   look.
//! - [`Visibility`] and [`PhotoCheck`] tell cameras and photos of another scene.
//! - [`ViewGradients`] gives a loss and its gradients by all arrays of a scene, view after view, and [`optimiser`]
//!   moves a scene or other parameters against them. The crate tune makes runs of such steps.
//!
//! There is one list of stages (project, depth sort, tile lists, blend, loss, blend adjoint,
//! gather, projection adjoint and Adam) and two executors of it: Rust on all cores, and WGSL on
//! wgpu with the feature `gpu`. The mathematics of a splat is one source text that compiles as Rust
//! and as WGSL. Every float sum has a fixed order, so the result does not depend on the number of
//! threads or on the scheduling. The conventions are those of Inria's 2023 rasterizer (0.3
//! pixels of blur, alpha capped at 0.99 and cut at 1/255, stop at a transmittance of 1e-4).

#![cfg_attr(docsrs, feature(doc_cfg))]

pub mod backend;
mod backward;
mod error;
mod forward;
pub mod framing;
mod frustum;
#[cfg(feature = "gpu")]
mod gpu;
mod image;
#[cfg(feature = "gpu")]
pub mod kernels;
mod level_errors;
mod likeness;
pub mod metrics;
pub mod optimiser;
mod options;
mod photo_check;
#[cfg(feature = "reference")]
pub mod reference;
mod references;
mod sh_as_seen;
#[cfg(feature = "gpu")]
mod shaders;
mod shuffle;
mod stages;
mod train_view;
mod view_gradients;
mod visibility;

pub use backend::{Backend, BackendReport};
pub use error::{Error, Result};
pub use forward::render;
pub use frustum::{MOST as MOST_CAMERAS, that_see};
#[cfg(feature = "gpu")]
pub use gpu::{Adapter, DeviceOptimiser};
pub use image::{Image, Photo};
pub use level_errors::level_errors;
pub use likeness::{Likeness, LossEstimate, LossViews, Viewpoint, doubted_loss, estimate_loss};
pub use options::{LearningRates, Loss, MAX_EDGE, Profile, RenderOptions};
pub use photo_check::PhotoCheck;
pub use references::References;
pub use sh_as_seen::cut_sh_as_seen;
pub use stages::loss::ViewLoss;
pub use stages::project_adjoint::ParameterGradient;
pub use stages::removal::{Removal, removal};
pub use train_view::{TrainView, check_cameras, check_views};
pub use view_gradients::ViewGradients;
pub use visibility::{MISFIT_CAUSES, Visibility, doubt_about_share};

/// The README's example, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
