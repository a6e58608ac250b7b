//! Entropy coding of codeword indices, in the order of the Gaussians in space.
//!
//! An index is coded bit by bit from the top. The codewords lie along a Hilbert curve, so the
//! top bits say roughly what shape it is: they are coded in the context of the previous
//! Gaussian's top bits. The bits below are coded in the context of all bits above, which learns
//! how often each codeword is used.
//!
//! ```
//! let indices = [3, 3, 4, 3, 2, 3, 900, 901, 900];
//! let bytes = vq::index::encode(&indices, 1000)?;
//! assert_eq!(vq::index::decode(&bytes, indices.len(), 1000)?, indices);
//! # Ok::<(), vq::Error>(())
//! ```

use crate::codebook::MAX_CODEWORDS;
use crate::error::{Error, Result};
use crate::range_coder::{Bit, Decoder, Encoder};

/// Top bits that are coded in the context of the previous index, and make up that context.
const BUCKET_BITS: u32 = 5;

/// Indices between two checks of a decoder for the end of its bytes.
const CHECK_EVERY: usize = 256;

/// Adaptive probabilities: memory is about 4 bytes a codeword.
struct Model {
    /// Bits of an index.
    bits: u32,
    codewords: u32,
    /// By previous bucket, then by the bits so far with a leading 1.
    top: Vec<Bit>,
    /// By all the bits so far with a leading 1.
    rest: Vec<Bit>,
    previous: usize,
}

impl Model {
    fn new(codewords: usize) -> Result<Self> {
        if !(1..=MAX_CODEWORDS).contains(&codewords) {
            return Err(Error::TooManyCodewords { count: codewords });
        }
        let bits = usize::BITS - (codewords - 1).leading_zeros();
        Ok(Self {
            bits,
            codewords: codewords as u32,
            top: vec![Bit::NEW; 1 << (2 * BUCKET_BITS)],
            rest: vec![Bit::NEW; 1 << bits],
            previous: 0,
        })
    }

    /// Codes one index; `code` handles one bit: given its model and the bit to write (ignored by
    /// a decoder), it returns the bit.
    #[inline]
    fn index(&mut self, index: u32, mut code: impl FnMut(&mut Bit, bool) -> bool) -> u32 {
        let mut prefix = 0u32;
        for below in (0..self.bits).rev() {
            let depth = self.bits - 1 - below;
            let node = (1usize << depth) | prefix as usize;
            prefix <<= 1;
            // No codeword under the upper half: nothing to say.
            if u64::from(prefix | 1) << below >= u64::from(self.codewords) {
                continue;
            }
            let model = if depth < BUCKET_BITS {
                &mut self.top[self.previous << BUCKET_BITS | node]
            } else {
                &mut self.rest[node]
            };
            prefix |= u32::from(code(model, index >> below & 1 == 1));
        }
        self.previous = (prefix >> self.bits.saturating_sub(BUCKET_BITS)) as usize;
        prefix
    }
}

/// Codes indices into a codebook of `codewords` codewords, in order.
///
/// # Errors
/// [`Error::BadIndex`] for an index not below `codewords`, [`Error::TooManyCodewords`] unless
/// 1 <= codewords <= 2^20.
pub fn encode(indices: &[u32], codewords: usize) -> Result<Vec<u8>> {
    let mut model = Model::new(codewords)?;
    if let Some(&index) = indices.iter().find(|&&i| i as usize >= codewords) {
        return Err(Error::BadIndex { index, length: codewords });
    }
    let mut coder = Encoder::new(Vec::new());
    for &index in indices {
        model.index(index, |model, bit| {
            coder.bit(model, bit);
            bit
        });
    }
    Ok(coder.finish())
}

/// Decodes `count` indices, all below `codewords`; the bytes must be used up exactly. Decoding
/// stops within 256 indices of the end of the bytes, and memory grows with what was decoded.
/// Likely indices cost next to nothing, so `count` itself must come from what was decoded before
/// (the number of Gaussians), not from a field that anyone can write.
///
/// # Errors
/// [`Error::Truncated`], [`Error::TrailingBytes`], [`Error::TooManyCodewords`].
pub fn decode(bytes: &[u8], count: usize, codewords: usize) -> Result<Vec<u32>> {
    let mut model = Model::new(codewords)?;
    let mut coder = Decoder::new(bytes);
    let mut indices = Vec::new();
    for k in 0..count {
        if k % CHECK_EVERY == 0 {
            coder.check()?;
        }
        indices.push(model.index(0, |model, _| coder.bit(model)));
    }
    coder.finish()?;
    Ok(indices)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn indices_come_back(
            codewords in 1usize..70_000, raw in prop::collection::vec(any::<u32>(), 0..800),
            repeat in 1usize..5,
        ) {
            let indices: Vec<u32> = raw
                .iter()
                .flat_map(|&i| std::iter::repeat_n(i % codewords as u32, repeat))
                .collect();
            let bytes = encode(&indices, codewords).unwrap();
            prop_assert_eq!(decode(&bytes, indices.len(), codewords).unwrap(), indices);
        }

        #[test]
        fn any_bytes_give_indices_in_range_or_an_error(
            bytes in prop::collection::vec(any::<u8>(), 0..300), codewords in 1usize..3000,
            count in 0usize..2000,
        ) {
            if let Ok(indices) = decode(&bytes, count, codewords) {
                prop_assert!(indices.len() == count);
                prop_assert!(indices.iter().all(|&i| (i as usize) < codewords));
            }
        }
    }

    #[test]
    fn skewed_and_correlated_indices_cost_less() {
        let mut rng = crate::rng::SplitMix64::new(2);
        let uniform: Vec<u32> = (0..40_000).map(|_| rng.below(1024) as u32).collect();
        let skewed: Vec<u32> = uniform.iter().map(|&i| if i % 4 == 0 { i } else { 77 }).collect();
        let mut at = 500i64;
        let walk: Vec<u32> = uniform
            .iter()
            .map(|&i| {
                at = (at + i64::from(i % 33) - 16).rem_euclid(1024);
                at as u32
            })
            .collect();
        let bits = |v: &[u32]| encode(v, 1024).unwrap().len() as f64 * 8.0 / v.len() as f64;
        // 10 bits; 0.81 + 10/4 bits; 5 bits and what the bucket leaves open.
        assert!(bits(&uniform) < 10.2, "{}", bits(&uniform));
        assert!(bits(&skewed) < 3.5, "{}", bits(&skewed));
        assert!(bits(&walk) < 7.6, "{}", bits(&walk));
    }

    #[test]
    fn errors() {
        assert!(matches!(encode(&[5], 5), Err(Error::BadIndex { index: 5, length: 5 })));
        assert!(matches!(encode(&[], 0), Err(Error::TooManyCodewords { count: 0 })));
        let bytes = encode(&[1, 2, 3], 5).unwrap();
        assert!(matches!(decode(&bytes[..bytes.len() - 1], 3, 5), Err(Error::Truncated { .. })));
        assert!(matches!(decode(&[], usize::MAX, 1 << 20), Err(Error::Truncated { .. })));
        // One codeword: the indices say nothing, whatever their number.
        assert_eq!(encode(&[0; 1000], 1).unwrap().len(), 4);
    }
}
