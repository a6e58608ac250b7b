//! Pictures: PNG files, and what shows the difference of two images.

use crate::output::Output;
use anyhow::Result;
use finetune::Image;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::path::{Component, Path};

/// Factor on the differences that are drawn: an error of an eighth of full scale, 18 dB, is white.
const AMPLIFIED: f32 = 8.0;
/// Columns between two images side by side.
const GAP: u32 = 8;

/// Writes an image as PNG.
pub(crate) fn write(image: &Image, output: Output) -> Result<()> {
    let mut png = Vec::new();
    let (rgb, colour) = (image.to_rgb8(), ExtendedColorType::Rgb8);
    PngEncoder::new(&mut png).write_image(&rgb, image.width, image.height, colour)?;
    output.write(|out| Ok(out.write_all(&png)?))?;
    Ok(())
}

/// The reference, the model and their amplified difference, from left to right.
pub(crate) fn side_by_side(reference: &Image, model: &Image) -> Image {
    let (width, height) = (reference.width, reference.height);
    let clamped = |v: f32| v.clamp(0.0, 1.0);
    let pairs = reference.rgb.iter().zip(&model.rgb);
    let rgb = pairs.map(|(&a, &b)| AMPLIFIED * (clamped(a) - clamped(b)).abs()).collect();
    let difference = Image { width, height, rgb };
    let parts = [reference, model, &difference];
    let mut out = Image::new(3 * width + 2 * GAP, height);
    out.rgb.fill(1.0);
    let (row, wide) = (3 * width as usize, 3 * out.width as usize);
    for (k, part) in parts.into_iter().enumerate() {
        let first = k * (row + 3 * GAP as usize);
        for (to, from) in out.rgb.chunks_exact_mut(wide).zip(part.rgb.chunks_exact(row)) {
            to[first..first + row].copy_from_slice(from);
        }
    }
    out
}

/// A name for a file from that of a camera: photos may lie in folders of their own, so that
/// `a/b.jpg` becomes `a-b`. None if nothing is left.
pub(crate) fn stem(camera: &str) -> Option<String> {
    let stem = Path::new(camera).with_extension("");
    let parts = stem.components().filter_map(|c| match c {
        Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
        _ => None,
    });
    let parts: Vec<String> = parts.collect();
    // What Windows allows in no file name.
    let name = parts.join("-").replace(['<', '>', ':', '"', '|', '?', '*', '\\'], "_");
    (!name.is_empty()).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_difference_is_amplified_beside_the_images() {
        let a = Image { width: 1, height: 2, rgb: vec![0.5, 0.0, 1.0, 0.2, 0.2, 0.2] };
        let b = Image { width: 1, height: 2, rgb: vec![0.5, 0.01, 7.0, 0.2, 0.2, 0.3] };
        let out = side_by_side(&a, &b);
        assert_eq!((out.width, out.height), (3 + 2 * GAP, 2));
        let last = out.rgb.len() / 2 - 3;
        let shown = &out.rgb[last..last + 3];
        assert!(shown[0] == 0.0 && (shown[1] - 0.08).abs() < 1e-6 && shown[2] == 0.0, "{shown:?}");
        assert_eq!(out.rgb[..3], a.rgb[..3]);
    }

    #[test]
    fn names_of_cameras_become_names_of_files() {
        assert_eq!(stem("a/b.jpg").as_deref(), Some("a-b"));
        assert_eq!(stem("x:1.png").as_deref(), Some("x_1"));
        assert_eq!(stem(""), None);
    }
}
