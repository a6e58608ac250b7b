//! Pictures of small views, drawn larger: an error of a few pixels is hard to see in a picture of 240.

use finetune::{Image, RenderOptions, render};
use gs_model::{Camera, Scene};
use image::imageops::{FilterType, resize};

/// Least width of a picture on a page, pixels.
const LEAST_WIDTH: u32 = 480;

/// The camera whose renders are at least so wide, and the factor; `None` if the view is large enough.
pub(super) fn larger(camera: &Camera) -> Option<(Camera, u32)> {
    let factor = LEAST_WIDTH.div_ceil(camera.width.max(1));
    let larger = camera.scaled_to(factor * camera.width, factor * camera.height)?;
    (factor > 1 && larger.image_fits()).then_some((larger, factor))
}

/// What the camera sees.
pub(super) fn drawn(scene: &Scene, camera: &Camera) -> Image {
    render(scene, camera, &RenderOptions::default())
}

/// A photo with more pixels, smooth between those that it has.
pub(super) fn photo(photo: &Image, factor: u32) -> Image {
    let pixels = image::RgbImage::from_raw(photo.width, photo.height, photo.to_rgb8());
    let large = pixels
        .map(|p| resize(&p, factor * photo.width, factor * photo.height, FilterType::CatmullRom));
    large
        .and_then(|l| Image::from_rgb8(l.width(), l.height(), l.as_raw()))
        .unwrap_or_else(|| photo.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pictures_of_the_page_were_as_small_as_the_photos() {
        let camera = |w, h| {
            Camera::looking_at(
                "a".into(),
                [0.0; 3],
                [0.0, 0.0, 1.0],
                [0.0, -1.0, 0.0],
                [w, h],
                99.0,
            )
        };
        let (large, factor) = larger(&camera(240, 160)).unwrap();
        assert_eq!((large.width, large.height, factor), (480, 320, 2));
        assert_eq!((large.fx, large.cx), (198.0, 240.0));
        assert!(larger(&camera(480, 320)).is_none());
        let mut small = Image::new(4, 2);
        small.rgb.fill(0.5);
        let large = photo(&small, 3);
        assert_eq!((large.width, large.height), (12, 6));
        assert!(large.rgb.iter().all(|v| (v - 0.5).abs() < 0.01));
    }
}
