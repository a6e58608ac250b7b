//! PSNR, SSIM and SSIMULACRA2.
//!
//! LPIPS is not among them: its network's weights are not part of this project.

use fast_ssim2::{PixelDescriptor, PixelSlice, compute_ssimulacra2};
use multiversion::multiversion;

use crate::image::{Image, Photo};

/// How much a picture looks like another, by three measures. More is better.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scores {
    /// [`psnr`], dB.
    pub psnr: f64,
    /// [`ssim`].
    pub ssim: f64,
    /// [`ssimulacra2`].
    pub ssimulacra2: f64,
}

impl Scores {
    /// Scores `image` against `reference`.
    #[must_use]
    pub fn of(image: &Image, reference: &Image) -> Self {
        let (ssimulacra2, (psnr, ssim)) = rayon::join(
            || ssimulacra2(image, reference),
            || (psnr(image, reference), ssim(image, reference)),
        );
        Self { psnr, ssim, ssimulacra2 }
    }

    /// The mean of each score over some views; NaN without any.
    #[must_use]
    pub fn mean(scores: &[Self]) -> Self {
        let mean = |of: fn(&Self) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
        let (psnr, ssim) = (mean(|s| s.psnr), mean(|s| s.ssim));
        Self { psnr, ssim, ssimulacra2: mean(|s| s.ssimulacra2) }
    }
}

/// PSNR in dB, peak 1, over all pixels and channels; values of `a` and `b` are clamped to 0..=1
/// first. Infinite for equal images; NaN if the sizes differ or the images are empty.
///
/// For a figure of a scene, average the dB over the views (not the errors), with the float
/// render as `a` and the 8-bit photo as `b`: the convention of the 3DGS literature.
#[must_use]
pub fn psnr(a: &Image, b: &Image) -> f64 {
    decibels(squared_error(a, b))
}

impl Photo {
    /// PSNR of a render against the photo, dB; at most 100.
    #[must_use]
    pub fn psnr_of(&self, shown: &Image) -> f64 {
        psnr(shown, &self.image()).min(100.0)
    }
}

/// How much the changes from one frame of a sequence to the next differ from those of the reference: the mean squared error
/// of the differences of both renders, over all pixels and channels. What stays wrong in the same way does not count.
/// NaN if the sizes differ or the images are empty.
#[must_use]
pub fn flicker(images: [&Image; 2], references: [&Image; 2]) -> f64 {
    let [a, b, c, d] = [images[0], images[1], references[0], references[1]];
    if [b, c, d].iter().any(|i| (i.width, i.height) != (a.width, a.height)) || a.rgb.is_empty() {
        return f64::NAN;
    }
    let change = |from: &Image, to: &Image, i: usize| {
        f64::from(to.rgb[i].clamp(0.0, 1.0)) - f64::from(from.rgb[i].clamp(0.0, 1.0))
    };
    let error = |i| change(a, b, i) - change(c, d, i);
    (0..a.rgb.len()).map(error).map(|e| e * e).sum::<f64>() / a.rgb.len() as f64
}

/// The PSNR, dB, of a mean squared error.
#[must_use]
pub fn decibels(squared_error: f64) -> f64 {
    -10.0 * libm::log10(squared_error)
}

/// Mean over all pixels and channels, as for [`psnr`].
pub(crate) fn squared_error(a: &Image, b: &Image) -> f64 {
    if (a.width, a.height) != (b.width, b.height) || a.rgb.is_empty() {
        return f64::NAN;
    }
    let sum: f64 = a
        .rgb
        .iter()
        .zip(&b.rgb)
        .map(|(&x, &y)| {
            let d = f64::from(x.clamp(0.0, 1.0)) - f64::from(y.clamp(0.0, 1.0));
            d * d
        })
        .sum();
    sum / a.rgb.len() as f64
}

/// Mean SSIM over pixels and channels: 11x11 Gaussian window of sigma 1.5, zero padding,
/// C1 = 1e-4, C2 = 9e-4, values clamped to 0..=1. NaN if the sizes differ or are zero.
#[must_use]
pub fn ssim(a: &Image, b: &Image) -> f64 {
    if (a.width, a.height) != (b.width, b.height) || a.rgb.is_empty() {
        return f64::NAN;
    }
    let (w, h) = (a.width as usize, a.height as usize);
    let mut total = 0.0;
    for channel in 0..3 {
        let plane = |i: &Image| -> Vec<f64> {
            i.rgb[channel..].iter().step_by(3).map(|&v| f64::from(v.clamp(0.0, 1.0))).collect()
        };
        let (x, y) = (plane(a), plane(b));
        let product = |p: &[f64], q: &[f64]| -> Vec<f64> {
            blur(&p.iter().zip(q).map(|(a, b)| a * b).collect::<Vec<_>>(), w, h)
        };
        let (mx, my) = (blur(&x, w, h), blur(&y, w, h));
        let (xx, yy, xy) = (product(&x, &x), product(&y, &y), product(&x, &y));
        for i in 0..w * h {
            let (vx, vy) = (xx[i] - mx[i] * mx[i], yy[i] - my[i] * my[i]);
            let cov = xy[i] - mx[i] * my[i];
            total += (2.0 * mx[i] * my[i] + 1e-4) * (2.0 * cov + 9e-4)
                / ((mx[i] * mx[i] + my[i] * my[i] + 1e-4) * (vx + vy + 9e-4));
        }
    }
    total / (3 * w * h) as f64
}

