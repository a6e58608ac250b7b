//! Renders a scene at a set of views and compares the renders with the photos.

use std::path::Path;

use anyhow::{Context, Result, bail};
use finetune::{Image, RenderOptions, metrics};
use gs_model::Scene;
use gs_model::dataset::View;
use serde::{Deserialize, Serialize};

use crate::progress::Bar;

/// A camera with its photo in memory.
pub(crate) struct Shot {
    pub(crate) view: View,
    pub(crate) photo: Image,
}

/// Quality of a scene at one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ViewScore {
    /// Photo name.
    pub(crate) view: String,
    /// PSNR of the clamped float render against the 8-bit photo, dB.
    pub(crate) psnr_db: f64,
    /// Mean SSIM.
    pub(crate) ssim: f64,
}

/// Quality of a scene over views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Score {
    /// Mean over views of the PSNR in dB (as the reference code: not the dB of the mean error).
    pub(crate) psnr_db: f64,
    /// Mean over views of the SSIM.
    pub(crate) ssim: f64,
    /// Each view.
    pub(crate) views: Vec<ViewScore>,
}

/// Reads an 8-bit photo.
pub(crate) fn read_photo(path: &Path) -> Result<Image> {
    let decoded = image::ImageReader::open(path)
        .with_context(|| format!("open photo {}", path.display()))?
        .with_guessed_format()
        .with_context(|| format!("read photo {}", path.display()))?
        .decode()
        .with_context(|| format!("decode photo {} (PNG or JPEG expected)", path.display()))?;
    let rgb = decoded.to_rgb8();
    let (width, height) = rgb.dimensions();
    Image::from_rgb8(width, height, rgb.as_raw())
        .with_context(|| format!("photo {} has an impossible size", path.display()))
}

/// Loads the photos of `views`.
pub(crate) fn load<'a>(views: impl IntoIterator<Item = &'a View>) -> Result<Vec<Shot>> {
    let load = |view: &View| {
        let photo = read_photo(&view.image_path)?;
        let camera = &view.camera;
        let Some(scaled) = camera.scaled_to(photo.width, photo.height) else {
            bail!(
                "photo {} is {}x{} pixels but its camera says {}x{}, which is not the same view: \
                 use the photos that the cameras were made for",
                view.image_path.display(),
                photo.width,
                photo.height,
                camera.width,
                camera.height
            );
        };
        Ok(Shot { view: View { camera: scaled, ..view.clone() }, photo })
    };
    views.into_iter().map(load).collect()
}

/// Scores `scene` at all shots; the renders come back in the same order.
pub(crate) fn score(scene: &Scene, shots: &[Shot], bar: &Bar) -> (Score, Vec<Image>) {
    let options = RenderOptions::default();
    let mut views = Vec::with_capacity(shots.len());
    let mut renders = Vec::with_capacity(shots.len());
    for shot in shots {
        let render = finetune::render(scene, &shot.view.camera, &options);
        views.push(ViewScore {
            view: shot.view.camera.name.clone(),
            psnr_db: metrics::psnr(&render, &shot.photo),
            ssim: metrics::ssim(&render, &shot.photo),
        });
        renders.push(render);
        bar.step(1);
    }
    (Score::of(views), renders)
}

impl Score {
    fn of(views: Vec<ViewScore>) -> Self {
        let n = views.len().max(1) as f64;
        Self {
            psnr_db: views.iter().map(|v| v.psnr_db).sum::<f64>() / n,
            ssim: views.iter().map(|v| v.ssim).sum::<f64>() / n,
            views,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decibels_are_averaged_not_errors() {
        let view = |psnr_db| ViewScore { view: String::new(), psnr_db, ssim: 0.5 };
        let score = Score::of(vec![view(20.0), view(40.0)]);
        assert_eq!(score.psnr_db, 30.0);
    }
}
