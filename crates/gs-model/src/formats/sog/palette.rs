//! What the bytes of a SOG stand for: codebooks of numbers, and the palette of higher SH coefficients.

use rayon::prelude::*;

use super::decoder::PALETTE_ROW;
use super::precision::Precision;
use super::webp::Pixel;
use crate::scene::Scene;

/// Entries of a codebook.
const ENTRIES: usize = 256;
/// Numbers that a codebook is made from, about; all of them if there are no more.
const SAMPLE: usize = 1 << 18;
/// Most entries of a palette: places in it have 16 bits.
const MOST: usize = 1 << 16;

/// At most 256 numbers, ascending.
pub(super) struct Codebook(Vec<f32>);

impl Codebook {
    /// The codebook of finite numbers: multiples of the step, or if there is none, those that fit best.
    pub(super) fn of_each<const N: usize>(rows: &[[f32; N]], step: Option<f32>) -> Self {
        if let Some(step) = step {
            return Self::even(rows.as_flattened(), step.into());
        }
        let step = (N * rows.len()).div_ceil(SAMPLE).max(1);
        let numbers: Vec<[f32; 1]> = rows.iter().step_by(step).flatten().map(|&v| [v]).collect();
        let mut entries = kmeans::cluster(&numbers, &vec![1.0; numbers.len()], ENTRIES).centres;
        entries.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Self(entries.into_iter().flatten().collect())
    }

    /// Multiples of a step, of a larger one if these are too many.
    fn even(numbers: &[f32], step: f64) -> Self {
        let low = numbers.iter().copied().fold(f32::INFINITY, f32::min);
        let high = numbers.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let step = step.max((f64::from(high) - f64::from(low)) / (ENTRIES - 2) as f64);
        let first = (f64::from(low) / step).round();
        let count = ((f64::from(high) / step).round() - first) as usize + 1;
        Self((0..count).map(|k| ((first + k as f64) * step) as f32).collect())
    }

    /// The index of the nearest number.
    pub(super) fn index(&self, v: f32) -> u8 {
        let Self(entries) = self;
        let after = entries.partition_point(|&entry| entry < v);
        let before = after.saturating_sub(1);
        let is_nearer = entries.get(after).is_some_and(|&entry| entry - v < v - entries[before]);
        if is_nearer { after as u8 } else { before as u8 }
    }

    /// All 256 numbers; the last ones are not used.
    pub(super) fn padded(&self) -> Vec<f32> {
        let mut entries = self.0.clone();
        entries.resize(ENTRIES, 0.0);
        entries
    }
}

/// The palette of a scene's higher SH coefficients.
pub(super) struct Palette {
    /// The coefficients of each entry, red, green and blue of one after the other.
    entries: Vec<Vec<f32>>,
    pub(super) codebook: Codebook,
    /// The entry of each Gaussian.
    pub(super) of_gaussian: Vec<u16>,
}

impl Palette {
    /// None for a scene without such coefficients, or with zeros alone. The scene has Gaussians.
    pub(super) fn of(scene: &Scene, precision: &Precision) -> Option<Self> {
        let is_zero = |i| scene.sh_of(i)[1..].as_flattened().iter().all(|&v| v == 0.0);
        match scene.sh_degree {
            _ if (0..scene.len()).all(is_zero) => None,
            1 => Some(Self::trained::<9>(scene, precision)),
            2 => Some(Self::trained::<24>(scene, precision)),
            3 => Some(Self::trained::<45>(scene, precision)),
            _ => None,
        }
    }

    fn trained<const D: usize>(scene: &Scene, precision: &Precision) -> Self {
        let higher = |i: usize| scene.sh_of(i)[1..].as_flattened();
        let point = |i: usize| std::array::from_fn(|k| higher(i)[k]);
        let points: Vec<[f32; D]> = (0..scene.len()).into_par_iter().map(point).collect();
        // As many as splat-transform takes.
        let count = ((1usize << scene.len().ilog2()) / precision.share).clamp(1, MOST);
        // With the root of what pictures show of a Gaussian as its weight, SOG of fox is 3.0 dB nearer to the model,
        // that of bonsai 0.8 dB.
        let weight = |i| libm::exp(0.5 * scene.log_prominence(i).clamp(-60.0, 60.0)) as f32;
        let weights: Vec<f32> = (0..scene.len()).map(weight).collect();
        let kmeans::Clusters { centres, of_point } = kmeans::cluster(&points, &weights, count);
        // From weak to strong: rows of the image then have entries of one kind, and so few bits.
        let energy = |entry: &[f32; D]| entry.iter().map(|v| v * v).sum::<f32>();
        let mut order: Vec<usize> = (0..centres.len()).collect();
        order.sort_by(|&a, &b| energy(&centres[a]).total_cmp(&energy(&centres[b])));
        let mut places = vec![0; centres.len()];
        order.iter().enumerate().for_each(|(place, &entry)| places[entry] = place as u16);
        Self {
            codebook: Codebook::of_each(&centres, precision.steps[2]),
            entries: order.iter().map(|&entry| centres[entry].to_vec()).collect(),
            of_gaussian: of_point.into_iter().map(|entry| places[entry as usize]).collect(),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }

    /// Coefficients of an entry.
    pub(super) fn coefficients(&self) -> usize {
        self.entries[0].len() / 3
    }

    /// The image: 64 entries in a row, a pixel for each coefficient.
    pub(super) fn pixels(&self) -> Vec<Pixel> {
        let index = |v: f32| self.codebook.index(v);
        let pixel = |rgb: &[f32]| [index(rgb[0]), index(rgb[1]), index(rgb[2]), 255];
        let mut pixels: Vec<Pixel> =
            self.entries.iter().flat_map(|entry| entry.chunks(3)).map(pixel).collect();
        let row = PALETTE_ROW * self.coefficients();
        pixels.resize(pixels.len().next_multiple_of(row), [0, 0, 0, 255]);
        pixels
    }
}
