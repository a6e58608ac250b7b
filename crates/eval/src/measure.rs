//! Renders a scene at a set of views and compares the renders with the photos.

use std::time::Instant;

use anyhow::Result;
use finetune::metrics::Scores;
use finetune::{RenderOptions, TrainView};
use gs_model::{Scene, View};
use serde::{Deserialize, Deserializer, Serialize};

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
    #[serde(deserialize_with = "unknown_if_null")]
    pub psnr_db: f64,
    /// Mean SSIM.
    #[serde(deserialize_with = "unknown_if_null")]
    pub ssim: f64,
    /// SSIMULACRA2 of the render in 8 bits.
    #[serde(deserialize_with = "unknown_if_null")]
    pub ssimulacra2: f64,
}

/// Quality of a scene over views: means over the views, NaN where nobody measured them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// PSNR in dB (the mean of the dB, as in the reference code: not the dB of the mean error).
    #[serde(deserialize_with = "unknown_if_null")]
    pub psnr_db: f64,
    /// SSIM.
    #[serde(deserialize_with = "unknown_if_null")]
    pub ssim: f64,
    /// SSIMULACRA2.
    #[serde(deserialize_with = "unknown_if_null")]
    pub ssimulacra2: f64,
    /// Each view.
    pub views: Vec<ViewScore>,
    /// Seconds to render and compare all views.
    pub seconds: f64,
}

/// JSON has no NaN.
fn unknown_if_null<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::NAN))
}

/// Reads the photos of `views`. A camera is scaled to the size of its photo.
///
/// # Errors
/// If a photo cannot be read, or has another aspect ratio than its camera.
pub fn load<'a>(views: impl IntoIterator<Item = &'a View>) -> Result<Vec<TrainView>> {
    let load = |view: &View| Ok(tune::photo(&view.camera, &view.image_path)?);
    views.into_iter().map(load).collect()
}

/// Renders `scene` at all views and compares with the photos. `name` is what progress calls the scene.
#[must_use]
pub fn score(name: &str, scene: &Scene, views: &[TrainView]) -> Score {
    let started = Instant::now();
    let bar = Bar::new(&format!("render {name}"), views.len() as u64);
    let score = |view: &TrainView| {
        let render = finetune::render(scene, &view.camera, &RenderOptions::default());
        let Scores { psnr, ssim, ssimulacra2 } = Scores::of(&render, &view.photo.image());
        bar.step(1);
        ViewScore { view: view.camera.name.clone(), psnr_db: psnr, ssim, ssimulacra2 }
    };
    let views = views.iter().map(score).collect();
    bar.done();
    Score::of(views, started.elapsed().as_secs_f64())
}

/// Mean PSNR of a scene at the views against their photos, dB.
pub(crate) fn psnr_db(scene: &Scene, views: &[TrainView]) -> f64 {
    views.iter().map(|view| view.psnr(scene)).sum::<f64>() / views.len().max(1) as f64
}

impl Default for Score {
    fn default() -> Self {
        Self {
            psnr_db: f64::NAN,
            ssim: f64::NAN,
            ssimulacra2: f64::NAN,
            views: vec![],
            seconds: 0.,
        }
    }
}

impl Score {
    fn of(views: Vec<ViewScore>, seconds: f64) -> Self {
        let n = views.len().max(1) as f64;
        let mean = |of: fn(&ViewScore) -> f64| views.iter().map(of).sum::<f64>() / n;
        let (psnr_db, ssim) = (mean(|v| v.psnr_db), mean(|v| v.ssim));
        Self { psnr_db, ssim, ssimulacra2: mean(|v| v.ssimulacra2), views, seconds }
    }

    /// The least value at a view.
    pub(crate) fn worst(&self, of: fn(&ViewScore) -> f64) -> f64 {
        self.views.iter().map(of).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decibels_are_averaged_not_errors() {
        let view =
            |psnr_db| ViewScore { view: String::new(), psnr_db, ssim: 0.5, ssimulacra2: 70.0 };
        assert_eq!(Score::of(vec![view(20.0), view(40.0)], 0.0).psnr_db, 30.0);
    }

    #[test]
    fn what_nobody_measured_stays_unknown_in_a_file() {
        let text = serde_json::to_string(&Score::default()).unwrap();
        let back: Score = serde_json::from_str(&text).unwrap();
        assert!(back.psnr_db.is_nan() && back.ssim.is_nan() && back.ssimulacra2.is_nan(), "{text}");
    }
}
