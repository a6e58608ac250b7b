//! How alike two versions of a model look, quickly: an estimate for models with and without cameras.
//!
//! A quarter of each of a few views is drawn, of both versions. The first view shows its upper left quarter, the next
//! one its upper right, and so on: together they show as much of the background as whole views do, so that their PSNR
//! is that of whole views, from a quarter of the pixels.

use crate::forward::render;
use crate::framing;
use crate::image::Image;
use crate::metrics;
use crate::options::RenderOptions;
use gs_model::{Camera, Scene};

/// Views that are drawn: of given cameras, and of cameras around what matters. Given cameras differ more in what they see.
const GIVEN: usize = 8;
const AROUND: u32 = 4;
/// Pixels of a whole view, at most.
const PIXELS: u32 = framing::SIZE[0] * framing::SIZE[1];
/// PSNR of equal pictures, and the greatest that is told, dB.
const EQUAL: f64 = 99.0;
/// See [`LossEstimate::is_far_apart`], dB.
const FAR_APART: f64 = 3.0;
/// See [`LossEstimate::doubts_cameras`], dB.
const DOUBTED: f64 = 6.0;
const DOUBTED_BELOW: f64 = 34.0;

/// The pictures of a model, for comparison with those of another version of it.
///
/// Views that decide what is kept of a model cannot judge alone what was kept: wrong cameras look where everything was
/// kept. So there are always views that depend on the model alone.
#[derive(Clone, Debug)]
pub struct Pictures {
    /// From some of the given cameras.
    given: Vec<(Camera, Image)>,
    /// From places around what matters in the model: with cameras from all sides.
    around: Vec<(Camera, Image)>,
}

/// How alike two versions of a model look in some views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// Of the mean squared error of the views, dB; 99 for equal pictures.
    pub psnr: f64,
    /// Mean over the views.
    pub ssim: f64,
    /// Number of views.
    pub views: usize,
}

/// How much less a version of a model shows than the model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LossEstimate {
    /// At some of the given cameras; `None` without cameras, or if they see nothing.
    pub at_cameras: Option<Likeness>,
    /// At views that depend on the model alone; `None` if nothing shows in them.
    pub around: Option<Likeness>,
}

impl Pictures {
    /// Draws the model from places around it, and from some of the cameras.
    #[must_use]
    pub fn of(scene: &Scene, cameras: Option<&[Camera]>) -> Self {
        let around = match cameras {
            Some(_) => framing::all_around(scene),
            None => framing::around(scene, AROUND),
        };
        let given = cameras.unwrap_or_default();
        let step = given.len().div_ceil(GIVEN).max(1);
        let given: Vec<Camera> = given.iter().step_by(step).cloned().collect();
        Self { given: drawn(scene, &given), around: drawn(scene, &around) }
    }

    /// True if the pictures show nothing: there is nothing to compare.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.given.is_empty() && self.around.is_empty()
    }

    /// Compares with another version of the model.
    #[must_use]
    pub fn compare(&self, scene: &Scene) -> LossEstimate {
        let [at_cameras, around] = [&self.given, &self.around].map(|views| likeness(views, scene));
        LossEstimate { at_cameras, around }
    }
}

/// Pictures of a scene; none if they show nothing, as there is nothing to compare then.
fn drawn(scene: &Scene, cameras: &[Camera]) -> Vec<(Camera, Image)> {
    let draw = |(i, camera)| {
        let camera = quarter(camera, i);
        let image = render(scene, &camera, &RenderOptions::default());
        (camera, image)
    };
    let views: Vec<_> = cameras.iter().enumerate().map(draw).collect();
    let shows = views.iter().any(|(_, image)| image.rgb.iter().any(|&v| v > 0.0));
    if shows { views } else { Vec::new() }
}

/// How alike the pictures of another version are; `None` without pictures.
fn likeness(pictures: &[(Camera, Image)], scene: &Scene) -> Option<Likeness> {
    let (mut squared_error, mut ssim) = (0.0, 0.0);
    for (camera, image) in pictures {
        let shown = render(scene, camera, &RenderOptions::default());
        squared_error += metrics::squared_error(&shown, image);
        ssim += metrics::ssim(&shown, image);
    }
    let views = pictures.len();
    let n = views as f64;
    let psnr = metrics::decibels(squared_error / n).min(EQUAL);
    (views > 0).then_some(Likeness { psnr, ssim: ssim / n, views })
}

impl LossEstimate {
    /// The worse of both; `None` if the pictures show nothing.
    #[must_use]
    pub fn worse(&self) -> Option<Likeness> {
        let all = [self.at_cameras, self.around].into_iter().flatten();
        all.min_by(|a, b| a.psnr.total_cmp(&b.psnr))
    }

    /// Whether the loss at the cameras and around the model differs by so much that one figure hides it.
    #[must_use]
    pub fn is_far_apart(&self) -> bool {
        self.at_cameras.zip(self.around).is_some_and(|(a, b)| (a.psnr - b.psnr).abs() > FAR_APART)
    }

    /// Whether the cameras may not be the model's own: what they chose shows well to them, if they see anything, and
    /// badly to views that do not depend on them.
    ///
    /// Cameras that fit fox, bonsai and the fixture room lose up to 6.5 dB around the model, and 34 dB or more are left.
    /// Cameras of another frame lose 7 to 40 dB, and 10 to 33 are left.
    #[must_use]
    pub fn doubts_cameras(&self) -> bool {
        let well =
            |around: Likeness| self.at_cameras.is_none_or(|at| at.psnr > around.psnr + DOUBTED);
        self.around.is_some_and(|around| around.psnr < DOUBTED_BELOW && well(around))
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
