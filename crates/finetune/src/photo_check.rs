//! Whether photos are those of their cameras, and of the model's exposure.
//!
//! Photos whose names are mixed up still match the model to 15 or 20 dB, so their PSNR does not reveal it. But such a
//! photo is more like the render of another camera than like that of its own.

use gs_model::Scene;

use crate::forward::render;
use crate::image::Image;
use crate::metrics::psnr;
use crate::options::RenderOptions;
use crate::train_view::TrainView;

/// Photos that are compared with the model; more only take longer.
const VIEWS: usize = 8;
/// Size of the pictures that are compared with each other.
const SIZE: [usize; 2] = [64, 48];
/// A photo is more like another camera's render if less than this part of the difference remains.
const BETTER: f64 = 0.8;
/// Photos of which more than this is unlike their cameras' renders may be of other views.
const UNLIKE: f64 = 0.1;
/// Photos prove their cameras if what their own renders leave unexplained is at most this part of what the renders of
/// other cameras leave. The part is 0.02 to 0.11 on fox, bonsai and office; with cameras 5 % too far from the origin it
/// is 0.26 on fox and 0.23 on bonsai.
const OWN: f64 = 0.2;
/// The exposure differs if fitting it gains more than this, dB.
const EXPOSURE: f64 = 3.0;

/// How some photos match the renders of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoCheck {
    /// Number of photos that were compared.
    pub views: usize,
    /// Those that are more like the render of another camera than like that of their own.
    misplaced: usize,
    /// The part of a photo's variance that its camera's render does not explain, mean.
    pub unlike_own: f64,
    /// The same of renders of other cameras.
    unlike_others: f64,
    /// Mean PSNR of the renders, dB.
    pub psnr: f64,
    /// The same after a gain and an offset of each colour of each photo.
    pub fitted_psnr: f64,
}

impl PhotoCheck {
    /// Compares at most 8 photos, evenly spread, with the renders of a scene. `None` without two photos of their
    /// cameras' sizes.
    #[must_use]
    pub fn of(scene: &Scene, views: &[TrainView]) -> Option<Self> {
        let fits = |v: &TrainView| {
            v.photo.rgb.len() as u64 == 3 * u64::from(v.camera.width) * u64::from(v.camera.height)
        };
        if views.len() < 2 || !views.iter().all(fits) {
            return None;
        }
        let step = views.len().div_ceil(VIEWS).max(1);
        let chosen: Vec<usize> = (0..views.len()).step_by(step).collect();
        let n = chosen.len() as f64;
        let (mut photos, mut renders) = (Vec::new(), Vec::new());
        let mut out = Self {
            views: chosen.len(),
            misplaced: 0,
            unlike_own: 0.0,
            unlike_others: 0.0,
            psnr: 0.0,
            fitted_psnr: 0.0,
        };
        for &i in &chosen {
            let shown = render(scene, &views[i].camera, &RenderOptions::default());
            let photo = views[i].photo.image();
            out.psnr += psnr(&shown, &photo).min(100.0) / n;
            out.fitted_psnr += psnr(&fitted(&shown, &photo), &photo).min(100.0) / n;
            photos.push(Picture::of(&photo));
            renders.push(Picture::of(&shown));
        }
        let own: Vec<f64> = photos.iter().zip(&renders).map(|(p, r)| p.unlike(r)).collect();
        out.unlike_own = own.iter().sum::<f64>() / n;
        for (k, (&i, photo)) in chosen.iter().zip(&photos).enumerate() {
            let others = renders.iter().enumerate().filter(|(j, _)| *j != k);
            let mut unlike: Vec<f64> = others.map(|(_, r)| photo.unlike(r)).collect();
            out.unlike_others += unlike.iter().sum::<f64>() / unlike.len().max(1) as f64 / n;
            // Where names are off by one, a photo is that of the camera before or after its own.
            if out.unlike_own > UNLIKE {
                let beside = [i.checked_sub(1), Some(i + 1).filter(|&next| next < views.len())];
                unlike.extend(beside.into_iter().flatten().map(|j| {
                    let shown = render(scene, &views[j].camera, &RenderOptions::default());
                    photo.unlike(&Picture::of(&shown))
                }));
            }
            out.misplaced += usize::from(unlike.iter().any(|&other| other < BETTER * own[k]));
        }
        Some(out)
    }

