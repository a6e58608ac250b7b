//! Covariances as an index into a trained codebook and one scale factor per Gaussian.
//!
//! The paper's lossy mode (after Compressed 3DGS), with everything a decoder needs in the stream and
//! counted: the codebook is in the header, indices and the logarithms of the scale factors are in each
//! chunk. Training is in the crate `vq`.

use crate::bytes::Reader;
#[cfg(feature = "encode")]
use crate::bytes::Writer;
use crate::error::{Error, Result};
#[cfg(feature = "encode")]
use gpcc_lite::coder::Encoder;
use gpcc_lite::coder::{Coder, Decoder};
use gpcc_lite::model::{Bit, Symbols};

/// Bits of a rotation integer, and fraction bits of a log-scale integer.
const ROTATION_BITS: std::ops::RangeInclusive<u8> = 4..=14;
const LOG_SCALE_BITS: std::ops::RangeInclusive<u8> = 2..=10;
/// Most codewords.
pub(crate) const MOST: usize = 1 << 16;
/// Normalised log-scales are from minus this to 0.
const LOG_SCALE_RANGE: i32 = 16;
/// `tan(pi / 16)`: half the range of a modified Rodrigues parameter of a canonical rotation.
const ROTATION_RANGE: f64 = 0.198_912_367_379_658;
/// Classes of a difference's magnitude: 0, below 4, below 32, larger.
const CLASSES: usize = 4;
/// Top bits of an index that are coded in the context of those of the index before.
const TOP_BITS: u32 = 5;
/// Memory of the models of an index's bits.
const LIMIT: u32 = 160;

/// Codewords as the integers of the stream: three of the rotation, three of the log-scales.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Codebook {
    pub(crate) rotation_bits: u8,
    pub(crate) log_scale_bits: u8,
    pub(crate) codewords: Vec<[i32; 6]>,
}

impl Codebook {
    /// Its bytes in the header.
    #[cfg(feature = "encode")]
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut out = Writer::default();
        out.u8(self.rotation_bits);
        out.u8(self.log_scale_bits);
        out.varint(self.codewords.len() as u64);
        let mut coder = Encoder::default();
        code_codewords(&mut coder, &mut self.codewords.clone(), |_| true);
        out.bytes.extend(coder.finish());
        out.bytes
    }

    /// Reads what [`Codebook::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`Error::Truncated`], [`Error::Corrupt`] or [`Error::Coding`].
    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let corrupt = |what, value: u64| Error::Corrupt { what, value };
        let mut r = Reader::new(bytes, "codebook");
        let (rotation_bits, log_scale_bits) = (r.u8()?, r.u8()?);
        if !ROTATION_BITS.contains(&rotation_bits) || !LOG_SCALE_BITS.contains(&log_scale_bits) {
            return Err(corrupt("bits of a codeword", rotation_bits.into()));
        }
        let count = r.varint()?;
        if count == 0 || count > MOST as u64 {
            return Err(corrupt("number of codewords", count));
        }
        let coding = crate::error::coding("codebook");
        let mut coder = Decoder::new(r.take(r.remaining())?).map_err(&coding)?;
        let mut codewords = vec![[0; 6]; count as usize];
        let top = LOG_SCALE_RANGE << log_scale_bits;
        let limit = (1 << (rotation_bits - 1)) - 1;
        let fits = |word: &[i32; 6]| {
            word[..3].iter().all(|v| v.abs() <= limit)
                && word[3..].iter().all(|v| (0..=top).contains(v))
        };
        if !code_codewords(&mut coder, &mut codewords, fits) {
            return Err(corrupt("codeword", 0));
        }
        coder.finish().map_err(coding)?;
        Ok(Self { rotation_bits, log_scale_bits, codewords })
    }

    /// Rotations and normalised log-scales of all codewords.
    pub(crate) fn covariances(&self) -> Vec<([f32; 4], [f32; 3])> {
        let unit = ROTATION_RANGE / f64::from((1 << (self.rotation_bits - 1)) - 1);
        let per_unit = f64::from(1u32 << self.log_scale_bits);
        let covariance = |&[x, y, z, a, b, c]: &[i32; 6]| {
            let [x, y, z] = [x, y, z].map(|v| f64::from(v) * unit);
            let n = x * x + y * y + z * z;
            let i = 1.0 / (1.0 + n);
            let q = [(1.0 - n) * i, x * (2.0 * i), y * (2.0 * i), z * (2.0 * i)];
            (q.map(|v| v as f32), [a, b, c].map(|v| (0.0 - f64::from(v) / per_unit) as f32))
        };
        self.codewords.iter().map(covariance).collect()
    }
}

