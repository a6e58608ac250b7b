//! PNG files: renders, and photo, original and decoded side by side.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use finetune::Image;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

/// Grey gap between panels, pixels.
const GAP: usize = 4;

/// A photo's name without folder and extension, safe as part of a file name.
pub(crate) fn stem(name: &str) -> String {
    let name = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    let safe = |c: char| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '_' };
    stem.chars().map(safe).collect()
}

/// Writes an image as 8-bit PNG.
pub(crate) fn write(path: &Path, image: &Image) -> Result<()> {
    write_rgb8(path, &image.to_rgb8(), image.width, image.height)
}

/// Writes interleaved RGB bytes as PNG.
pub(crate) fn write_rgb8(path: &Path, rgb: &[u8], width: u32, height: u32) -> Result<()> {
    let file = fs::File::create(path).with_context(|| format!("create {}", path.display()))?;
    let file = std::io::BufWriter::new(file);
    encode_rgb8(file, rgb, width, height).with_context(|| format!("write {}", path.display()))
}

/// An image as the bytes of an 8-bit PNG file.
pub(crate) fn encode(image: &Image) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    encode_rgb8(&mut out, &image.to_rgb8(), image.width, image.height).context("encode a PNG")?;
    Ok(out)
}

fn encode_rgb8(
    out: impl std::io::Write,
    rgb: &[u8],
    width: u32,
    height: u32,
) -> image::ImageResult<()> {
    PngEncoder::new_with_quality(out, CompressionType::Best, FilterType::Adaptive).write_image(
        rgb,
        width,
        height,
        ExtendedColorType::Rgb8,
    )
}

/// Images of equal height next to each other, with a gap.
pub(crate) fn side_by_side(panels: &[&Image]) -> Image {
    let height = panels.iter().map(|p| p.height).max().unwrap_or(0);
    let gaps = GAP * panels.len().saturating_sub(1);
    let width = panels.iter().map(|p| p.width as usize).sum::<usize>() + gaps;
    let mut out = Image::new(width as u32, height);
    out.rgb.fill(0.5);
    let mut x = 0;
    for panel in panels {
        let w = panel.width as usize;
        for (y, row) in panel.rgb.chunks_exact(3 * w.max(1)).enumerate() {
            let at = 3 * (y * width + x);
            out.rgb[at..at + 3 * w].copy_from_slice(row);
        }
        x += w + GAP;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_keep_their_pixels() {
        let solid = |v: f32| Image { width: 2, height: 2, rgb: vec![v; 12] };
        let both = side_by_side(&[&solid(0.0), &solid(1.0)]);
        assert_eq!((both.width, both.height), (8, 2));
        let red = |x: usize, y: usize| both.rgb[3 * (y * 8 + x)];
        assert_eq!(
            [red(1, 1), red(2, 1), red(5, 0), red(6, 1), red(7, 1)],
            [0.0, 0.5, 0.5, 1.0, 1.0]
        );
    }

    #[test]
    fn stems_are_safe() {
        assert_eq!(stem("a/b c.d.png"), "b_c_d");
        assert_eq!(stem("x"), "x");
    }
}
