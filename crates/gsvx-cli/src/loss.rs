//! How much less a stream shows than its model: an estimate after every encode.
//!
//! The middle of a few views is drawn twice, from the model and from what the stream decodes to, at the
//! resolution of a photo: a whole view of fewer pixels would hide what is lost. Pictures are compared at
//! 8 bits, as screens show them.

use crate::framing;
use finetune::{Image, RenderOptions, metrics, render};
use gs_model::{Camera, Scene};
use gsvx::DecodeOptions;
use rayon::prelude::*;
use serde_json::{Value, json};

/// Views that are looked at.
const VIEWS: usize = 2;
/// Size of the pictures, pixels.
const SIZE: [u32; 2] = [320, 240];
/// Width of the generated views, pixels, and tangent of half their field of view.
const WIDTH: f64 = 960.0;
const TANGENT: f64 = 0.577;
/// PSNR of equal pictures, and the greatest that is told, dB.
const EQUAL: f64 = 99.0;
/// Below this the loss is worth a warning, dB.
const POOR: f64 = 32.0;

/// The pictures of a model, for comparison with those of a stream.
pub(crate) struct Pictures {
    /// Cameras, and pictures of 8 bits: the encoder needs the memory.
    views: Vec<(Camera, Vec<u8>)>,
}

/// How much less a stream shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Loss {
    /// Mean over the views, dB.
    pub(crate) psnr: f64,
    pub(crate) ssim: f64,
    views: usize,
}

impl Pictures {
    /// Draws the model from some of the cameras; without cameras, from places around it.
    pub(crate) fn of(scene: &Scene, cameras: Option<&[Camera]>) -> Self {
        let cameras = match cameras {
            Some(given) => {
                let step = given.len().div_ceil(VIEWS).max(1);
                given.iter().step_by(step).map(middle).collect()
            }
            None => around(scene),
        };
        let views = cameras.into_par_iter().map(|camera| {
            let image = render(scene, &camera, &RenderOptions::default());
            (camera, image.to_rgb8())
        });
        // Where nothing is drawn there is nothing to compare.
        let shows = |(_, rgb): &(Camera, Vec<u8>)| rgb.iter().any(|&v| v > 0);
        Self { views: views.filter(shows).collect() }
    }

    /// Compares with what a stream decodes to; `None` if the views show nothing.
    ///
    /// # Errors
    /// Those of the decoder.
    pub(crate) fn loss(&self, stream: &[u8]) -> gsvx::Result<Option<Loss>> {
        if self.views.is_empty() {
            return Ok(None);
        }
        let mut options = DecodeOptions::default();
        options.max_gaussians = Some(u64::MAX);
        let scene = gsvx::decode_with(stream, &options)?.scene;
        let compared = self.views.par_iter().filter_map(|(camera, reference)| {
            let shown = render(&scene, camera, &RenderOptions::default());
            let eight = |rgb: &[u8]| Image::from_rgb8(camera.width, camera.height, rgb);
            let (a, b) = (eight(&shown.to_rgb8())?, eight(reference)?);
            Some((metrics::psnr(&a, &b).min(EQUAL), metrics::ssim(&a, &b)))
        });
        let compared: Vec<(f64, f64)> = compared.collect();
        let n = compared.len();
        let mean = |values: f64| values / n as f64;
        let psnr = mean(compared.iter().map(|c| c.0).sum());
        Ok(Some(Loss { psnr, ssim: mean(compared.iter().map(|c| c.1).sum()), views: n }))
    }
}

impl Loss {
    /// For a person.
    pub(crate) fn human(&self) -> String {
        format!(
            "estimated loss: about {:.0} dB PSNR, SSIM {:.3}, against the input in {} pictures: {}",
            self.psnr,
            self.ssim,
            self.views,
            self.meaning()
        )
    }

    /// What the PSNR means, as it is printed.
    fn meaning(&self) -> &'static str {
        match self.psnr.round() {
            p if p >= 50.0 => "no difference can be seen",
            p if p >= 40.0 => "differences are hard to see",
            p if p >= 35.0 => "small differences show side by side",
            p if p >= POOR => "differences can be seen",
            _ => "differences are easy to see",
        }
    }

    /// What to do where much is lost.
    pub(crate) fn warning(&self) -> Option<&'static str> {
        (self.psnr.round() < POOR).then_some(
            "warning: the loss is easy to see; a higher --quality keeps more, and so does --cameras at \
             the same size",
        )
    }

    /// The same as JSON.
    pub(crate) fn json(&self) -> Value {
        json!({
            "psnr": self.psnr,
            "ssim": self.ssim,
            "views": self.views,
            "meaning": self.meaning(),
        })
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
    let Some((ring, turns)) = framing::find_quickly(scene, VIEWS, tangents) else {
        return Vec::new();
    };
    let focal = 0.5 * WIDTH / TANGENT;
    let places = turns.into_iter().enumerate();
    places.map(|(i, turn)| ring.camera(format!("view-{i}"), turn, SIZE, focal)).collect()
}