/// Codes codewords, each component as its difference from the codeword before; false as soon as one
/// does not fit.
fn code_codewords<C: Coder>(
    coder: &mut C,
    codewords: &mut [[i32; 6]],
    fits: impl Fn(&[i32; 6]) -> bool,
) -> bool {
    let mut models = vec![[Symbols::geometric(256, 2); CLASSES]; 6];
    let (mut class, mut before) = ([0usize; 6], [0i32; 6]);
    for word in codewords {
        if coder.exhausted() {
            return false;
        }
        for k in 0..6 {
            let difference = word[k] - before[k];
            let magnitude = difference.unsigned_abs();
            // The number of the magnitude's bits, then those below the leading one, then the sign.
            let bits = 32 - magnitude.leading_zeros();
            let bits = coder.symbol(&mut models[k][class[k]], bits as usize) as u32;
            let low = bits.saturating_sub(1);
            let lead = u32::from(bits > 0) << low;
            let magnitude = lead | coder.bits(magnitude & (lead.max(1) - 1), low);
            let negative = coder.bits(u32::from(difference < 0), u32::from(bits > 0)) != 0;
            let difference = if negative { -(magnitude as i32) } else { magnitude as i32 };
            class[k] = [0, 1, 1, 2, 2, 2].get(bits as usize).copied().unwrap_or(3);
            word[k] = before[k] + difference;
        }
        if !fits(word) {
            return false;
        }
        before = *word;
    }
    true
}

/// Codes one index per leaf: bit by bit from the top, the top bits in the context of those of the index
/// before, the others in the context of all bits above. A decoder fills `indices` in.
pub(crate) fn code_indices<C: Coder>(coder: &mut C, indices: &mut [u32], codewords: usize) {
    let codewords = codewords as u32;
    let bits = 32 - codewords.saturating_sub(1).leading_zeros();
    let mut top = vec![Bit::default(); 1 << (2 * TOP_BITS)];
    let mut rest = vec![Bit::default(); 1 << bits];
    let mut before = 0usize;
    for index in indices {
        let mut prefix = 0u32;
        for below in (0..bits).rev() {
            let depth = bits - 1 - below;
            let node = (1usize << depth) | prefix as usize;
            prefix <<= 1;
            // No codeword in the upper half: nothing to code.
            if u64::from(prefix | 1) << below >= u64::from(codewords) {
                continue;
            }
            let model = if depth < TOP_BITS {
                &mut top[before << TOP_BITS | node]
            } else {
                &mut rest[node]
            };
            prefix |= u32::from(model.code(coder, *index >> below & 1 == 1, LIMIT));
        }
        before = (prefix >> bits.saturating_sub(TOP_BITS)) as usize;
        *index = prefix;
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn codebooks_and_indices_come_back() {
        for n in [1usize, 2, 300] {
            let word = |i: usize| {
                let v = i as i32;
                [v % 31 - 15, -(v * v % 29) + 14, v % 7, v * 3 % 900, v * 70 % 2049, v % 2]
            };
            let book = Codebook {
                rotation_bits: 10,
                log_scale_bits: 7,
                codewords: (0..n).map(word).collect(),
            };
            assert_eq!(Codebook::from_bytes(&book.to_bytes()).unwrap(), book);
            for (q, l) in book.covariances() {
                assert!((q.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-6);
                assert!(l.iter().all(|v| (-16.0..=0.0).contains(v)));
            }
            let indices: Vec<u32> = (0..1000).map(|i| (i * i % n) as u32).collect();
            let mut encoder = Encoder::default();
            code_indices(&mut encoder, &mut indices.clone(), n);
            let bytes = encoder.finish();
            let mut back = vec![0; indices.len()];
            let mut decoder = Decoder::new(&bytes).unwrap();
            code_indices(&mut decoder, &mut back, n);
            decoder.finish().unwrap();
            assert_eq!(back, indices);
        }
    }

    #[test]
    fn a_codeword_beyond_its_range_is_damage() {
        for word in [[600, 0, 0, 0, 0, 0], [0, 0, 0, -1, 0, 0], [0, 0, 0, 0, 2049, 0]] {
            let book = Codebook { rotation_bits: 10, log_scale_bits: 7, codewords: vec![word] };
            assert!(Codebook::from_bytes(&book.to_bytes()).is_err(), "{word:?}");
        }
    }
}
