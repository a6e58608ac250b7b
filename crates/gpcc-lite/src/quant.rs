//! Quantiser steps of the lifting transform, and those of G-PCC's quantisation parameters.

/// Fraction bits of the values that the lifting transform works on.
pub(crate) const VALUE_BITS: u32 = 12;

/// Greatest step; a decoder reads larger ones as this.
pub(crate) const MAX_STEP: Step = Step(1 << 47);

/// A quantiser step in 1/65536 of a value unit, at most `2^47` of these.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Step(pub u64);

/// `65536 * 2^(i/6)`, rounded.
const SIXTH: [u64; 6] = [65_536, 73_562, 82_570, 92_682, 104_032, 116_772];

impl Step {
    /// The step of a G-PCC quantisation parameter: `2^((qp - 4) / 6)`, for `qp >= 4`.
    #[must_use]
    pub fn from_qp(qp: u8) -> Self {
        let e = qp.saturating_sub(4);
        Self(SIXTH[(e % 6) as usize] << (e / 6).min(40)).min(MAX_STEP)
    }

    /// An absolute step; values below 1/65536 become 1/65536.
    #[must_use]
    pub fn new(step: f64) -> Self {
        Self(((step * 65536.0 + 0.5) as u64).clamp(1, MAX_STEP.0))
    }

    /// The step as a real number.
    #[must_use]
    pub fn value(self) -> f64 {
        self.0 as f64 / 65536.0
    }

    /// Steps per unit of the coefficients' last place.
    pub(crate) fn per_unit(self) -> f64 {
        f64::from(1u32 << (16 - VALUE_BITS)) / self.0.max(1) as f64
    }

    /// Reconstructs one coefficient with [`VALUE_BITS`] fraction bits.
    #[inline]
    pub(crate) fn dequantise(self, level: i32) -> i64 {
        let magnitude =
            (i128::from(level.unsigned_abs()) * i128::from(self.0)) >> (16 - VALUE_BITS);
        let magnitude = magnitude.min(1 << 61) as i64;
        if level < 0 { -magnitude } else { magnitude }
    }
}
