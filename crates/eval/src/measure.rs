//! Renders a scene at a set of views and compares the renders with the photos.

use anyhow::Result;
use finetune::metrics::Scores;
use finetune::{Image, RenderOptions, TrainView};
use gs_model::Scene;
use gs_model::View;
use serde::{Deserialize, Serialize};

use crate::progress::Bar;

/// What curves are compared by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Metric {
    Psnr,
    Ssim,
    Ssimulacra2,
}

impl Metric {
    pub(crate) const ALL: [Self; 3] = [Self::Psnr, Self::Ssim, Self::Ssimulacra2];

    /// For tables and charts.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Psnr => "PSNR",
            Self::Ssim => "SSIM",
            Self::Ssimulacra2 => "SSIMULACRA2",
        }
    }

    /// With its unit.
    pub(crate) fn words(self, value: f64) -> String {
        match self {
            Self::Psnr => format!("{value:.2} dB"),
            Self::Ssim => format!("{value:.4}"),
            Self::Ssimulacra2 => format!("{value:.1}"),
        }
    }

    /// Its mean over the views.
    pub(crate) fn of(self, score: &Score) -> f64 {
        match self {
            Self::Psnr => score.psnr_db,
            Self::Ssim => score.ssim,
            Self::Ssimulacra2 => score.ssimulacra2,
        }
    }
}

/// Quality of a scene at one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewScore {
    /// Photo name.
    pub view: String,
    /// PSNR of the clamped float render against the 8-bit photo, dB.
    pub psnr_db: f64,
    /// Mean SSIM.
    pub ssim: f64,
    /// SSIMULACRA2 of the render in 8 bits.
    pub ssimulacra2: f64,
}

/// Quality of a scene over views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Mean over views of the PSNR in dB (as the reference code: not the dB of the mean error).
    pub psnr_db: f64,
    /// Mean over views of the SSIM.
    pub ssim: f64,
    /// Mean over views of the SSIMULACRA2.
    pub ssimulacra2: f64,
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
        let Scores { psnr, ssim, ssimulacra2 } = Scores::of(&render, &view.photo.image());
        scores.push(ViewScore { view: view.camera.name.clone(), psnr_db: psnr, ssim, ssimulacra2 });
        renders.push(render);
        bar.step(1);
    }
    (Score::of(scores), renders)
}

/// Mean PSNR of a scene at the views against their photos, dB.
pub(crate) fn psnr_db(scene: &Scene, views: &[TrainView]) -> f64 {
    views.iter().map(|view| view.psnr(scene)).sum::<f64>() / views.len().max(1) as f64
}

impl Score {
    fn of(views: Vec<ViewScore>) -> Self {
        let n = views.len().max(1) as f64;
        Self {
            psnr_db: views.iter().map(|v| v.psnr_db).sum::<f64>() / n,
            ssim: views.iter().map(|v| v.ssim).sum::<f64>() / n,
            ssimulacra2: views.iter().map(|v| v.ssimulacra2).sum::<f64>() / n,
            views,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decibels_are_averaged_not_errors() {
        let view =
            |psnr_db| ViewScore { view: String::new(), psnr_db, ssim: 0.5, ssimulacra2: 70.0 };
        let score = Score::of(vec![view(20.0), view(40.0)]);
        assert_eq!(score.psnr_db, 30.0);
    }
}
