//! What training did and how well a codebook fits.

use rayon::prelude::*;

use super::{CHUNK, Codebook};
use crate::covariance::Covariance;
use crate::error::{Error, Result};
use crate::nearest::squared_distance;

/// An account of a training run.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct TrainingReport {
    /// Covariances that became codewords of their own.
    pub kept: usize,
    /// Weighted mean squared distance of the clustered points to their (unrounded) centre,
    /// before each full iteration and after the last. Never increases.
    pub weighted_distortion: Vec<f64>,
}

/// How well indices represent covariances, in squared distance of the codebook's metric.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Distortion {
    /// Mean weighted by sensitivity.
    pub weighted_mean: f64,
    /// Plain mean.
    pub mean: f64,
    /// Largest.
    pub largest: f64,
    /// Codewords that at least one index names.
    pub used_codewords: usize,
    /// Bits per index of an ideal coder that knows the frequencies and nothing else.
    pub index_entropy: f64,
}

impl Codebook {
    /// Distortion of coding each covariance as the codeword of its index.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless all three slices are equally long,
    /// [`Error::BadCount`] for empty ones, [`Error::BadIndex`].
    pub fn distortion(
        &self,
        covariances: &[Covariance],
        sensitivities: &[f32],
        indices: &[u32],
    ) -> Result<Distortion> {
        for others in [sensitivities.len(), indices.len()] {
            if others != covariances.len() {
                return Err(Error::LengthMismatch { covariances: covariances.len(), others });
            }
        }
        if covariances.is_empty() {
            return Err(Error::BadCount { count: 0 });
        }
        if let Some(&index) = indices.iter().find(|&&i| i as usize >= self.codewords.len()) {
            return Err(Error::BadIndex { index, length: self.codewords.len() });
        }
        let (features, _) = self.search();
        let mut distances = vec![0.0f32; covariances.len()];
        distances.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
            for (k, distance) in out.iter_mut().enumerate() {
                let i = chunk * CHUNK + k;
                let feature = covariances[i].feature(self.metric);
                *distance = squared_distance(&feature, &features[indices[i] as usize]);
            }
        });
        let mut result = Distortion {
            weighted_mean: 0.0,
            mean: 0.0,
            largest: 0.0,
            used_codewords: 0,
            index_entropy: 0.0,
        };
        let mut weight = 0.0;
        for (&d, &s) in distances.iter().zip(sensitivities) {
            let (d, s) = (f64::from(d), f64::from(s));
            result.weighted_mean += s * d;
            weight += s;
            result.mean += d;
            result.largest = result.largest.max(d);
        }
        let count = covariances.len() as f64;
        result.mean /= count;
        result.weighted_mean =
            if weight > 0.0 { result.weighted_mean / weight } else { result.mean };
        let mut uses = vec![0u32; self.codewords.len()];
        indices.iter().for_each(|&i| uses[i as usize] += 1);
        for n in uses.into_iter().filter(|&n| n > 0).map(f64::from) {
            result.used_codewords += 1;
            result.index_entropy += n / count * libm::log2(count / n);
        }
        Ok(result)
    }
}