/// Width and height from which SSIMULACRA2 is defined, pixels.
const SSIMULACRA2_FROM: u32 = 8;

/// SSIMULACRA2 of `a` against the reference `b`, both as 8-bit sRGB, as libjxl's tool computes it: 100 for equal pictures,
/// 90 where no difference is seen side by side at a normal distance, 70 for a high quality; it may be negative. NaN if
/// the sizes differ, or an edge is below 8 pixels.
///
/// The Python package `ssimulacra2` 0.3 differs from that tool, and from this, by up to 8.
#[must_use]
pub fn ssimulacra2(a: &Image, b: &Image) -> f64 {
    let (w, h) = (a.width, a.height);
    if (w, h) != (b.width, b.height) || w.min(h) < SSIMULACRA2_FROM {
        return f64::NAN;
    }
    let [a, b] = [a, b].map(Image::to_rgb8);
    let slice = |rgb| PixelSlice::new(rgb, w, h, 3 * w as usize, PixelDescriptor::RGB8_SRGB).ok();
    let score = slice(&b).zip(slice(&a)).and_then(|(b, a)| compute_ssimulacra2(&b, &a).ok());
    score.unwrap_or(f64::NAN)
}

/// The 11 taps of the SSIM window along one axis; they sum to 1.
pub(crate) fn taps() -> [f64; 11] {
    let mut taps = [0.0; 11];
    for (i, t) in taps.iter_mut().enumerate() {
        let d = i as f64 - 5.0;
        *t = libm::exp(-d * d / (2.0 * 1.5 * 1.5));
    }
    let sum: f64 = taps.iter().sum();
    taps.map(|t| t / sum)
}

/// Separable blur with zero padding.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn blur(plane: &[f64], w: usize, h: usize) -> Vec<f64> {
    let taps = taps();
    let mut rows = vec![0.0; w * h];
    for (row, plane) in rows.chunks_exact_mut(w).zip(plane.chunks_exact(w)) {
        // Tap by tap over the whole row, which becomes vector instructions.
        for (k, t) in taps.iter().enumerate() {
            let (to, from) = (5usize.saturating_sub(k).min(w), k.saturating_sub(5).min(w));
            row[to..].iter_mut().zip(&plane[from..]).for_each(|(out, v)| *out += t * v);
        }
    }
    let mut out = vec![0.0; w * h];
    for y in 0..h {
        for i in y.max(5) - 5..(y + 6).min(h) {
            let t = taps[i + 5 - y];
            for x in 0..w {
                out[y * w + x] += t * rows[i * w + x];
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(value: impl Fn(usize, usize, usize) -> usize) -> Image {
        let pixels = (0..24).flat_map(|y| (0..32).map(move |x| (x, y)));
        let rgb = pixels.flat_map(|(x, y)| [0, 1, 2].map(|c| value(x, y, c) as f32 / 255.0));
        Image { width: 32, height: 24, rgb: rgb.collect() }
    }

    #[test]
    fn ssimulacra2_is_that_of_libjxl() {
        let pattern = |x, y, c| 60 + (x * 5 + y * 3 + c * 40) % 128;
        let reference = picture(pattern);
        let noisy = picture(|x, y, c| pattern(x, y, c) + (x * 7 + y * 13) % 25);
        // The tool `ssimulacra2` of libjxl 0.11.2, with these pictures as PNG.
        assert!((ssimulacra2(&noisy, &reference) - 88.113_114_56).abs() < 1e-3);
        assert_eq!(ssimulacra2(&reference, &reference), 100.0);
    }

    #[test]
    fn pictures_of_other_sizes_or_below_eight_pixels_have_no_ssimulacra2() {
        let [eight, seven] = [8, 7].map(|edge| Image::new(edge, edge));
        assert_eq!(ssimulacra2(&eight, &eight), 100.0);
        assert!(ssimulacra2(&seven, &seven).is_nan() && ssimulacra2(&eight, &seven).is_nan());
    }

    #[test]
    fn flicker_is_the_error_of_the_changes() {
        let [still, brighter] = [picture(|x, _, _| x), picture(|x, _, _| x + 51)];
        assert_eq!(flicker([&brighter, &brighter], [&still, &still]), 0.0);
        assert_eq!(flicker([&still, &brighter], [&still, &brighter]), 0.0);
        // The image changes by a fifth, the reference does not.
        let error = flicker([&still, &brighter], [&still, &still]);
        assert!((error - 0.04).abs() < 1e-6, "{error}");
        assert!(flicker([&still, &still], [&still, &Image::new(8, 8)]).is_nan());
    }
}
