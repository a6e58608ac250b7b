//! The codebook as bytes.
//!
//! Layout, little endian: version (u8, 1), rotation bits (u8), log-scale bits (u8), metric (u8:
//! 0 covariance, 1 square root), number of codewords (u32); then, range coded to the end, per
//! codeword the three rotation integers and the three log-scale integers, each as its difference
//! to the previous codeword's (0 before the first). A difference d is coded as 2|d| - (d > 0)
//! with an adaptive [`Magnitude`] chosen by component and by the size of the previous
//! codeword's difference in that component.

use std::sync::OnceLock;

use super::{Codebook, Codeword, MAX_CODEWORDS, Precision};
use crate::covariance::Metric;
use crate::error::{Error, Result};
use crate::range_coder::{Decoder, Encoder, Magnitude};

const VERSION: u8 = 1;
const HEADER: usize = 8;

impl Codebook {
    /// The codebook's bytes; [`Self::from_bytes`] is the inverse.
    pub fn to_bytes(&self) -> Vec<u8> {
        let metric = match self.metric {
            Metric::Covariance => 0,
            Metric::SquareRoot => 1,
        };
        let Precision { rotation_bits, log_scale_bits, .. } = self.precision;
        let mut bytes = vec![VERSION, rotation_bits, log_scale_bits, metric];
        bytes.extend_from_slice(&(self.codewords.len() as u32).to_le_bytes());
        let mut coder = Encoder::new(bytes);
        let mut models = Models::new();
        let mut previous = [0i32; 6];
        for codeword in &self.codewords {
            let values = components(codeword);
            for k in 0..6 {
                let d = values[k] - previous[k];
                let folded = 2 * d.unsigned_abs() - u32::from(d > 0);
                models.next(k).encode(&mut coder, folded);
                models.seen(k, folded);
            }
            previous = values;
        }
        coder.finish()
    }

    /// Reads what [`Self::to_bytes`] wrote. The whole slice must be used up. Memory stays within
    /// 12 bytes a codeword, and codewords are only allocated as they are decoded.
    ///
    /// # Errors
    /// [`Error::Truncated`], [`Error::TrailingBytes`], [`Error::UnknownVersion`],
    /// [`Error::BadMetric`], [`Error::BadBits`], [`Error::TooManyCodewords`],
    /// [`Error::BadCodeword`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        Self::from_bytes_within(bytes, MAX_CODEWORDS)
    }

    /// As [`Self::from_bytes`], of at most `most` codewords. Likely codewords cost next to
    /// nothing, so a few bytes can stand for a million: time and memory are bounded by `most`.
    ///
    /// # Errors
    /// As [`Self::from_bytes`].
    pub fn from_bytes_within(bytes: &[u8], most: usize) -> Result<Self> {
        let truncated = Error::Truncated { length: bytes.len() };
        let (header, payload) = bytes.split_at_checked(HEADER).ok_or(truncated)?;
        if header[0] != VERSION {
            return Err(Error::UnknownVersion { version: header[0] });
        }
        let precision = Precision::new(header[1], header[2])?;
        let metric = match header[3] {
            0 => Metric::Covariance,
            1 => Metric::SquareRoot,
            value => return Err(Error::BadMetric { value }),
        };
        let count = u32::from_le_bytes([header[4], header[5], header[6], header[7]]) as usize;
        if !(1..=MAX_CODEWORDS.min(most)).contains(&count) {
            return Err(Error::TooManyCodewords { count });
        }
        let (rotation_limit, log_scale_limit) =
            (i32::from(precision.rotation_limit()), i32::from(precision.log_scale_limit()));
        let mut coder = Decoder::new(payload);
        let mut models = Models::new();
        let mut values = [0i32; 6];
        let mut codewords = Vec::new();
        for index in 0..count {
            for k in 0..6 {
                let folded = models.next(k).decode(&mut coder);
                models.seen(k, folded);
                // Both are below 2^25: no overflow.
                let size = (folded as i32 + 1) / 2;
                values[k] += if folded & 1 == 1 { size } else { -size };
                let range =
                    if k < 3 { -rotation_limit..=rotation_limit } else { 0..=log_scale_limit };
                if !range.contains(&values[k]) {
                    return Err(Error::BadCodeword { index, component: k, value: values[k] });
                }
            }
            coder.check()?;
            let v = values;
            codewords.push(Codeword {
                rotation: [v[0] as i16, v[1] as i16, v[2] as i16],
                log_scale: [v[3] as u16, v[4] as u16, v[5] as u16],
            });
        }
        coder.finish()?;
        Ok(Self { precision, metric, codewords, search: OnceLock::new() })
    }
}

fn components(codeword: &Codeword) -> [i32; 6] {
    let (r, l) = (codeword.rotation.map(i32::from), codeword.log_scale.map(i32::from));
    [r[0], r[1], r[2], l[0], l[1], l[2]]
}

/// Models of the differences, and the class of the last difference of each component.
struct Models {
    models: Vec<[Magnitude; CLASSES]>,
    class: [usize; 6],
}

/// Classes of a difference's size: 0, below 8, below 64, larger.
const CLASSES: usize = 4;

impl Models {
    fn new() -> Self {
        Self { models: vec![[const { Magnitude::NEW }; CLASSES]; 6], class: [0; 6] }
    }

    fn next(&mut self, component: usize) -> &mut Magnitude {
        &mut self.models[component][self.class[component]]
    }

    fn seen(&mut self, component: usize, folded: u32) {
        self.class[component] = match folded {
            0 => 0,
            1..8 => 1,
            8..64 => 2,
            _ => 3,
        };
    }
}