    /// Whether the photos seem to be of other views than their cameras'.
    #[must_use]
    pub fn of_other_views(&self) -> bool {
        let no_better = self.unlike_own > BETTER * self.unlike_others;
        self.unlike_own > UNLIKE && (2 * self.misplaced > self.views || no_better)
    }

    /// Whether the photos show the model, well or far better at their own cameras than at others: then the cameras are
    /// its own.
    #[must_use]
    pub fn proves_cameras(&self) -> bool {
        let are_own = self.misplaced == 0 && self.unlike_own <= OWN * self.unlike_others;
        self.unlike_own <= UNLIKE || are_own
    }

    /// Whether the photos are exposed differently from the model.
    #[must_use]
    pub fn of_other_exposure(&self) -> bool {
        self.fitted_psnr > self.psnr + EXPOSURE
    }
}

/// A small picture without its mean: three planes.
struct Picture([Vec<f64>; 3]);

impl Picture {
    /// Means over the cells of a grid.
    fn of(image: &Image) -> Self {
        let [w, h] = [image.width as usize, image.height as usize];
        let plane = |channel: usize| {
            let mut cells = vec![(0.0f64, 0.0f64); SIZE[0] * SIZE[1]];
            for y in 0..h {
                for x in 0..w {
                    let cell = &mut cells[y * SIZE[1] / h * SIZE[0] + x * SIZE[0] / w];
                    let value = f64::from(image.rgb[3 * (y * w + x) + channel].clamp(0.0, 1.0));
                    *cell = (cell.0 + value, cell.1 + 1.0);
                }
            }
            // An image smaller than the grid leaves cells empty, the same ones in each picture of its size.
            let values: Vec<f64> = cells.iter().map(|c| c.0 / c.1.max(1.0)).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            values.iter().map(|v| v - mean).collect()
        };
        Self([0, 1, 2].map(plane))
    }

    /// The part of the variance that is left when a gain, not below zero, and an offset fit the other to this.
    fn unlike(&self, other: &Self) -> f64 {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let (mut left, mut all, mut shown) = (0.0, 0.0, 0.0);
        for (a, b) in self.0.iter().zip(&other.0) {
            let (aa, ab, bb) = (dot(a, a), dot(a, b).max(0.0), dot(b, b));
            all += aa;
            shown += bb;
            left += if bb > 0.0 { aa - ab * ab / bb } else { aa };
        }
        // A photo of one colour is wholly unlike a render that shows something.
        if all > 0.0 { left / all } else { f64::from(u8::from(shown > 0.0)) }
    }
}

/// The render with the gain and the offset of each colour that fit it to the photo best.
fn fitted(render: &Image, photo: &Image) -> Image {
    let mut out = render.clone();
    let n = (render.rgb.len() / 3).max(1) as f64;
    for channel in 0..3 {
        let pairs = || {
            let of =
                |image: &Image, k: usize| f64::from(image.rgb[3 * k + channel].clamp(0.0, 1.0));
            (0..render.rgb.len() / 3).map(move |k| (of(render, k), of(photo, k)))
        };
        let (x, y) = pairs().fold((0.0, 0.0), |sum, (x, y)| (sum.0 + x / n, sum.1 + y / n));
        let cov: f64 = pairs().map(|p| (p.0 - x) * (p.1 - y)).sum();
        let var: f64 = pairs().map(|p| (p.0 - x) * (p.0 - x)).sum();
        let gain = if var > 0.0 { cov / var } else { 0.0 };
        for value in out.rgb[channel..].iter_mut().step_by(3) {
            *value = (y + gain * (f64::from(value.clamp(0.0, 1.0)) - x)) as f32;
        }
    }
    out
}
