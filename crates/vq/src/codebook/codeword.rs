//! Codewords as integers, as a stream stores them. Training rounds to them, so an encoder assigns
//! covariances to what a decoder computes.

use crate::covariance::{Covariance, MIN_LOG_SCALE};
use crate::error::{Error, Result};
use crate::rotation::Grid;

/// Bit depths allowed for the rotation of a codeword.
pub(crate) const ROTATION_BITS: std::ops::RangeInclusive<u8> = 4..=14;
/// Fraction bits allowed for the log-scales of a codeword.
pub(crate) const LOG_SCALE_BITS: std::ops::RangeInclusive<u8> = 2..=10;

/// A codeword: modified Rodrigues parameters of the canonical rotation and minus the normalised
/// log-scales, both in steps of a [`Precision`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Codeword {
    pub(crate) rotation: [i16; 3],
    pub(crate) log_scale: [u16; 3],
}

/// Resolution of the stored codewords.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Precision {
    pub(crate) rotation_bits: u8,
    pub(crate) log_scale_bits: u8,
    grid: Grid,
}

impl Precision {
    /// # Errors
    /// [`Error::BadBits`] outside [`ROTATION_BITS`] or [`LOG_SCALE_BITS`].
    pub(crate) fn new(rotation_bits: u8, log_scale_bits: u8) -> Result<Self> {
        for (bits, range) in [(rotation_bits, ROTATION_BITS), (log_scale_bits, LOG_SCALE_BITS)] {
            if !range.contains(&bits) {
                return Err(Error::BadBits { bits, low: *range.start(), high: *range.end() });
            }
        }
        Ok(Self { rotation_bits, log_scale_bits, grid: Grid::with_bits(rotation_bits) })
    }

    /// Largest absolute value of a rotation integer.
    pub(crate) fn rotation_limit(&self) -> i16 {
        (1 << (self.rotation_bits - 1)) - 1
    }

    /// Largest log-scale integer.
    pub(crate) fn log_scale_limit(&self) -> u16 {
        (-MIN_LOG_SCALE as u16) << self.log_scale_bits
    }

    /// Log-scale integers per unit.
    fn per_unit(&self) -> f32 {
        f32::from(1u16 << self.log_scale_bits)
    }

    pub(crate) fn quantise(&self, covariance: &Covariance) -> Codeword {
        let limit = i32::from(self.rotation_limit());
        let rotation = self.grid.quantise(covariance.quaternion());
        let top = f32::from(self.log_scale_limit());
        Codeword {
            rotation: rotation.map(|r| r.clamp(-limit, limit) as i16),
            log_scale: covariance
                .log_scales()
                .map(|l| (-l * self.per_unit()).round().clamp(0.0, top) as u16),
        }
    }

    pub(crate) fn dequantise(&self, codeword: Codeword) -> Covariance {
        Covariance::from_parts(
            self.grid.dequantise(codeword.rotation.map(i32::from)),
            // Exact: a small integer over a power of two (and never -0.0).
            codeword.log_scale.map(|l| 0.0 - f32::from(l) / self.per_unit()),
        )
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn integers_come_back(
            q in prop::array::uniform4(-1.0f32..1.0), s in prop::array::uniform3(-20.0f32..0.0),
            rotation_bits in ROTATION_BITS, log_scale_bits in LOG_SCALE_BITS,
        ) {
            let precision = Precision::new(rotation_bits, log_scale_bits).unwrap();
            let codeword = precision.quantise(&Covariance::split(q, s).unwrap().0);
            let decoded = precision.dequantise(codeword);
            prop_assert_eq!(precision.quantise(&decoded), codeword);
            let norm: f64 = decoded.quaternion().map(|c| f64::from(c) * f64::from(c)).iter().sum();
            prop_assert!((norm - 1.0).abs() < 1e-6);
            for l in decoded.log_scales() {
                prop_assert!((MIN_LOG_SCALE..=0.0).contains(&l));
            }
            // Half a step of log-scale is this much of the trace, to first order.
            let e = decoded.entries();
            let tolerance = libm::exp2(-f64::from(log_scale_bits));
            prop_assert!((e[0] + e[3] + e[5] - 1.0).abs() <= 1.2 * tolerance);
        }
    }

    #[test]
    fn bit_depths_are_checked() {
        assert!(matches!(Precision::new(15, 7), Err(Error::BadBits { bits: 15, .. })));
        assert!(matches!(Precision::new(10, 11), Err(Error::BadBits { bits: 11, .. })));
    }
}
