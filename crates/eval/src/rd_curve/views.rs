//! Pictures of the first views: whole ones side by side as files, and crops for the page.

use std::fs;

use anyhow::{Context, Result};
use finetune::{Photo, RenderOptions, render};
use gs_model::{Camera, Scene};
use image::imageops::{FilterType, resize};

use super::plan::slug;
use super::record::{Picture, Run};
use super::study::Study;
use crate::report::{self, CropView, Shown};
use crate::{measure, pictures};

/// Views of which there are pictures.
const VIEWS: usize = 2;
/// Least width of a picture, pixels: an error of a few pixels is hard to see in one of 240.
const LEAST_WIDTH: u32 = 480;

/// Draws the last curve at its lowest, a middle and the highest rate.
pub(super) fn draw(run: &Run, study: &Study) -> Result<(Vec<Picture>, Vec<CropView>)> {
    let (mut files, mut views) = (Vec::new(), Vec::new());
    let Some(curve) = run.curves.last() else { return Ok((files, views)) };
    // Pictures of earlier settings would stay beside the report and contradict it.
    let dir = study.out.join("pictures");
    if dir.is_dir() {
        fs::remove_dir_all(&dir).with_context(|| format!("clear {}", dir.display()))?;
    }
    fs::create_dir_all(&dir).with_context(|| format!("create {}", dir.display()))?;
    let n = curve.points.len();
    let mut chosen = vec![0, n / 2, n - 1];
    chosen.dedup();
    let mut decoded = Vec::new();
    for point in chosen.iter().filter_map(|&i| curve.points.get(i)) {
        let path = study.out.join(&point.stream);
        let stream = fs::read(&path).with_context(|| format!("read {}", path.display()))?;
        let scene = gsvx::decode(&stream).with_context(|| path.display().to_string())?;
        decoded.push((point, scene));
    }
    for (v, held_out) in study.test.held_out.iter().take(VIEWS).enumerate() {
        let (camera, factor) = enlarged(&held_out.camera);
        let draw = |scene: &Scene| render(scene, &camera, &RenderOptions::default());
        let db = |s: &measure::Score| s.views.get(v).map_or(f64::NAN, |x| x.psnr_db);
        let view = &held_out.camera.name;
        let [w, h] = [held_out.photo.width, held_out.photo.height];
        let photo = Shown::new(
            enlarged_photo(&held_out.photo, factor).image(),
            "photo",
            match factor {
                1 => "The photo, held out from training.".to_owned(),
                _ => format!(
                    "The photo, held out from training. It has {w}x{h} pixels; renders are drawn {factor} times as \
                     large."
                ),
            },
        );
        let mb = report::megabytes(run.original.file_bytes);
        let says = format!("original model, {mb} MB, {:.2} dB", db(&run.original.score));
        let original = Shown::new(draw(&study.test.model), "original", says);
        let mut all = Vec::new();
        for (point, scene) in &decoded {
            let (mb, quality) = (report::megabytes(point.bytes), point.quality);
            let says = format!(
                "{mb} MB ({}, quality {quality:.0}), {:.2} dB",
                curve.name,
                db(&point.score)
            );
            let stem = pictures::stem(view);
            let file = format!("pictures/{stem}-{}-q{quality:.0}.png", slug(&curve.name));
            let caption = format!("photo | {} | {says}", original.caption);
            let shown = Shown::new(draw(scene), &format!("{mb} MB"), says);
            let panel = pictures::side_by_side(&[&photo.image, &original.image, &shown.image]);
            pictures::write(&study.out.join(&file), &panel)?;
            files.push(Picture { file, view: view.clone(), caption });
            all.push(shown);
        }
        views.push(CropView { name: view.clone(), crops: report::crops(photo, original, all)? });
    }
    Ok((files, views))
}

/// The camera whose renders are at least so wide, and the factor.
fn enlarged(camera: &Camera) -> (Camera, u32) {
    let factor = LEAST_WIDTH.div_ceil(camera.width.max(1));
    let larger = camera.scaled_to(factor * camera.width, factor * camera.height);
    match larger.filter(Camera::image_fits) {
        Some(larger) => (larger, factor),
        None => (camera.clone(), 1),
    }
}

/// A photo with more pixels, smooth between those that it has.
fn enlarged_photo(photo: &Photo, factor: u32) -> Photo {
    let pixels = image::RgbImage::from_raw(photo.width, photo.height, photo.rgb.clone());
    let large = pixels
        .filter(|_| factor > 1)
        .map(|p| resize(&p, factor * photo.width, factor * photo.height, FilterType::CatmullRom));
    large
        .and_then(|l| Photo::new(l.width(), l.height(), l.into_raw()))
        .unwrap_or_else(|| photo.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_views_are_drawn_larger() {
        let camera = |size| {
            let (at, up) = ([0.0, 0.0, 1.0], [0.0, -1.0, 0.0]);
            Camera::looking_at("a".into(), [0.0; 3], at, up, size, 99.0)
        };
        let (large, factor) = enlarged(&camera([240, 160]));
        assert_eq!((large.width, large.height, factor), (480, 320, 2));
        assert_eq!((large.fx, large.cx), (198.0, 240.0));
        assert_eq!(enlarged(&camera([480, 320])).1, 1);
        let small = Photo { width: 4, height: 2, rgb: vec![128; 24] };
        let large = enlarged_photo(&small, 3);
        assert_eq!((large.width, large.height), (12, 6));
        assert!(large.rgb.iter().all(|v| v.abs_diff(128) < 3));
    }
}
