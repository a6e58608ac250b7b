//! Writes version 2.

use std::io::{Cursor, Write};
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::decoder::{LARGEST, PALETTE_ROW};
use super::members::META;
use super::palette::{Codebook, Palette};
use super::precision::Precision;
use super::webp::{self, Pixel};
use crate::error::{Error, Result};
use crate::formats::splat::opacity_byte;
use crate::math::{smallest_three, unit};
use crate::order::morton_order;
use crate::scene::Scene;

/// Steps between the bounds of the means.
const STEPS: f64 = 65535.0;
/// Means are rounded to at most two to this power of them.
const MOST_POWERS: u8 = 10;
/// Longest side of a WebP image.
const LONGEST: usize = 16383;

#[derive(Serialize)]
struct Meta {
    version: u8,
    asset: Asset,
    count: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    model: Option<&'static str>,
    means: Means,
    scales: CodebookImage,
    quats: Rotations,
    sh0: CodebookImage,
    #[serde(rename = "shN", skip_serializing_if = "Option::is_none")]
    sh_n: Option<HigherSh>,
}

#[derive(Serialize)]
struct Asset {
    generator: &'static str,
}

#[derive(Serialize)]
struct Means {
    mins: [f64; 3],
    maxs: [f64; 3],
    files: [&'static str; 2],
}

#[derive(Serialize)]
struct CodebookImage {
    codebook: Vec<f32>,
    files: [&'static str; 1],
}

#[derive(Serialize)]
struct Rotations {
    files: [&'static str; 1],
}

#[derive(Serialize)]
struct HigherSh {
    count: usize,
    bands: u8,
    codebook: Vec<f32>,
    files: [&'static str; 2],
}

/// Names and contents of the files of a SOG.
pub type Files = Vec<(&'static str, Vec<u8>)>;

/// The files of a scene by their names, `meta.json` last, the Gaussians in Morton order. `file` is the name in errors.
///
/// # Errors
/// [`Error::SceneShape`] or [`Error::SceneDegree`] if the arrays do not fit together, [`Error::Unwritable`] for no
/// Gaussians, more than an image has pixels, or a number that is not finite.
pub fn files(file: impl AsRef<Path>, scene: &Scene) -> Result<Files> {
    ordered(file.as_ref(), scene, &morton_order(&scene.means), &Precision::FULL)
}

/// As [`files`], of a chunk of a level of detail of a coded scene; 0 is the finest. The Gaussians keep their order. Their
/// numbers are coarser: at full precision a palette for so few takes more bytes than all else.
///
/// # Errors
/// Those of [`files`].
pub fn files_of_chunk(file: impl AsRef<Path>, scene: &Scene, lod: u8) -> Result<Files> {
    let order: Vec<usize> = (0..scene.len()).collect();
    let precision = if lod == 0 { Precision::FINEST } else { Precision::COARSER };
    ordered(file.as_ref(), scene, &order, &precision)
}

fn ordered(file: &Path, scene: &Scene, order: &[usize], precision: &Precision) -> Result<Files> {
    scene.check_shape()?;
    if scene.is_empty() {
        return Err(Error::unwritable(file, "the model is empty, and SOG has no empty images"));
    }
    let numbers =
        [scene.means.as_flattened(), scene.log_scales.as_flattened(), scene.sh.as_flattened()];
    if !numbers.iter().all(|numbers| numbers.par_iter().all(|v| v.is_finite())) {
        return Err(Error::unwritable(file, "SOG holds no number that is infinite or NaN"));
    }
    let width = side(scene.len());
    let height = scene.len().div_ceil(width).next_multiple_of(4);
    if width.max(height) > LONGEST {
        let most = LONGEST * LONGEST;
        return Err(Error::unwritable(file, format!("SOG holds at most {most} Gaussians")));
    }
    // The pixels of an image: one for each Gaussian; the rest repeats the last one, which takes few bits.
    let image = |pixel: &(dyn Fn(usize) -> Pixel + Sync)| {
        let mut pixels: Vec<Pixel> = order.par_iter().map(|&i| pixel(i)).collect();
        pixels.resize(width * height, pixels[pixels.len() - 1]);
        (width, pixels)
    };
    let (bounds, steps) = positions(scene, precision.spacing);
    let scales = Codebook::of_each(&scene.log_scales, precision.steps[0]);
    let base = |i: usize| scene.sh_of(i)[0];
    let colours =
        Codebook::of_each(&(0..scene.len()).map(base).collect::<Vec<_>>(), precision.steps[1]);
    let palette = Palette::of(scene, precision);
    let mut images = vec![
        ("means_l.webp", image(&|i| opaque(steps[i].map(|step| step as u8)))),
        ("means_u.webp", image(&|i| opaque(steps[i].map(|step| (step >> 8) as u8)))),
        ("quats.webp", image(&|i| rotation(scene.rotations[i], precision.byte_steps))),
        ("scales.webp", image(&|i| opaque(scene.log_scales[i].map(|v| scales.index(v))))),
        (
            "sh0.webp",
            image(&|i| {
                let [r, g, b] = base(i).map(|v| colours.index(v));
                [
                    r,
                    g,
                    b,
                    coarse(opacity_byte(scene.opacity_logits[i]).into(), precision.byte_steps),
                ]
            }),
        ),
    ];
    let sh_n = palette.map(|palette| {
        let pixels = palette.pixels();
        images.push(("shN_centroids.webp", (PALETTE_ROW * palette.coefficients(), pixels)));
        let label = |i: usize| {
            let [low, high] = palette.of_gaussian[i].to_le_bytes();
            [low, high, 0, 255]
        };
        images.push(("shN_labels.webp", image(&label)));
        let files = ["shN_centroids.webp", "shN_labels.webp"];
        let (count, bands) = (palette.len(), scene.sh_degree);
        HigherSh { count, bands, codebook: palette.codebook.padded(), files }
    });
    let mut files: Vec<(&str, Vec<u8>)> = images
        .into_par_iter()
        .map(|(name, (width, pixels))| (name, webp::encode(width, &pixels)))
        .collect();
    let meta = Meta {
        version: 2,
        asset: Asset { generator: concat!("gsvx ", env!("CARGO_PKG_VERSION")) },
        count: scene.len(),
        model: scene.antialiased.then_some("antialiased"),
        means: Means { mins: bounds[0], maxs: bounds[1], files: ["means_l.webp", "means_u.webp"] },
        scales: CodebookImage { codebook: scales.padded(), files: ["scales.webp"] },
        quats: Rotations { files: ["quats.webp"] },
        sh0: CodebookImage { codebook: colours.padded(), files: ["sh0.webp"] },
        sh_n,
    };
    let json = serde_json::to_string(&meta).map_err(|e| Error::json(file, META, &e))?;
    // Whole numbers, such as those that fill codebooks, without their ".0".
    files.push((META, json.replace(".0,", ",").replace(".0]", "]").into_bytes()));
    Ok(files)
}

/// Writes all files as one archive.
pub(super) fn write(file: &Path, out: &mut dyn Write, scene: &Scene) -> Result<()> {
    if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) {
        let why = "SOG of several files is written by gsvx convert; name a .sog for one file";
        return Err(Error::unwritable(file, why));
    }
    let bundle = || {
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        for (name, bytes) in files(file, scene)? {
            zip.start_file(name, stored)
                .map_err(std::io::Error::from)
                .and_then(|()| zip.write_all(&bytes))
                .map_err(|e| Error::io(file, "write", e))?;
        }
        zip.finish().map_err(|e| Error::io(file, "write", e.into()))
    };
    out.write_all(bundle()?.get_ref()).map_err(|e| Error::io(file, "write", e))
}

/// The width of an image of so many pixels: about its height.
fn side(pixels: usize) -> usize {
    ((pixels as f64).sqrt().ceil() as usize).next_multiple_of(4)
}

/// A byte, rounded to one of `steps` + 1 evenly spaced ones.
fn coarse(v: f64, steps: f64) -> u8 {
    ((v * steps / 255.0).round() * 255.0 / steps).round() as u8
}

fn opaque([r, g, b]: [u8; 3]) -> Pixel {
    [r, g, b, 255]
}

/// `sign(x) ln(1 + |x|)`.
fn log(v: f32) -> f64 {
    libm::log1p(f64::from(v.abs())).copysign(v.into())
}

/// Least and greatest logarithms of the means, and of each mean the steps between them.
fn positions(scene: &Scene, spacing: f64) -> ([[f64; 3]; 2], Vec<[u16; 3]>) {
    let bounds = scene.bounds();
    let [low, high] = bounds.map(|bound| bound.map(log));
    // No finite f32 is larger than e^88.
    let small = scene.small_log_scale().unwrap_or_default().min(88.0);
    let wanted = spacing * libm::exp(small.into());
    // So many steps the means are rounded to. Wider bounds would do the same, but engines sort by the bounds.
    let whole: [f64; 3] = std::array::from_fn(|k| {
        let farthest = f64::from(bounds[0][k].abs().max(bounds[1][k].abs()));
        let least = (high[k] - low[k]) / STEPS * (1.0 + farthest);
        let mut powers = (0..=MOST_POWERS).rev().map(|power| f64::from(1u16 << power));
        powers.find(|n| n * least <= wanted).unwrap_or(1.0)
    });
    let step = |k: usize, v: f32| {
        let part = if high[k] > low[k] { (log(v) - low[k]) / (high[k] - low[k]) } else { 0.0 };
        ((STEPS * part / whole[k]).round() * whole[k]).min(STEPS) as u16
    };
    let of = |mean: &[f32; 3]| std::array::from_fn(|k| step(k, mean[k]));
    ([low, high], scene.means.par_iter().map(of).collect())
}

/// The largest step of the position of each Gaussian. Steps grow with the distance from the planes of the axes.
pub(super) fn steps(scene: &Scene) -> Vec<f64> {
    let [low, high] = scene.bounds().map(|bound| bound.map(log));
    let step =
        |mean: &[f32; 3], k: usize| (high[k] - low[k]) / STEPS * (1.0 + f64::from(mean[k].abs()));
    scene.means.iter().map(|mean| (0..3).map(|k| step(mean, k)).fold(0.0, f64::max)).collect()
}

fn rotation(q: [f32; 4], steps: f64) -> Pixel {
    let (largest, others) = smallest_three(unit(q));
    let byte = |v: f64| coarse(255.0 * (v * std::f64::consts::FRAC_1_SQRT_2 + 0.5), steps);
    let [a, b, c] = others.map(byte);
    [a, b, c, LARGEST + largest as u8]
}
