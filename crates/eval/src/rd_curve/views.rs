//! Crops of the first views, for the page.

use std::fs;

use anyhow::{Context, Result};
use finetune::{RenderOptions, render};
use gs_model::Scene;

use crate::measure::Score;
use crate::record::Run;
use crate::report::{self, CropView, LabelledImage};
use crate::study::Study;

/// Views of which there are pictures.
const VIEWS: usize = 2;

/// Draws the last curve at its lowest, a middle and the highest rate.
pub(super) fn draw(run: &Run, study: &Study) -> Result<Vec<CropView>> {
    let Some(curve) = run.curves.last() else { return Ok(Vec::new()) };
    let n = curve.points.len();
    let mut chosen = vec![0, n / 2, n.saturating_sub(1)];
    chosen.dedup();
    let mut decoded = Vec::new();
    for point in chosen.iter().filter_map(|&i| curve.points.get(i)) {
        let path = study.out.join(&point.stream);
        let stream = fs::read(&path).with_context(|| format!("read {}", path.display()))?;
        let scene = gsvx::decode(&stream).with_context(|| path.display().to_string())?;
        decoded.push((point, scene));
    }
    let held_out = study.test.held_out.iter().take(VIEWS).enumerate();
    let views = held_out.map(|(v, held_out)| {
        let draw = |scene: &Scene| render(scene, &held_out.camera, &RenderOptions::default());
        let db = |s: &Score| s.views.get(v).map_or(f64::NAN, |x| x.psnr_db);
        let shown =
            |image, label: &str, caption| LabelledImage { image, label: label.into(), caption };
        let says = "The photo, held out from training.".to_owned();
        let photo = shown(held_out.photo.image(), "photo", says);
        let original = &run.original;
        let says =
            format!("original model, {} MB, {:.2} dB", original.megabytes(), db(&original.score));
        let original = shown(draw(&study.test.model), "original", says);
        let decoded = decoded.iter().map(|(point, scene)| {
            let (mb, quality, db) = (point.megabytes(), point.quality, db(&point.score));
            let says = format!("{mb} MB ({}, quality {quality:.0}), {db:.2} dB", curve.name);
            shown(draw(scene), &format!("{mb} MB"), says)
        });
        let crops = report::crops(photo, original, decoded.collect())?;
        Ok(CropView { name: held_out.camera.name.clone(), crops })
    });
    views.collect()
}
