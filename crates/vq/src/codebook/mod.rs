//! The codebook: a table of normalised covariances, trained by an encoder, stored as integers.

mod codeword;
mod report;
mod training;

use std::sync::OnceLock;

use rayon::prelude::*;

pub use report::{Distortion, TrainingReport};
pub use training::{Keep, Options};

use crate::covariance::{Covariance, Feature, Metric};
use crate::error::{Error, Result};
use crate::nearest::Nearest;
pub(crate) use codeword::{Codeword, Precision};

/// Most codewords a codebook may have, trained and kept ones together.
pub const MAX_CODEWORDS: usize = 1 << 20;

/// Covariances handed to a thread at a time.
const CHUNK: usize = 4096;

/// A table of normalised covariances.
///
/// Codewords are held as the integers that the stream stores; a decoded codeword is computed from
/// them with + - * / and sqrt only. They are sorted along a Hilbert curve through the space of
/// covariances, so that near indices mean similar shapes. Two codebooks are equal if their integers
/// and their metric are.
#[derive(Debug, Clone)]
pub struct Codebook {
    precision: Precision,
    metric: Metric,
    codewords: Vec<Codeword>,
    /// Features and search tree, built when first needed.
    search: OnceLock<(Vec<Feature>, Nearest)>,
}

impl Codebook {
    /// Codewords are sorted along the curve, and equal ones merged.
    fn from_codewords(precision: Precision, metric: Metric, mut codewords: Vec<Codeword>) -> Self {
        codewords.sort_unstable();
        codewords.dedup();
        let features: Vec<Feature> =
            codewords.iter().map(|&c| precision.dequantise(c).feature(metric)).collect();
        let keys = crate::order::hilbert_keys(&features);
        let mut order: Vec<(u64, Codeword)> = keys.into_iter().zip(codewords).collect();
        order.sort_unstable();
        let codewords = order.into_iter().map(|(_, c)| c).collect();
        Self { precision, metric, codewords, search: OnceLock::new() }
    }

    /// What a stream stores: the bits of a rotation integer, the fraction bits of a log-scale
    /// integer, and the codewords, each three integers of the rotation and three of minus the
    /// log-scales.
    #[must_use]
    pub fn integers(&self) -> (u8, u8, Vec<[i32; 6]>) {
        let Precision { rotation_bits, log_scale_bits, .. } = self.precision;
        let integers = |c: &Codeword| {
            let ([x, y, z], [a, b, c]) = (c.rotation.map(i32::from), c.log_scale.map(i32::from));
            [x, y, z, a, b, c]
        };
        (rotation_bits, log_scale_bits, self.codewords.iter().map(integers).collect())
    }

    /// Trains a codebook on covariances and their sensitivities (one each, finite, >= 0; only
    /// ratios matter). The same input and options give the same codebook for any number of threads.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`], [`Error::BadSensitivity`], [`Error::BadCount`] for no covariances, [`Error::TooManyCodewords`], [`Error::BadBits`].
    pub fn train(
        covariances: &[Covariance],
        sensitivities: &[f32],
        options: &Options,
    ) -> Result<Self> {
        Ok(Self::train_with_report(covariances, sensitivities, options)?.0)
    }

    /// As [`Self::train`], with an account of the training.
    ///
    /// # Errors
    /// As [`Self::train`].
    pub fn train_with_report(
        covariances: &[Covariance],
        sensitivities: &[f32],
        options: &Options,
    ) -> Result<(Self, TrainingReport)> {
        training::train(covariances, sensitivities, options)
    }

    /// Number of codewords; at least 1.
    pub fn len(&self) -> usize {
        self.codewords.len()
    }

    /// Whether there are no codewords; never true of a trained codebook.
    pub fn is_empty(&self) -> bool {
        self.codewords.is_empty()
    }

    /// What [`Self::assign`] minimises.
    pub fn metric(&self) -> Metric {
        self.metric
    }

    /// How far from 1 the trace of a trained codeword can be: half a step of log-scale.
    pub fn trace_tolerance(&self) -> f64 {
        1.2 / f64::from(1u32 << self.precision.log_scale_bits)
    }

    /// Codeword `index`: unit quaternion (w, x, y, z) and normalised log-scales. The Gaussian's
    /// log-scales are these plus its log(gamma). The same bits on every machine.
    ///
    /// # Errors
    /// [`Error::BadIndex`] if there is no such codeword.
    pub fn decode(&self, index: u32) -> Result<([f32; 4], [f32; 3])> {
        let covariance = self.covariance(index)?;
        Ok((covariance.quaternion(), covariance.log_scales()))
    }

    /// Codeword `index` as a covariance.
    ///
    /// # Errors
    /// [`Error::BadIndex`] if there is no such codeword.
    pub fn covariance(&self, index: u32) -> Result<Covariance> {
        let error = Error::BadIndex { index, length: self.codewords.len() };
        let codeword = self.codewords.get(index as usize).ok_or(error)?;
        Ok(self.precision.dequantise(*codeword))
    }

    /// All codewords in order, decoded.
    pub fn decode_all(&self) -> Vec<([f32; 4], [f32; 3])> {
        self.codewords
            .iter()
            .map(|&c| self.precision.dequantise(c))
            .map(|c| (c.quaternion(), c.log_scales()))
            .collect()
    }

    /// The nearest codeword of every covariance, exactly as a scan over all codewords finds it
    /// (of equally near ones the lowest index).
    pub fn assign(&self, covariances: &[Covariance]) -> Vec<u32> {
        let (_, tree) = self.search();
        let mut indices = vec![0u32; covariances.len()];
        indices.par_chunks_mut(CHUNK).zip(covariances.par_chunks(CHUNK)).for_each(
            |(out, input)| {
                for (index, covariance) in out.iter_mut().zip(input) {
                    *index = tree.find(&covariance.feature(self.metric), None).id;
                }
            },
        );
        indices
    }

    /// Features of the codewords and the tree over them.
    fn search(&self) -> &(Vec<Feature>, Nearest) {
        self.search.get_or_init(|| {
            let features: Vec<Feature> = self
                .codewords
                .iter()
                .map(|&c| self.precision.dequantise(c).feature(self.metric))
                .collect();
            let tree = Nearest::new(&features);
            (features, tree)
        })
    }
}

fn features(covariances: &[Covariance], metric: Metric) -> Vec<Feature> {
    covariances.par_iter().with_min_len(CHUNK).map(|c| c.feature(metric)).collect()
}

impl PartialEq for Codebook {
    fn eq(&self, other: &Self) -> bool {
        (self.precision, self.metric, &self.codewords)
            == (other.precision, other.metric, &other.codewords)
    }
}
