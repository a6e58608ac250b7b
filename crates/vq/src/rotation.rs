//! Integers for a rotation.
//!
//! A unit quaternion with w >= 0 has three degrees of freedom. The modified Rodrigues parameters
//! (x, y, z) / (1 + w), the tangent of a quarter of the angle times the axis, are an even map of
//! them: a step means about the same angle everywhere. A [`Grid`] rounds the parameters to
//! integers.
//!
//! Invariant: integers decode to the same quaternion bits on every machine, because the way back
//! uses only sums, products, quotients and sqrt in f64, and any three integers decode to a unit
//! quaternion.

use crate::quaternion::normalised;

/// Largest absolute value of a parameter of a canonical rotation, tan 11.25°: a turn of 45 degrees
/// about a world axis. See [`crate::canonical`].
const HALF_WIDTH: f64 = 0.198_912_367_379_658;

/// A uniform grid over the parameters of canonical rotations: integer i stands for i * step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grid {
    step: f64,
}

impl Grid {
    /// The grid whose integers for a canonical rotation fit `bits` signed bits (2 to 24),
    /// symmetric: -(2^(bits-1) - 1) ..= 2^(bits-1) - 1.
    pub(crate) fn with_bits(bits: u8) -> Self {
        Self { step: HALF_WIDTH / f64::from((1i32 << (bits - 1)) - 1) }
    }

    /// The grid point nearest to a quaternion (w, x, y, z) in parameters. The quaternion need not
    /// have unit length; q and -q give the same point.
    pub(crate) fn quantise(&self, quaternion: [f32; 4]) -> [i32; 3] {
        let q = normalised(quaternion);
        let q = if q[0] < 0.0 { q.map(|c| -c) } else { q };
        [q[1], q[2], q[3]].map(|c| (c / (1.0 + q[0]) / self.step).round() as i32)
    }

    /// The unit quaternion (w, x, y, z) of a grid point. Valid for all integers.
    pub(crate) fn dequantise(&self, point: [i32; 3]) -> [f32; 4] {
        let [x, y, z] = point.map(|i| f64::from(i) * self.step);
        let inverse = 1.0 / (1.0 + (x * x + y * y + z * z));
        let twice = 2.0 * inverse;
        let w = (1.0 - (x * x + y * y + z * z)) * inverse;
        [w, x * twice, y * twice, z * twice].map(|c| c as f32)
    }
}

#[cfg(test)]
#[path = "rotation_tests.rs"]
mod tests;
