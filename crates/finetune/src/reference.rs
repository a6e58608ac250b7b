//! The stages in double precision, for measuring what single precision loses. With the feature `reference`.
//!
//! The formulae are those of the stages, so the difference is rounding alone. Slow: every splat at every pixel.

use gs_model::{Camera, Scene};

use crate::options::RenderOptions;
pub use crate::stages::f64_instance::GradientF64;
use crate::stages::f64_instance::View;
use crate::stages::project::{ProjectedSplat, RenderView, project};

/// Where a view shows a Gaussian, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Mean, pixels.
    pub mean: [f64; 2],
    /// `[p, q, r]`: at an offset of `dx`, `dy` pixels the exponent is `-(p dx + q dy)^2 - (r dy)^2`.
    pub factor: [f64; 3],
    /// Opacity at the mean, 0 to 1.
    pub opacity: f64,
    /// Red, green, blue, 0 and more.
    pub colour: [f64; 3],
}

/// The footprints as the rasterizer computes them, in single precision; `None` for a Gaussian that the view does not show.
#[must_use]
pub fn footprints(scene: &Scene, camera: &Camera) -> Vec<Option<Footprint>> {
    let mut projected = ProjectedSplat::default();
    project(&RenderView::new(camera, &RenderOptions::default()), scene, &mut projected);
    let of = |place: usize| {
        let s = projected.seen.splats[place];
        Footprint {
            mean: [s.x, s.y].map(f64::from),
            factor: [s.p, s.q, s.r].map(f64::from),
            opacity: f64::from(s.opacity),
            colour: [s.red, s.green, s.blue].map(f64::from),
        }
    };
    (0..scene.len()).map(|i| projected.place(i).map(of)).collect()
}

/// The footprints in double precision; `None` for a Gaussian at or behind the near plane.
#[must_use]
pub fn footprints_f64(scene: &Scene, camera: &Camera) -> Vec<Option<Footprint>> {
    let mut out = vec![None; scene.len()];
    for (i, d) in View::new(scene, camera).splats() {
        let (mean, factor) = ([d.x, d.y], d.factor());
        out[i] = Some(Footprint { mean, factor, opacity: d.opacity, colour: d.colour });
    }
    out
}

/// An image in double precision.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageF64 {
    /// Red, green, blue of each pixel, row by row.
    pub rgb: Vec<f64>,
    /// Pixels where a splat ends, or light runs out, so nearly that single precision may decide otherwise.
    pub doubtful: Vec<bool>,
}

/// [`crate::render`] in double precision.
#[must_use]
pub fn render_f64(scene: &Scene, camera: &Camera, background: [f32; 3]) -> ImageF64 {
    let (rgb, doubtful) = View::new(scene, camera).image(background.map(f64::from));
    ImageF64 { rgb, doubtful }
}

/// The gradient of the mean squared error to `photo` (values of all pixels) by each Gaussian, in double precision.
///
/// # Panics
/// If `photo` has fewer values than the image of the camera.
#[must_use]
pub fn gradients_f64(
    scene: &Scene,
    camera: &Camera,
    background: [f32; 3],
    photo: &[f32],
) -> Vec<GradientF64> {
    let mut out = vec![GradientF64::default(); scene.len()];
    let view = View::new(scene, camera);
    view.gradients(background.map(f64::from), photo).for_each(|(i, gradient)| out[i] = gradient);
    out
}
