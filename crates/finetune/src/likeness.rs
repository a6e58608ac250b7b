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
use glam::DVec3;
use gs_model::{Camera, Scene};
use std::convert::Infallible;

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

/// How alike two versions of a model look in some views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// Of the mean squared error of the views, dB; 99 for equal pictures.
    pub psnr: f64,
    /// Mean over the views.
    pub ssim: f64,
    /// Mean over the views; NaN where the parts of them are below 8 pixels.
    pub ssimulacra2: f64,
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
    /// From where the greatest difference in all these views is seen, in the middle of the view.
    pub worst: Option<Viewpoint>,
}

/// A place to look from, and where to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The place.
    pub eye: [f64; 3],
    /// The direction.
    pub ahead: [f64; 3],
}

/// Pictures of a model from some cameras, which those of its versions are compared with.
#[derive(Clone, Debug)]
pub struct LossViews {
    at_cameras: Vec<Picture>,
    around: Vec<Picture>,
}

/// A quarter of a view of a model.
#[derive(Clone, Debug)]
struct Picture {
    camera: Camera,
    image: Image,
}

/// How much less a version of `scene` shows than `scene`: at some of the cameras, and at places that depend on the model
/// alone.
///
/// Views that decide what is kept of a model cannot judge alone what was kept: wrong cameras look where everything was
/// kept.
#[must_use]
pub fn estimate_loss(scene: &Scene, version: &Scene, cameras: Option<&[Camera]>) -> LossEstimate {
    let step = || Ok::<_, Infallible>(());
    let Ok(loss) = LossViews::new(scene, cameras).estimate(version, step);
    loss
}

impl LossViews {
    /// From some of the cameras, and from places that depend on the model alone.
    #[must_use]
    pub fn new(scene: &Scene, cameras: Option<&[Camera]>) -> Self {
        let around = pictures(scene, &around(scene, cameras.is_some()));
        Self { at_cameras: pictures(scene, &some_of(cameras)), around }
    }

    /// As [`estimate_loss`] of the model. `step` is called before each picture; an error from it ends the work.
    ///
    /// # Errors
    /// Those of `step`.
    pub fn estimate<E>(
        &self,
        version: &Scene,
        mut step: impl FnMut() -> Result<(), E>,
    ) -> Result<LossEstimate, E> {
        let mut worst = WorstSquare::default();
        let around = likeness(&self.around, version, &mut worst, &mut step)?;
        let at_cameras = likeness(&self.at_cameras, version, &mut worst, &mut step)?;
        Ok(LossEstimate { at_cameras, around, worst: worst.viewpoint })
    }
}

/// The loss, if it [casts doubt](LossEstimate::doubts_cameras) on the cameras that chose what a version keeps. If the
/// version shows well around the model, nothing else is drawn or measured.
#[must_use]
pub fn doubted_loss(scene: &Scene, version: &Scene, cameras: &[Camera]) -> Option<LossEstimate> {
    let views = pictures(scene, &around(scene, true));
    let errors =
        views.iter().map(|picture| metrics::squared_error(&picture.of(version), &picture.image));
    let squared_error: f64 = errors.sum();
    if metrics::decibels(squared_error / views.len() as f64) >= DOUBTED_BELOW {
        return None;
    }
    Some(estimate_loss(scene, version, Some(cameras))).filter(LossEstimate::doubts_cameras)
}

/// Cameras around what matters in a model, from all sides if there are other cameras too.
fn around(scene: &Scene, all: bool) -> Vec<Camera> {
    if all { framing::all_around(scene) } else { framing::around(scene, AROUND) }
}

fn some_of(cameras: Option<&[Camera]>) -> Vec<Camera> {
    let cameras = cameras.unwrap_or_default();
    cameras.iter().step_by(cameras.len().div_ceil(GIVEN).max(1)).cloned().collect()
}

/// How alike a version of a model looks in these pictures; `None` if they show nothing, as there is nothing to compare then.
fn likeness<E>(
    pictures: &[Picture],
    version: &Scene,
    worst: &mut WorstSquare,
    step: &mut dyn FnMut() -> Result<(), E>,
) -> Result<Option<Likeness>, E> {
    let (mut squared_error, mut ssim, mut ssimulacra2, mut shows) = (0.0, 0.0, 0.0, false);
    for picture in pictures {
        step()?;
        let (image, shown) = (&picture.image, picture.of(version));
        shows |= image.rgb.iter().any(|&v| v > 0.0);
        squared_error += metrics::squared_error(&shown, image);
        let scores =
            rayon::join(|| metrics::ssim(&shown, image), || metrics::ssimulacra2(&shown, image));
        ssim += scores.0;
        ssimulacra2 += scores.1;
        worst.look(picture, &shown);
    }
    let views = pictures.len();
    let n = views as f64;
    let psnr = metrics::decibels(squared_error / n).min(EQUAL);
    let likeness = Likeness { psnr, ssim: ssim / n, ssimulacra2: ssimulacra2 / n, views };
    Ok(shows.then_some(likeness))
}

