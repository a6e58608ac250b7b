//! How alike two versions of a model look, quickly: an estimate for models with and without cameras.
//!
//! A quarter of each of a few views is drawn, of both versions. The first view shows its upper left quarter, the next
//! one its upper right, and so on: together they show as much of the background as whole views do, so that their PSNR
//! is that of whole views, from a quarter of the pixels.

use crate::forward::render;
use crate::framing::{self, Constraints};
use crate::image::Image;
use crate::metrics;
use crate::options::RenderOptions;
use gs_model::{Camera, Scene};

/// Views that are drawn: of given cameras, and of cameras around what matters. Given cameras differ more in what they see.
const GIVEN: usize = 8;
const AROUND: usize = 4;
/// Pixels of a whole view, at most.
const PIXELS: u32 = framing::SIZE[0] * framing::SIZE[1];
/// PSNR of equal pictures, and the greatest that is told, dB.
const EQUAL: f64 = 99.0;

/// The pictures of a model, for comparison with those of another version of it.
#[derive(Clone, Debug)]
pub struct Pictures {
    views: Vec<(Camera, Image)>,
}

/// How alike two versions of a model look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// Of the mean squared error of the views, dB; 99 for equal pictures.
    pub psnr: f64,
    /// Mean over the views.
    pub ssim: f64,
    /// Number of views.
    pub views: usize,
}

impl Pictures {
    /// Draws the model from some of the cameras; without cameras, from places around it.
    #[must_use]
    pub fn of(scene: &Scene, cameras: Option<&[Camera]>) -> Self {
        let cameras = match cameras {
            Some(given) => {
                let step = given.len().div_ceil(GIVEN).max(1);
                given.iter().step_by(step).cloned().collect()
            }
            None => around(scene),
        };
        let draw = |(i, camera)| {
            let camera = quarter(camera, i);
            let image = render(scene, &camera, &RenderOptions::default());
            (camera, image)
        };
        let views: Vec<_> = cameras.iter().enumerate().map(draw).collect();
        // Where nothing is drawn there is nothing to compare.
        let shows = views.iter().any(|(_, image)| image.rgb.iter().any(|&v| v > 0.0));
        Self { views: if shows { views } else { Vec::new() } }
    }

    /// True if the pictures show nothing: there is nothing to compare.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// Compares with another version of the model; `None` if the pictures show nothing.
    #[must_use]
    pub fn likeness(&self, scene: &Scene) -> Option<Likeness> {
        let (mut squared_error, mut ssim) = (0.0, 0.0);
        for (camera, image) in &self.views {
            let shown = render(scene, camera, &RenderOptions::default());
            squared_error += metrics::squared_error(&shown, image);
            ssim += metrics::ssim(&shown, image);
        }
        let views = self.views.len();
        let n = views as f64;
        let psnr = metrics::decibels(squared_error / n).min(EQUAL);
        (views > 0).then_some(Likeness { psnr, ssim: ssim / n, views })
    }
}

impl Likeness {
    /// Below this the difference is worth a warning, dB.
    pub const POOR: f64 = 32.0;

    /// What the PSNR means, rounded to whole dB.
    #[must_use]
    pub fn meaning(&self) -> &'static str {
        match self.psnr.round() {
            p if p >= 50.0 => "no difference can be seen",
            p if p >= 40.0 => "differences are hard to see",
            p if p >= 35.0 => "small differences show side by side",
            p if p >= Self::POOR => "differences can be seen",
            _ => "differences are easy to see",
        }
    }
}

/// A quarter of a view; which one follows from its index.
fn quarter(camera: &Camera, index: usize) -> Camera {
    let camera = camera.within(PIXELS);
    let [width, height] = [camera.width, camera.height].map(|side| side.div_ceil(2));
    let [right, lower] = [index & 1, index >> 1 & 1].map(|place| place as u32);
    let [left, top] = [right * (camera.width - width), lower * (camera.height - height)];
    let [cx, cy] = [camera.cx - f64::from(left), camera.cy - f64::from(top)];
    Camera { width, height, cx, cy, ..camera }
}

/// Views of what matters in a model.
fn around(scene: &Scene) -> Vec<Camera> {
    let constraints = Constraints::default();
    let Some(found) = framing::find(scene, &constraints) else { return Vec::new() };
    let focal = 0.5 * f64::from(framing::SIZE[0]) / constraints.tangents[0];
    found.cameras(AROUND as u32, "view", framing::SIZE, focal)
}
