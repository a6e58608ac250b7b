//! How alike two versions of a model look, quickly: an estimate for models with and without cameras.
//!
//! The middle of a few views is drawn, from the one and from the other, at the resolution of a photo: a whole view of
//! fewer pixels would hide what is lost. Pictures are compared at 8 bits, as screens show them.

use crate::forward::render;
use crate::framing;
use crate::image::Photo;
use crate::metrics;
use crate::options::RenderOptions;
use crate::train_view::TrainView;
use gs_model::{Camera, Scene};

/// Views that are looked at.
const VIEWS: usize = 4;
/// Size of the pictures, pixels.
const SIZE: [u32; 2] = [256, 192];
/// Width of the generated views, pixels, and tangent of half their field of view.
const WIDTH: f64 = 960.0;
const TANGENT: f64 = 0.577;
/// PSNR of equal pictures, and the greatest that is told, dB.
const EQUAL: f64 = 99.0;

/// The pictures of a model, for comparison with those of another version of it.
#[derive(Clone, Debug)]
pub struct Pictures {
    views: Vec<TrainView>,
}

/// How alike two versions of a model look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// Mean over the views, dB; 99 for equal pictures.
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
                let step = given.len().div_ceil(VIEWS).max(1);
                given.iter().step_by(step).map(middle).collect()
            }
            None => around(scene),
        };
        let views = cameras.into_iter().map(|camera| TrainView::rendered(scene, camera));
        // Where nothing is drawn there is nothing to compare.
        let shows = |view: &TrainView| view.photo.rgb.iter().any(|&v| v > 0);
        Self { views: views.filter(shows).collect() }
    }

    /// True if the pictures show nothing: there is nothing to compare.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// Compares with another version of the model; `None` if the pictures show nothing.
    #[must_use]
    pub fn likeness(&self, scene: &Scene) -> Option<Likeness> {
        let (mut psnr, mut ssim) = (0.0, 0.0);
        for TrainView { camera, photo } in &self.views {
            let shown = render(scene, camera, &RenderOptions::default());
            let [a, b] = [Photo::from(&shown).image(), photo.image()];
            psnr += metrics::psnr(&a, &b).min(EQUAL);
            ssim += metrics::ssim(&a, &b);
        }
        let views = self.views.len();
        let n = views as f64;
        (views > 0).then(|| Likeness { psnr: psnr / n, ssim: ssim / n, views })
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

/// The middle of a view, pixel by pixel.
fn middle(camera: &Camera) -> Camera {
    let [width, height] = [SIZE[0].min(camera.width), SIZE[1].min(camera.height)];
    let left = f64::from((camera.width - width) / 2);
    let top = f64::from((camera.height - height) / 2);
    Camera { width, height, cx: camera.cx - left, cy: camera.cy - top, ..camera.clone() }
}

/// Views of what matters in a model.
fn around(scene: &Scene) -> Vec<Camera> {
    let tangents = [TANGENT, TANGENT * f64::from(SIZE[1]) / f64::from(SIZE[0])];
    let Some(found) = framing::find_quickly(scene, tangents) else { return Vec::new() };
    let focal = 0.5 * WIDTH / TANGENT;
    found.cameras(VIEWS as u32, "view", SIZE, focal)
}