/// A quarter of each view of a model.
fn pictures(scene: &Scene, cameras: &[Camera]) -> Vec<Picture> {
    let picture = |(i, camera)| {
        let camera = quarter(camera, i);
        let image = render(scene, &camera, &RenderOptions::default());
        Picture { camera, image }
    };
    cameras.iter().enumerate().map(picture).collect()
}

impl Picture {
    /// The same view of a version of the model.
    fn of(&self, version: &Scene) -> Image {
        render(version, &self.camera, &RenderOptions::default())
    }
}

/// The square with the greatest difference so far.
#[derive(Default)]
struct WorstSquare {
    squared_error: f64,
    viewpoint: Option<Viewpoint>,
}

/// Side of a square whose difference is compared with that of others, pixels.
const SQUARE: usize = 32;

impl WorstSquare {
    /// Compares the squares of a picture.
    fn look(&mut self, Picture { camera, image }: &Picture, shown: &Image) {
        let across = image.width.div_ceil(SQUARE as u32) as usize;
        let down = image.height.div_ceil(SQUARE as u32) as usize;
        let mut squares = vec![0.0; across * down];
        let row = 3 * image.width.max(1) as usize;
        let rows = image.rgb.chunks_exact(row).zip(shown.rgb.chunks_exact(row)).enumerate();
        for (y, (a, b)) in rows {
            let parts = a.chunks(3 * SQUARE).zip(b.chunks(3 * SQUARE));
            for (sum, (a, b)) in squares[y / SQUARE * across..].iter_mut().zip(parts) {
                let difference = |(a, b): (&f32, &f32)| a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0);
                let part: f32 = a.iter().zip(b).map(difference).map(|d| d * d).sum();
                *sum += f64::from(part);
            }
        }
        for (i, squared_error) in squares.into_iter().enumerate() {
            if squared_error > self.squared_error {
                let [x, y] = [i % across, i / across].map(|k| ((k * SQUARE) + SQUARE / 2) as f64);
                let Camera { cx, cy, fx, fy, .. } = *camera;
                let seen = DVec3::new((x - cx) / fx, (y - cy) / fy, 1.0);
                let ahead = (camera.rotation.transpose() * seen).normalize().into();
                let eye = camera.position().into();
                *self = Self { squared_error, viewpoint: Some(Viewpoint { eye, ahead }) };
            }
        }
    }
}

impl LossEstimate {
    /// The worse of both; `None` if the pictures show nothing.
    #[must_use]
    pub fn worse(&self) -> Option<Likeness> {
        let all = [self.at_cameras, self.around].into_iter().flatten();
        all.min_by(|a, b| b.level().cmp(&a.level()).then(a.psnr.total_cmp(&b.psnr)))
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

/// What the PSNR (dB) and the SSIMULACRA2 must reach for these words, both rounded to whole numbers. At 90 SSIMULACRA2
/// means that no difference is seen side by side at a normal distance; 70 is its high, 30 its low quality.
const LEVELS: [(f64, f64, &str); 4] = [
    (50.0, 90.0, "no difference can be seen"),
    (40.0, 80.0, "differences are hard to see"),
    (35.0, 70.0, "small differences show side by side"),
    (Likeness::POOR, 30.0, "differences can be seen"),
];

impl Likeness {
    /// Below this the difference is worth a warning, dB.
    pub const POOR: f64 = 32.0;

    /// What PSNR and SSIMULACRA2 mean: the less favourable of the two.
    #[must_use]
    pub fn meaning(&self) -> &'static str {
        LEVELS.get(self.level()).map_or("differences are easy to see", |level| level.2)
    }

    /// Whether the difference is worth a warning.
    #[must_use]
    pub fn is_poor(&self) -> bool {
        self.level() == LEVELS.len()
    }

    /// The first of the levels that is reached, or their number.
    fn level(&self) -> usize {
        let below = |value: f64, least: f64| value.round() < least;
        let missed = |&(psnr, ssimulacra2, _): &(f64, f64, _)| {
            below(self.psnr, psnr) || below(self.ssimulacra2, ssimulacra2)
        };
        LEVELS.iter().take_while(|level| missed(level)).count()
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
