//! [`Place`] and [`Look`]: what the distortion of a leaf needs to know of its members.
//!
//! Additive statistics of a set of weighted Gaussians. From these the weighted 2-Wasserstein
//! distortion of merging the set follows in closed form. For Gaussians,
//! `W2^2 = |mu - mu'|^2 + B^2(S, S')` with the Bures distance `B`, and
//! `B^2(S, S') <= |S^(1/2) - S'^(1/2)|_F^2`, with equality where the covariances commute. The
//! right side is a squared distance in a linear space: the best merged covariance is the square
//! of the weighted mean of square roots, and the total distance to it is a variance. So no
//! barycenter is iterated, and what is minimised is an upper bound of what eq. 5 measures.
//! (Square roots are free: `R diag(s) R^T`.)

use crate::gaussian::Symmetric;
use crate::record::Record;

/// Where a set of Gaussians is, relative to some point: enough to tell, mostly, that a cell is
/// no leaf.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Place {
    /// Sum of weights.
    pub(crate) weight: f64,
    /// Sum of weight times offset.
    first: [f64; 3],
    /// Sum of weight times squared offset.
    second: f64,
    /// Sum of importances.
    pub(crate) importance: f64,
}

impl Place {
    /// One Gaussian, whose mean is `d` from the point of reference.
    pub(crate) fn of(record: &Record, d: [f64; 3]) -> Self {
        let weight = record.geometry;
        Self {
            weight,
            first: d.map(|x| weight * x),
            second: weight * square(&d),
            importance: record.importance,
        }
    }

    /// Adds a set whose positions are relative to the same point.
    pub(crate) fn add(&mut self, other: &Self) {
        self.weight += other.weight;
        self.second += other.second;
        self.importance += other.importance;
        for k in 0..3 {
            self.first[k] += other.first[k];
        }
    }

    /// The same set with positions relative to the old point plus `shift`.
    pub(crate) fn moved(mut self, shift: [f64; 3]) -> Self {
        self.second += self.second_shift(shift);
        for (first, shift) in self.first.iter_mut().zip(shift) {
            *first -= self.weight * shift;
        }
        self
    }

    /// Weighted sum of squared distances of the means from `point` (relative like them).
    pub(crate) fn displacement(&self, point: [f64; 3]) -> f64 {
        (self.second + self.second_shift(point)).max(0.0)
    }

    fn second_shift(&self, shift: [f64; 3]) -> f64 {
        (0..3).map(|k| shift[k] * (self.weight * shift[k] - 2.0 * self.first[k])).sum()
    }
}

/// Shapes and colours of a set of Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Look {
    /// Sum of weights.
    weight: f64,
    /// Sum of importances.
    importance: f64,
    /// Sum of weight times the square root of the covariance.
    root: Symmetric,
    /// Sum of weight times the trace of the covariance.
    trace: f64,
    /// Sum of importance times DC colour.
    colour: [f64; 3],
    /// Sum of importance times squared DC colour.
    colour_second: f64,
}

impl Look {
    /// One Gaussian.
    pub(crate) fn of(record: &Record) -> Self {
        let (weight, importance) = (record.geometry, record.importance);
        let root = record.root.map(f64::from);
        let colour = record.colour.map(f64::from);
        Self {
            weight,
            importance,
            root: root.map(|x| weight * x),
            // Of the rounded root: a set of one must come out without distortion.
            trace: weight * norm_squared(&root),
            colour: colour.map(|x| importance * x),
            colour_second: importance * square(&colour),
        }
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.weight += other.weight;
        self.importance += other.importance;
        self.trace += other.trace;
        self.colour_second += other.colour_second;
        for k in 0..6 {
            self.root[k] += other.root[k];
        }
        for k in 0..3 {
            self.colour[k] += other.colour[k];
        }
    }

    /// Weighted sum of squared distances of the covariances' square roots from their mean.
    pub(crate) fn shape(&self) -> f64 {
        let square = norm_squared(&self.root);
        (self.trace - square / self.weight.max(f64::MIN_POSITIVE)).max(0.0)
    }

    /// Weighted sum of squared distances of the DC colours from their mean.
    pub(crate) fn colours(&self) -> f64 {
        let square = square(&self.colour);
        (self.colour_second - square / self.importance.max(f64::MIN_POSITIVE)).max(0.0)
    }
}

fn square(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum()
}

/// Squared Frobenius norm of a symmetric matrix.
fn norm_squared(m: &Symmetric) -> f64 {
    square(&m[..3]) + 2.0 * square(&m[3..])
}
