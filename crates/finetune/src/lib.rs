//! A deterministic, differentiable rasterizer of 3D Gaussians, and the fine-tune that uses it.
//!
//! Voxelization moves and merges Gaussians, and quality falls. The fine-tune ([`FineTune`])
//! brings it back: it renders the scene from the cameras of posed photos, compares, and moves
//! SH coefficients, opacities, scales and rotations, but not the means, which stay at the
//! centres of their voxels.
//!
//! - [`render`] draws a scene, [`metrics`] compares images, [`saliency`] measures how much each
//!   Gaussian contributes to a set of views.
//! - [`framing`] finds cameras for a scene that has none; [`Pictures`] tell how alike two versions of a scene
//!   look.
//! - [`seen_opacity_share`] and [`photo_match`] tell cameras and photos of another scene.
//! - [`gradients`] gives a loss and its gradients, for other optimisers.
//! - [`ViewGradients`] and [`optimiser`] are for loops of one's own, view after view.
//! - [`FineTune`] runs Adam with a decaying rate, early stop, checkpoints, and, if asked, the
//!   codec's quantiser in the loop ([`Quantization`]).
//!
//! There is one list of stages (project, depth sort, tile lists, blend, loss, blend adjoint,
//! gather, projection adjoint and Adam) and two executors of it: Rust on all cores, and WGSL on
//! wgpu with the feature `gpu`. The mathematics of a splat is one source text that compiles as Rust
//! and as WGSL. Every float sum has a fixed order, so the result does not depend on the number of
//! threads or on the scheduling. The conventions are those of Inria's 2023 rasterizer (0.3
//! pixels of blur, alpha capped at 0.99 and cut at 1/255, stop at a transmittance of 1e-4).
//!
//! ```
//! use finetune::{FineTune, FineTuneOptions, Image, RenderOptions, TrainView, metrics, render};
//! use gs_model::{Camera, Scene};
//!
//! let (eye, up) = ([0.0, 0.0, -2.0], [0.0, -1.0, 0.0]);
//! let camera = Camera::looking_at("front".into(), eye, [0.0; 3], up, [32, 24], 30.0);
//! let mut scene = Scene {
//!     means: vec![[0.0; 3]],
//!     rotations: vec![[1.0, 0.0, 0.0, 0.0]],
//!     log_scales: vec![[-1.0, -2.0, -1.5]],
//!     opacity_logits: vec![2.0],
//!     sh_degree: 0,
//!     sh: vec![[1.0, 0.2, -0.5]],
//! };
//! let photo = render(&scene, &camera, &RenderOptions::default());
//!
//! // Spoil the colour, then let the photo bring it back.
//! scene.sh[0] = [0.5, 0.5, 0.5];
//! let before = metrics::psnr(&render(&scene, &camera, &RenderOptions::default()), &photo);
//! let views = vec![TrainView { camera: camera.clone(), photo: photo.clone() }];
//! let options = FineTuneOptions { steps: 300, ..FineTuneOptions::default() };
//! let outcome = FineTune::new(scene, views, options)?.run(|progress| {
//!     assert!(progress.loss.is_finite());
//! })?;
//! let after = metrics::psnr(&render(&outcome.scene, &camera, &RenderOptions::default()), &photo);
//! assert!(after > before + 3.0, "{before} dB, then {after} dB");
//! # Ok::<(), finetune::Error>(())
//! ```

#![cfg_attr(docsrs, feature(doc_cfg))]

pub mod backend;
mod camera_check;
mod error;
mod forward;
pub mod framing;
mod frustum;
#[cfg(feature = "gpu")]
mod gpu;
mod gradients;
mod image;
#[cfg(feature = "gpu")]
pub mod latents;
mod likeness;
pub mod metrics;
pub mod optimiser;
mod options;
#[doc(hidden)]
pub mod probe;
mod quantization;
mod saliency;
#[cfg(any(test, feature = "gpu"))]
mod shaders;
mod shuffle;
mod simd;
mod stages;
mod train;
mod view_gradients;

pub use backend::{Backend, BackendReport};
pub use camera_check::{PhotoMatch, References, Seen, photo_match, seen_opacity_share};
pub use error::{Error, Result};
pub use forward::render;
pub use gradients::{Gradients, gradients};
pub use image::Image;
pub use likeness::{Likeness, Pictures};
pub use options::{LearningRates, Loss, Profile, RenderOptions};
pub use quantization::{Quantization, QuantizationMode};
pub use saliency::{Saliency, saliency, saliency_per_view};
pub use stages::removal::removal_effects;
pub use train::{FineTune, FineTuneOptions, Outcome, Progress, StopReason, TrainView};
#[cfg(feature = "gpu")]
pub use view_gradients::Adapter;
pub use view_gradients::{GaussianGradient, ViewGradients, ViewLoss};

// The README's example is a test too.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
