//! How much less a stream shows than its model: an estimate after every encode.
//!
//! The middle of a few views is drawn twice, from the model and from what the stream decodes to, at the
//! resolution of a photo: a whole view of fewer pixels would hide what is lost. Only the Gaussians that
//! reach into these pictures are kept, and they are few, so the estimate costs little beside the encode.
//! Pictures are compared at 8 bits, as screens show them.

use crate::framing;
use finetune::{Image, RenderOptions, metrics, render};
use gs_model::{Camera, Scene};
use gsvx::{DecodeOptions, Decoder};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::sync::{Mutex, PoisonError};

/// Views that are looked at.
const VIEWS: usize = 4;
/// Size of the pictures, pixels.
const SIZE: [u32; 2] = [256, 192];
/// Width of the generated views, pixels, and tangent of half their field of view.
const WIDTH: f64 = 960.0;
const TANGENT: f64 = 0.577;
/// Standard deviations at which the most opaque Gaussian ends: alpha falls below 1/255.
const REACH: f64 = 3.4;
/// Pixels by which a rasterizer may widen a Gaussian.
const WIDENED: f64 = 4.0;
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
        // One view at a time, for memory's sake.
        let views = cameras.into_iter().map(|camera| {
            let near = Frustum::of(&camera).select(scene);
            let image = render(&near, &camera, &RenderOptions::default());
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
        let frusta: Vec<Frustum> = self.views.iter().map(|v| Frustum::of(&v.0)).collect();
        let (sh_degree, parts) = decode_in_sight(stream, &frusta)?;
        let (mut psnr, mut ssim) = (0.0, 0.0);
        for ((camera, reference), frustum) in self.views.iter().zip(&frusta) {
            let mut near = Scene { sh_degree, ..Scene::default() };
            for part in &parts {
                near.append(&frustum.select(part));
            }
            let shown = render(&near, camera, &RenderOptions::default());
            let eight = |rgb: &[u8]| Image::from_rgb8(camera.width, camera.height, rgb);
            let (Some(a), Some(b)) = (eight(&shown.to_rgb8()), eight(reference)) else { continue };
            psnr += metrics::psnr(&a, &b).min(EQUAL);
            ssim += metrics::ssim(&a, &b);
        }
        let n = self.views.len();
        Ok(Some(Loss { psnr: psnr / n as f64, ssim: ssim / n as f64, views: n }))
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
    let Some(found) = framing::find_quickly(scene, tangents) else { return Vec::new() };
    let focal = 0.5 * WIDTH / TANGENT;
    let places = found.places(VIEWS as u32).into_iter().enumerate();
    places.map(|(i, turn)| found.ring.camera(format!("view-{i}"), turn, SIZE, focal)).collect()
}

/// What a camera must see of a Gaussian to draw it.
struct Frustum {
    rows: [[f64; 4]; 3],
    /// Inward normals of the four planes through the camera's centre and the picture's edges, in camera
    /// coordinates, of length 1.
    planes: [[f64; 3]; 4],
}

impl Frustum {
    fn of(camera: &Camera) -> Self {
        let row = |k: usize| {
            let r = camera.rotation.row(k);
            [r.x, r.y, r.z, camera.translation[k]]
        };
        let plane = |v: [f64; 3]| {
            let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            v.map(|x| x / length)
        };
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        let (fx, fy, cx, cy) = (camera.fx, camera.fy, camera.cx, camera.cy);
        // A point is inside if -WIDENED <= fx x/z + cx <= w + WIDENED.
        let planes = [
            plane([fx, 0.0, cx + WIDENED]),
            plane([-fx, 0.0, w + WIDENED - cx]),
            plane([0.0, fy, cy + WIDENED]),
            plane([0.0, -fy, h + WIDENED - cy]),
        ];
        Self { rows: [row(0), row(1), row(2)], planes }
    }

    /// The Gaussians that reach into the picture.
    fn select(&self, scene: &Scene) -> Scene {
        let seen = |&i: &usize| self.sees(scene, i);
        scene.select(&(0..scene.len()).into_par_iter().filter(seen).collect::<Vec<_>>())
    }

    /// Whether a Gaussian reaches into the picture.
    fn sees(&self, scene: &Scene, i: usize) -> bool {
        let size = scene.log_scales[i].iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let radius = REACH * f64::from(libm::expf(size));
        let m = scene.means[i].map(f64::from);
        let p = self.rows.map(|r| r[0] * m[0] + r[1] * m[1] + r[2] * m[2] + r[3]);
        p[2] > -radius
            && self.planes.iter().all(|n| n[0] * p[0] + n[1] * p[1] + n[2] * p[2] > -radius)
    }
}

/// The SH degree of a stream, and its Gaussians that reach into one of the pictures, in parts.
fn decode_in_sight(stream: &[u8], frusta: &[Frustum]) -> gsvx::Result<(u8, Vec<Scene>)> {
    let mut options = DecodeOptions::default();
    options.max_gaussians = Some(u64::MAX);
    let decoder = Decoder::new(stream, &options)?;
    let found: Mutex<Vec<(usize, Scene)>> = Mutex::default();
    let decode = || {
        decoder.blocks::<(), gsvx::Error>(|(), first, block| {
            let seen = |&i: &usize| frusta.iter().any(|f| f.sees(block, i));
            let chosen: Vec<usize> = (0..block.len()).filter(seen).collect();
            if !chosen.is_empty() {
                let part = (first, block.select(&chosen));
                found.lock().unwrap_or_else(PoisonError::into_inner).push(part);
            }
            Ok(())
        })
    };
    // One chunk at a time is less memory than the encoder had.
    match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
        Ok(one) => one.install(decode)?,
        Err(_) => decode()?,
    }
    let mut parts = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    parts.sort_unstable_by_key(|p| p.0);
    Ok((decoder.sh_degree(), parts.into_iter().map(|p| p.1).collect()))
}
