//! Three numbers for a rotation, and integers for the three numbers.
//!
//! A unit quaternion with w >= 0 has three degrees of freedom. A [`Chart`] maps it to three
//! parameters and back; a [`Grid`] rounds the parameters to integers. The way back uses only
//! sums, products, quotients and sqrt in f64, so integers decode to the same quaternion bits on
//! every machine, and any three finite parameters decode to a unit quaternion: noise that a
//! transform coder adds cannot produce an invalid rotation.
//!
//! ```
//! use vq::canonical::{Form, canonicalise};
//! use vq::rotation::{Chart, Grid};
//!
//! let (q, _) = canonicalise([0.7, 0.1, -0.6, 0.3], [-3.0, -3.5, -5.0]);
//! let grid = Grid::with_bits(Chart::ModifiedRodrigues, Form::NearestIdentity, 8)?;
//! let decoded = grid.dequantise(grid.quantise(q));
//! let dot: f32 = (0..4).map(|k| q[k] * decoded[k]).sum();
//! assert!(dot > 0.99999);
//! # Ok::<(), vq::Error>(())
//! ```

use crate::canonical::Form;
use crate::error::{Error, Result};
use crate::quaternion::normalised;

/// A map between rotations (unit quaternions, w >= 0) and three parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Chart {
    /// (x, y, z), the sine of half the angle times the axis. The "smallest three" of a
    /// quaternion whose largest component is w, which holds for both canonical forms.
    Vector,
    /// Rodrigues (Gibbs) vector (x, y, z) / w: tangent of half the angle. In
    /// [`Form::NearestIdentity`] its domain is a truncated cube of half-width sqrt(2) - 1.
    Rodrigues,
    /// Modified Rodrigues parameters (x, y, z) / (1 + w): tangent of a quarter of the angle.
    /// The most even of the three (least stretch over the domain), finite for all rotations.
    #[default]
    ModifiedRodrigues,
}

/// Parameters of larger size are clamped: they only arise from w near 0 or from hostile input.
const LIMIT: f64 = 1e6;

impl Chart {
    /// The three parameters of `quaternion` (w, x, y, z), which need not have unit length;
    /// q and -q give the same result.
    pub fn parameters(self, quaternion: [f32; 4]) -> [f64; 3] {
        let q = normalised(quaternion);
        let q = if q[0] < 0.0 { q.map(|c| -c) } else { q };
        let divisor = match self {
            Chart::Vector => 1.0,
            Chart::Rodrigues => q[0],
            Chart::ModifiedRodrigues => 1.0 + q[0],
        };
        [q[1], q[2], q[3]].map(|c| if c == 0.0 { 0.0 } else { (c / divisor).clamp(-LIMIT, LIMIT) })
    }

    /// The unit quaternion of three parameters. Every input gives a rotation: parameters that
    /// are not finite give the identity, and a [`Chart::Vector`] outside the unit ball is
    /// scaled back to it.
    pub fn quaternion(self, parameters: [f64; 3]) -> [f32; 4] {
        self.quaternion_f64(parameters).map(|c| c as f32)
    }

    pub(crate) fn quaternion_f64(self, parameters: [f64; 3]) -> [f64; 4] {
        if parameters.iter().any(|c| !c.is_finite()) {
            return crate::quaternion::IDENTITY;
        }
        let [x, y, z] = parameters.map(|c| c.clamp(-LIMIT, LIMIT));
        let square = x * x + y * y + z * z;
        match self {
            Chart::Vector if square < 1.0 => [(1.0 - square).sqrt(), x, y, z],
            Chart::Vector => {
                let inverse = 1.0 / square.sqrt();
                [0.0, x * inverse, y * inverse, z * inverse]
            }
            Chart::Rodrigues => {
                let w = 1.0 / (1.0 + square).sqrt();
                [w, x * w, y * w, z * w]
            }
            Chart::ModifiedRodrigues => {
                let inverse = 1.0 / (1.0 + square);
                let twice = 2.0 * inverse;
                [(1.0 - square) * inverse, x * twice, y * twice, z * twice]
            }
        }
    }

    /// Largest absolute value of a parameter over the domain of a canonical form.
    pub const fn half_width(self, form: Form) -> f64 {
        match (self, form) {
            // Nearest identity: reached by a turn of 45 degrees about a world axis, except for
            // the vector chart, whose extreme is the corner of the zone.
            (Chart::Vector, Form::NearestIdentity) => 0.382_683_432_365_089_8, // sin 22.5°
            (Chart::Rodrigues, Form::NearestIdentity) => 0.414_213_562_373_095_1, // tan 22.5°
            (Chart::ModifiedRodrigues, Form::NearestIdentity) => 0.198_912_367_379_658, // tan 11.25°
            // Sorted: a turn of 90 degrees about a world axis.
            (Chart::Vector, Form::Sorted) => std::f64::consts::FRAC_1_SQRT_2, // sin 45°
            (Chart::Rodrigues, Form::Sorted) => 1.0,                          // tan 45°
            (Chart::ModifiedRodrigues, Form::Sorted) => 0.414_213_562_373_095_1, // tan 22.5°
        }
    }
}

