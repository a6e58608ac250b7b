//! The codebook: a table of normalised covariances, trained by an encoder, stored as integers.

use rayon::prelude::*;

use crate::codeword::Codeword;
use crate::covariance::{Covariance, Feature};
use crate::error::{Error, Result};
use crate::nearest::{CHUNK, Nearest};
use crate::{order, training};

/// Most codewords of a codebook.
pub const MAX_CODEWORDS: usize = 1 << 20;

/// A table of normalised covariances.
///
/// Codewords are held as the integers that a stream stores; a decoded codeword is computed from
/// them with + - * / only. After training they are sorted along a Hilbert curve through the space
/// of covariances, so that near indices mean similar shapes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Codebook {
    codewords: Vec<Codeword>,
}

impl Codebook {
    /// Trains a codebook of at most `codewords` codewords on covariances and their sensitivities
    /// (one each, finite, >= 0; only ratios matter). It has fewer if the data has fewer distinct
    /// covariances at the stored precision. The same input gives the same codebook for any number
    /// of threads.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`], [`Error::BadSensitivity`], [`Error::BadCount`] for no
    /// covariances, [`Error::BadCodewords`].
    pub fn train(
        covariances: &[Covariance],
        sensitivities: &[f32],
        codewords: usize,
    ) -> Result<Self> {
        training::check(covariances, sensitivities)?;
        check_count(codewords)?;
        let centres = training::centres(covariances, sensitivities, codewords);
        let codeword = |centre| Codeword::of(&Covariance::from_feature(centre));
        let mut codewords: Vec<Codeword> = centres.into_iter().map(codeword).collect();
        codewords.sort_unstable();
        codewords.dedup();
        let keys = order::hilbert_keys(&features(&codewords));
        let mut order: Vec<(u64, Codeword)> = keys.into_iter().zip(codewords).collect();
        order.sort_unstable();
        Ok(Self { codewords: order.into_iter().map(|(_, c)| c).collect() })
    }

    /// What a stream stores of each codeword: three integers of the rotation, -127 to 127, and
    /// three of minus the log-scales, 0 to 512.
    #[must_use]
    pub fn integers(&self) -> Vec<[i32; 6]> {
        self.codewords.iter().map(|c| c.integers()).collect()
    }

    /// The codebook of these [`Self::integers`].
    ///
    /// # Errors
    /// [`Error::BadInteger`], [`Error::BadCodewords`].
    pub fn from_integers(integers: &[[i32; 6]]) -> Result<Self> {
        check_count(integers.len())?;
        let codewords = integers.iter().map(|&i| Codeword::from_integers(i));
        Ok(Self { codewords: codewords.collect::<Result<_>>()? })
    }

    /// Number of codewords; at least 1.
    #[expect(clippy::len_without_is_empty, reason = "no codebook is empty")]
    pub fn len(&self) -> usize {
        self.codewords.len()
    }

    /// Codeword `index`: unit quaternion (w, x, y, z) and normalised log-scales. The Gaussian's
    /// log-scales are these plus its log(gamma). The same bits on every machine.
    ///
    /// # Errors
    /// [`Error::BadIndex`] if there is no such codeword.
    pub fn decode(&self, index: u32) -> Result<([f32; 4], [f32; 3])> {
        let error = Error::BadIndex { index, length: self.codewords.len() };
        let covariance = self.codewords.get(index as usize).ok_or(error)?.covariance();
        Ok((covariance.quaternion(), covariance.log_scales()))
    }

    /// The nearest codeword of every covariance, exactly as a scan over all codewords finds it
    /// (of equally near ones the lowest index).
    pub fn assign(&self, covariances: &[Covariance]) -> Vec<u32> {
        let tree = Nearest::new(&features(&self.codewords));
        let nearest = |c: &Covariance| tree.find(&c.feature()).id;
        covariances.par_iter().with_min_len(CHUNK).map(nearest).collect()
    }
}

fn features(codewords: &[Codeword]) -> Vec<Feature> {
    codewords.iter().map(|c| c.covariance().feature()).collect()
}

fn check_count(count: usize) -> Result<()> {
    if (1..=MAX_CODEWORDS).contains(&count) { Ok(()) } else { Err(Error::BadCodewords { count }) }
}
