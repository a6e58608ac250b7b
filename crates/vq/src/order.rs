//! The order of the codewords: along the Hilbert curve over the covariance features, so that
//! neighbours in the table are similar.

use crate::covariance::Feature;
use crate::nearest::bounds;

const BITS: u32 = 10;

/// Position of each feature along the Hilbert curve through the bounding box of all of them.
pub(crate) fn hilbert_keys(features: &[Feature]) -> Vec<u64> {
    let [low, high] = bounds(features);
    let top = ((1u32 << BITS) - 1) as f32;
    // Without width the quotient is NaN, which is 0 as an integer.
    let cell = |f: &Feature| {
        [0, 1, 2, 3, 4, 5].map(|k| ((f[k] - low[k]) / (high[k] - low[k]) * top) as u32)
    };
    features.iter().map(|f| hilbert_key(cell(f))).collect()
}

/// Distance along the six-dimensional Hilbert curve of a cell with [`BITS`] bits a side
/// (Skilling, "Programming the Hilbert curve", 2004).
fn hilbert_key(mut x: [u32; 6]) -> u64 {
    let bits = || (1..BITS).rev().map(|bit| 1 << bit);
    for q in bits() {
        let p = q - 1;
        for i in 0..6 {
            if x[i] & q != 0 {
                x[0] ^= p;
            } else {
                let t = (x[0] ^ x[i]) & p;
                x[0] ^= t;
                x[i] ^= t;
            }
        }
    }
    for i in 1..6 {
        x[i] ^= x[i - 1];
    }
    let t = bits().filter(|q| x[5] & q != 0).fold(0, |t, q| t ^ (q - 1));
    let mut key = 0;
    for bit in (0..BITS).rev() {
        for coordinate in x {
            key = key << 1 | u64::from(((coordinate ^ t) >> bit) & 1);
        }
    }
    key
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_takes_unit_steps() {
        // All cells of a 4x4x4x4x4x4 corner: keys are distinct, successive cells are adjacent.
        let mut cells: Vec<(u64, [u32; 6])> = (0..4096u32)
            .map(|n| {
                let cell = [0, 2, 4, 6, 8, 10].map(|shift| n >> shift & 3);
                (hilbert_key(cell), cell)
            })
            .collect();
        cells.sort_unstable();
        for pair in cells.windows(2) {
            assert_eq!(pair[1].0, pair[0].0 + 1, "the corner is one stretch of the curve");
            let step: u32 = (0..6).map(|k| pair[0].1[k].abs_diff(pair[1].1[k])).sum();
            assert_eq!(step, 1, "{pair:?}");
        }
    }

    #[test]
    fn flat_input_is_fine() {
        assert_eq!(hilbert_keys(&[[0.5; 6]; 3]), [0, 0, 0]);
        assert!(hilbert_keys(&[]).is_empty());
    }
}