/// A uniform grid over the parameters of a [`Chart`]: integer i stands for i * step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    chart: Chart,
    step: f64,
}

impl Grid {
    /// A grid of the given step, in units of the chart's parameters.
    ///
    /// # Errors
    /// [`Error::BadStep`] unless the step is finite and at least 2^-30 (so that every
    /// canonical parameter fits an i32).
    pub fn new(chart: Chart, step: f64) -> Result<Self> {
        if !(step.is_finite() && step >= 1.0 / f64::from(1 << 30)) {
            return Err(Error::BadStep { step });
        }
        Ok(Self { chart, step })
    }

    /// The grid whose integers for a canonical rotation fit `bits` signed bits, symmetric:
    /// -(2^(bits-1) - 1) ..= 2^(bits-1) - 1.
    ///
    /// # Errors
    /// [`Error::BadBits`] unless 2 <= bits <= 24.
    pub fn with_bits(chart: Chart, form: Form, bits: u8) -> Result<Self> {
        if !(2..=24).contains(&bits) {
            return Err(Error::BadBits { bits, low: 2, high: 24 });
        }
        let levels = f64::from((1i32 << (bits - 1)) - 1);
        Self::new(chart, chart.half_width(form) / levels)
    }

    /// The chart of this grid.
    pub fn chart(&self) -> Chart {
        self.chart
    }

    /// Distance between neighbouring grid points, in units of the chart's parameters.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// The nearest grid point to `quaternion` in the chart.
    pub fn quantise(&self, quaternion: [f32; 4]) -> [i32; 3] {
        self.chart.parameters(quaternion).map(|p| (p / self.step).round() as i32)
    }

    /// The unit quaternion (w, x, y, z) of a grid point. Valid for all integers.
    pub fn dequantise(&self, point: [i32; 3]) -> [f32; 4] {
        self.dequantise_f64(point).map(|c| c as f32)
    }

    pub(crate) fn dequantise_f64(&self, point: [i32; 3]) -> [f64; 4] {
        self.chart.quaternion_f64(point.map(|i| f64::from(i) * self.step))
    }
}

/// Smallest-three form of any quaternion: the index of its largest component and the other three
/// in order, made positive at that index, as integers of `bits` signed bits over ±1/sqrt(2).
/// Unlike a [`Chart`] it needs no canonical form; it is what SPZ and SOG store.
///
/// # Errors
/// [`Error::BadBits`] unless 2 <= bits <= 24.
pub fn smallest_three(quaternion: [f32; 4], bits: u8) -> Result<(u8, [i32; 3])> {
    let levels = smallest_three_levels(bits)?;
    let q = normalised(quaternion);
    let mut largest = 0;
    for k in 1..4 {
        if q[k].abs() > q[largest].abs() {
            largest = k;
        }
    }
    let sign = if q[largest] < 0.0 { -1.0 } else { 1.0 };
    let mut rest = [0; 3];
    let others = (0..4).filter(|&k| k != largest);
    for (slot, k) in rest.iter_mut().zip(others) {
        *slot = (sign * q[k] * std::f64::consts::SQRT_2 * levels).round() as i32;
    }
    Ok((largest as u8, rest))
}

/// The unit quaternion (w, x, y, z) of a [`smallest_three`] form. Valid for all integers; three
/// components too long for a unit quaternion are scaled back.
///
/// # Errors
/// [`Error::BadBits`] unless 2 <= bits <= 24, [`Error::BadComponent`] unless the index is 0..=3.
pub fn from_smallest_three(largest: u8, rest: [i32; 3], bits: u8) -> Result<[f32; 4]> {
    let levels = smallest_three_levels(bits)?;
    if largest > 3 {
        return Err(Error::BadComponent { index: largest });
    }
    let scale = std::f64::consts::FRAC_1_SQRT_2 / levels;
    let [w, a, b, c] = Chart::Vector.quaternion_f64(rest.map(|i| f64::from(i) * scale));
    Ok(match largest {
        0 => [w, a, b, c],
        1 => [a, w, b, c],
        2 => [a, b, w, c],
        _ => [a, b, c, w],
    }
    .map(|c| c as f32))
}

fn smallest_three_levels(bits: u8) -> Result<f64> {
    if !(2..=24).contains(&bits) {
        return Err(Error::BadBits { bits, low: 2, high: 24 });
    }
    Ok(f64::from((1i32 << (bits - 1)) - 1))
}

#[cfg(test)]
#[path = "rotation_tests.rs"]
mod tests;
