//! Codewords as integers, as a stream stores them. Training rounds to them, so an encoder assigns
//! covariances to what a decoder computes.
//!
//! A rotation is stored as its modified Rodrigues parameters (x, y, z) / (1 + w), the tangent of a
//! quarter of the angle times the axis: a step means about the same angle everywhere.
//!
//! Invariant: integers decode to the same bits on every machine, because the way back uses only
//! sums, products and quotients, and any three integers decode to a unit quaternion.

use crate::covariance::{Covariance, MIN_LOG_SCALE};
use crate::error::{Error, Result};

/// Greatest integer of a rotation: 8 bits with sign.
const ROTATION_LIMIT: i16 = 127;
/// Step of the parameters of a rotation. The greatest of a canonical one is tan 11.25°: a turn of
/// 45 degrees about a world axis.
const ROTATION_STEP: f64 = 0.198_912_367_379_658 / ROTATION_LIMIT as f64;
/// Log-scale integers per unit, a power of two.
const PER_UNIT: f32 = 32.0;
/// Greatest integer of a log-scale.
const LOG_SCALE_LIMIT: u16 = (-MIN_LOG_SCALE * PER_UNIT) as u16;

/// A codeword: the parameters of the canonical rotation, and minus the normalised log-scales.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Codeword {
    rotation: [i16; 3],
    log_scale: [u16; 3],
}

impl Codeword {
    /// The nearest one.
    pub(crate) fn of(covariance: &Covariance) -> Self {
        let q = covariance.quaternion().map(f64::from);
        let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
        let limit = f64::from(ROTATION_LIMIT);
        let parameter = |c: f64| (c / (norm + q[0]) / ROTATION_STEP).round().clamp(-limit, limit);
        let top = f32::from(LOG_SCALE_LIMIT);
        let log_scale = |l: f32| (-l * PER_UNIT).round().clamp(0.0, top) as u16;
        Self {
            rotation: [q[1], q[2], q[3]].map(|c| parameter(c) as i16),
            log_scale: covariance.log_scales().map(log_scale),
        }
    }

    /// What it stands for.
    pub(crate) fn covariance(self) -> Covariance {
        let [x, y, z] = self.rotation.map(|i| f64::from(i) * ROTATION_STEP);
        let square = x * x + y * y + z * z;
        let inverse = 1.0 / (1.0 + square);
        let twice = 2.0 * inverse;
        let quaternion =
            [(1.0 - square) * inverse, x * twice, y * twice, z * twice].map(|c| c as f32);
        // Exact: a small integer over a power of two (and never -0.0).
        let log_scales = self.log_scale.map(|l| 0.0 - f32::from(l) / PER_UNIT);
        Covariance { quaternion, log_scales }
    }

    /// The three integers of the rotation, then those of minus the log-scales.
    pub(crate) fn integers(self) -> [i32; 6] {
        let ([x, y, z], [a, b, c]) = (self.rotation.map(i32::from), self.log_scale.map(i32::from));
        [x, y, z, a, b, c]
    }

    /// # Errors
    /// [`Error::BadInteger`] beyond what [`Codeword::of`] gives.
    pub(crate) fn from_integers(integers: [i32; 6]) -> Result<Self> {
        let (r, l) = (i32::from(ROTATION_LIMIT), i32::from(LOG_SCALE_LIMIT));
        let within = |(k, &v): (usize, &i32)| if k < 3 { -r..=r } else { 0..=l }.contains(&v);
        if !integers.iter().enumerate().all(within) {
            return Err(Error::BadInteger { integers });
        }
        let [x, y, z, a, b, c] = integers;
        Ok(Self { rotation: [x, y, z].map(|v| v as i16), log_scale: [a, b, c].map(|v| v as u16) })
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
        ) {
            let covariance = Covariance::split(q, s).unwrap().0;
            let codeword = Codeword::of(&covariance);
            prop_assert_eq!(Codeword::from_integers(codeword.integers()), Ok(codeword));
            let decoded = codeword.covariance();
            prop_assert_eq!(Codeword::of(&decoded), codeword);
            let norm: f64 = decoded.quaternion().map(|c| f64::from(c) * f64::from(c)).iter().sum();
            prop_assert!((norm - 1.0).abs() < 1e-6);
            for k in 0..3 {
                let error = (decoded.log_scales()[k] - covariance.log_scales()[k]).abs();
                prop_assert!(error <= 0.5001 / PER_UNIT);
            }
            // |d angle / d parameter| is at most 4, at the origin, and three half steps add up as
            // sqrt(3) / 2.
            let (a, b) = (covariance.quaternion(), decoded.quaternion());
            let off = |k: usize| f64::from(a[k] - b[k]);
            let chord = (0..4).map(|k| off(k) * off(k)).sum::<f64>().sqrt();
            prop_assert!(4.0 * libm::asin(chord / 2.0) <= 2.0 * 3f64.sqrt() * ROTATION_STEP + 1e-6);
        }
    }

    #[test]
    fn decoded_bits_are_fixed() {
        // Golden values (checked against the formula in Python): a change here changes what existing
        // streams decode to.
        let decode = |integers| Codeword::from_integers(integers).unwrap().covariance();
        let same = decode([0; 6]);
        assert_eq!((same.quaternion(), same.log_scales()), ([1.0, 0.0, 0.0, 0.0], [0.0; 3]));
        let other = decode([100, -37, 127, 1, 32, 512]);
        assert_eq!(
            other.quaternion().map(f32::to_bits),
            [1_063_232_818, 1_050_034_035, 3_185_466_855, 1_052_692_628],
        );
        assert_eq!(other.log_scales(), [-0.03125, -1.0, -16.0]);
        for bad in
            [[128, 0, 0, 0, 0, 0], [0, 0, -128, 0, 0, 0], [0, 0, 0, 513, 0, 0], [0, 0, 0, -1, 0, 0]]
        {
            assert_eq!(Codeword::from_integers(bad), Err(Error::BadInteger { integers: bad }));
        }
    }
}
