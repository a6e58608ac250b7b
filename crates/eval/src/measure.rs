//! Renders a scene at a set of views and compares the renders with the photos.

use anyhow::Result;
use finetune::{Image, RenderOptions, TrainView, metrics};
use gs_model::Scene;
use gs_model::View;
use serde::{Deserialize, Serialize};

use crate::progress::Bar;

/// Quality of a scene at one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewScore {
    /// Photo name.
    pub view: String,
    /// PSNR of the clamped float render against the 8-bit photo, dB.
    pub psnr_db: f64,
    /// Mean SSIM.
    pub ssim: f64,
}

/// Quality of a scene over views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Mean over views of the PSNR in dB (as the reference code: not the dB of the mean error).
    pub psnr_db: f64,
    /// Mean over views of the SSIM.
    pub ssim: f64,
    /// Each view.
    pub views: Vec<ViewScore>,
}

/// Reads the photos of `views`. A camera is scaled to the size of its photo.
///
/// # Errors
/// If a photo cannot be read, or has another aspect ratio than its camera.
pub fn load<'a>(views: impl IntoIterator<Item = &'a View>) -> Result<Vec<TrainView>> {
    let load = |view: &View| Ok(tune::photo(&view.camera, &view.image_path)?);
    views.into_iter().map(load).collect()
}

/// Renders `scene` at all views and compares with the photos. Returns the renders too, in the order
/// of the views.
#[must_use]
pub fn score(scene: &Scene, views: &[TrainView], bar: &Bar) -> (Score, Vec<Image>) {
    let options = RenderOptions::default();
    let mut scores = Vec::with_capacity(views.len());
    let mut renders = Vec::with_capacity(views.len());
    for view in views {
        let render = finetune::render(scene, &view.camera, &options);
        let photo = view.photo.image();
        scores.push(ViewScore {
            view: view.camera.name.clone(),
            psnr_db: metrics::psnr(&render, &photo),
            ssim: metrics::ssim(&render, &photo),
        });
        renders.push(render);
        bar.step(1);
    }
    (Score::of(scores), renders)
}

/// Mean PSNR of a scene at the views against their photos, dB.
pub(crate) fn psnr_db(scene: &Scene, views: &[TrainView]) -> f64 {
    score(scene, views, &Bar::hidden()).0.psnr_db
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
