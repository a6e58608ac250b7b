//! The part of a view where the decoded model differs most, as pictures to flip through.

use std::io::Cursor;

use anyhow::{Context, Result};
use finetune::Image;
use image::imageops::crop_imm;
use image::{ImageFormat, RgbImage};

/// Largest crop, pixels.
const CROP: (usize, usize) = (480, 360);
/// Differences are shown this many times as strong.
const AMPLIFY: f32 = 8.0;
/// Crops begin at multiples of this.
const STRIDE: usize = 8;

/// A view with its crops.
#[derive(Clone, Debug)]
pub(crate) struct CropView {
    /// Photo name.
    pub(crate) name: String,
    /// The same window of several pictures.
    pub(crate) crops: Vec<Crop>,
}

/// A picture of a view.
pub(crate) struct LabelledImage {
    pub(crate) image: Image,
    /// Text of its button.
    pub(crate) label: String,
    /// Below it.
    pub(crate) caption: String,
}

/// One picture of a page.
#[derive(Clone, Debug)]
pub(crate) struct Crop {
    pub(crate) label: String,
    pub(crate) caption: String,
    /// Shown first.
    pub(crate) shown: bool,
    /// PNG file.
    pub(crate) png: Vec<u8>,
}

/// Cuts one window out of photo, original and decoded renders, and adds the differences of the
/// decoded from the original. The window is where the first of them differs most.
pub(crate) fn crops(
    photo: LabelledImage,
    original: LabelledImage,
    decoded: Vec<LabelledImage>,
) -> Result<Vec<Crop>> {
    let Some(worst) = decoded.first() else { return Ok(Vec::new()) };
    let window = window(&original.image, &worst.image);
    let difference = |of: &LabelledImage| LabelledImage {
        image: difference(&original.image, &of.image),
        label: format!("difference, {}", of.label),
        caption: format!(
            "Difference of {} from the original model's render, {AMPLIFY:.0} times as strong.",
            of.label
        ),
    };
    let differences: Vec<LabelledImage> = decoded.iter().map(difference).collect();
    let first = 2 + decoded.len() / 2;
    let all = [photo, original].into_iter().chain(decoded).chain(differences);
    let crop = |(i, LabelledImage { image, label, caption }): (usize, LabelledImage)| {
        Ok(Crop { label, caption, shown: i == first, png: png(&image, window)? })
    };
    all.enumerate().map(crop).collect()
}

/// Column, row, width, height.
type Window = (usize, usize, usize, usize);

/// The window of greatest squared difference.
fn window(a: &Image, b: &Image) -> Window {
    let (w, h) = (a.width as usize, a.height as usize);
    let (cw, ch) = (CROP.0.min(w), CROP.1.min(h));
    // Sums over all rectangles from the corner.
    let mut sums = vec![0.0f64; (w + 1) * (h + 1)];
    for y in 0..h {
        let mut row = 0.0;
        for x in 0..w {
            let at = 3 * (y * w + x);
            let d = |i: usize| f64::from(a.rgb[at + i] - b.rgb.get(at + i).copied().unwrap_or(0.0));
            row += (0..3).map(|i| d(i) * d(i)).sum::<f64>();
            sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
        }
    }
    let sum = |x: usize, y: usize| {
        let s = |x: usize, y: usize| sums[y * (w + 1) + x];
        s(x + cw, y + ch) - s(x, y + ch) - s(x + cw, y) + s(x, y)
    };
    let mut best = (0, 0, f64::NEG_INFINITY);
    for y in (0..=h - ch).step_by(STRIDE) {
        for x in (0..=w - cw).step_by(STRIDE) {
            let value = sum(x, y);
            if value > best.2 {
                best = (x, y, value);
            }
        }
    }
    (best.0, best.1, cw, ch)
}

/// A window of an image as the bytes of an 8-bit PNG file.
fn png(image: &Image, window: Window) -> Result<Vec<u8>> {
    let rgb = RgbImage::from_raw(image.width, image.height, image.to_rgb8());
    let (x, y, w, h) = window;
    let [x, y, w, h] = [x, y, w, h].map(|v| v as u32);
    let mut out = Cursor::new(Vec::new());
    let part = crop_imm(&rgb.context("the size of an image")?, x, y, w, h).to_image();
    part.write_to(&mut out, ImageFormat::Png)?;
    Ok(out.into_inner())
}

fn difference(a: &Image, b: &Image) -> Image {
    let mut out = Image::new(a.width, a.height);
    for (o, (x, y)) in out.rgb.iter_mut().zip(a.rgb.iter().zip(&b.rgb)) {
        *o = ((x - y).abs() * AMPLIFY).min(1.0);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_is_where_the_error_is() {
        let plain = Image::new(800, 600);
        let mut spoilt = plain.clone();
        for y in 400..420 {
            for x in 700..720 {
                spoilt.rgb[3 * (y * 800 + x)] = 0.1;
            }
        }
        let (x, y, w, h) = window(&plain, &spoilt);
        assert_eq!((w, h), CROP);
        assert!(
            (x..x + w).contains(&700) && x + w >= 720 && (y..y + h).contains(&400) && y + h >= 420
        );
        let seen = difference(&plain, &spoilt);
        let bright = seen.rgb.iter().filter(|v| (**v - 0.8).abs() < 1e-5).count();
        assert_eq!(bright, 400);
    }

    #[test]
    fn a_view_has_photo_original_decoded_and_differences() {
        let image = Image::new(40, 30);
        let shown = |name: &str| LabelledImage {
            image: image.clone(),
            label: name.into(),
            caption: String::new(),
        };
        let decoded = vec![shown("a"), shown("b")];
        let all = crops(shown("photo"), shown("original"), decoded).unwrap();
        let labels: Vec<&str> = all.iter().map(|c| c.label.as_str()).collect();
        assert_eq!(labels, ["photo", "original", "a", "b", "difference, a", "difference, b"]);
        assert_eq!(all.iter().filter(|c| c.shown).count(), 1);
        assert_eq!(image::load_from_memory(&all[0].png).unwrap().width(), 40);
    }
}
