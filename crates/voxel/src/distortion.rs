//! [`CellMoments`]: sums over the members of a cell, from which the distortion of a leaf follows.
//!
//! The distortion is the weighted 2-Wasserstein distortion of merging the members (the paper's
//! eq. 3 to 5), in closed form. For Gaussians, `W2^2 = |mu - mu'|^2 + B^2(S, S')` with the Bures
//! distance `B`, and `B^2(S, S') <= |S^(1/2) - S'^(1/2)|_F^2`, with equality where the covariances
//! commute. The right side is a squared distance in a linear space: the best merged covariance is
//! the square of the weighted mean of the square roots, and the total distance to it is a
//! variance. So no barycenter is iterated, and what is minimised is an upper bound of eq. 4.
//! (The square root of a covariance is `R diag(s) R^T`.)
//!
//! *Invariant:* moments are additive, so those of a cell follow from those of its children.

use gs_model::math::Symmetric;

use crate::record::Record;

/// Moments of the means, shapes and DC colours of a set of Gaussians. Means are relative to some
/// point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CellMoments {
    /// Sum of importances.
    pub(crate) importance: f64,
    /// Sum of weights ([`Record::geometry`]).
    weight: f64,
    /// Sum of weight times offset of the mean.
    offset: [f64; 3],
    /// Sum of weight times squared offset.
    offset_squared: f64,
    /// Sum of weight times the square root of the covariance.
    root: Symmetric,
    /// Sum of weight times the trace of the covariance.
    trace: f64,
    /// Sum of importance times DC colour.
    colour: [f64; 3],
    /// Sum of importance times squared DC colour.
    colour_squared: f64,
}

impl CellMoments {
    /// Of one Gaussian, whose mean is at `offset` from the point.
    pub(crate) fn of(record: &Record, offset: [f64; 3]) -> Self {
        let (weight, importance) = (record.geometry, record.importance);
        let root = record.root.map(f64::from);
        let colour = record.colour.map(f64::from);
        Self {
            importance,
            weight,
            offset: offset.map(|x| weight * x),
            offset_squared: weight * square(&offset),
            root: root.map(|x| weight * x),
            // Of the rounded root: a set of one must have no distortion of shape.
            trace: weight * norm_squared(&root),
            colour: colour.map(|x| importance * x),
            colour_squared: importance * square(&colour),
        }
    }

    /// Adds a set whose means are relative to the same point.
    pub(crate) fn add(&mut self, other: &Self) {
        self.importance += other.importance;
        self.weight += other.weight;
        self.offset_squared += other.offset_squared;
        self.trace += other.trace;
        self.colour_squared += other.colour_squared;
        for k in 0..3 {
            self.offset[k] += other.offset[k];
            self.colour[k] += other.colour[k];
        }
        for k in 0..6 {
            self.root[k] += other.root[k];
        }
    }

    /// The same set with means relative to the old point plus `shift`.
    pub(crate) fn moved(mut self, shift: [f64; 3]) -> Self {
        self.offset_squared +=
            (0..3).map(|k| shift[k] * (self.weight * shift[k] - 2.0 * self.offset[k])).sum::<f64>();
        for (offset, shift) in self.offset.iter_mut().zip(shift) {
            *offset -= self.weight * shift;
        }
        self
    }

    /// Weighted sum of squared distances of the means from the point.
    pub(crate) fn displacement(&self) -> f64 {
        self.offset_squared.max(0.0)
    }

    /// Weighted sum of squared distances of the means from their weighted mean.
    pub(crate) fn scatter(&self) -> f64 {
        let square = square(&self.offset);
        (self.offset_squared - square / self.weight.max(f64::MIN_POSITIVE)).max(0.0)
    }

    /// Weighted sum of squared distances of the covariances' square roots from their mean.
    pub(crate) fn shape(&self) -> f64 {
        let square = norm_squared(&self.root);
        (self.trace - square / self.weight.max(f64::MIN_POSITIVE)).max(0.0)
    }

    /// Weighted sum of squared distances of the DC colours from their mean.
    pub(crate) fn colour(&self) -> f64 {
        let square = square(&self.colour);
        (self.colour_squared - square / self.importance.max(f64::MIN_POSITIVE)).max(0.0)
    }
}

fn square(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum()
}

/// Squared Frobenius norm of a symmetric matrix.
fn norm_squared(m: &Symmetric) -> f64 {
    square(&m[..3]) + 2.0 * square(&m[3..])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the double sums that the moments stand for.
    #[test]
    fn moments_give_the_direct_sums() {
        let records: Vec<Record> = (0..7)
            .map(|i| {
                let x = |k: i32| ((i * 37 + k * 11) % 23) as f32 / 23.0;
                Record {
                    root: std::array::from_fn(|k| x(k as i32)),
                    mean: [x(6), x(7), x(8)],
                    colour: [x(9), x(10), x(11)],
                    geometry: f64::from(x(12)) + 0.1,
                    importance: f64::from(x(13)) + 0.2,
                }
            })
            .collect();
        let point = [0.3, -0.2, 0.7];
        // Each relative to its own mean, then moved to the common point.
        let mut sum = CellMoments::default();
        for r in &records {
            let shift = [0, 1, 2].map(|k| point[k] - f64::from(r.mean[k]));
            sum.add(&CellMoments::of(r, [0.0; 3]).moved(shift));
        }
        let displacement = |r: &Record| {
            (0..3).map(|k| f64::from(r.mean[k]) - point[k]).map(|d| d * d).sum::<f64>()
        };
        let direct: f64 = records.iter().map(|r| r.geometry * displacement(r)).sum();
        // Entries off the diagonal count twice.
        let root = |r: &Record, k: usize| f64::from(r.root[if k < 6 { k } else { k - 3 }]);
        let colour = |r: &Record, k: usize| f64::from(r.colour[k]);
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} is not {b}");
        close(sum.displacement(), direct);
        close(sum.shape(), spread(&records, 9, root, |r| r.geometry));
        close(sum.colour(), spread(&records, 3, colour, |r| r.importance));
    }

    /// Weighted sum of squared distances of vectors of `len` entries from their weighted mean.
    fn spread(
        records: &[Record],
        len: usize,
        entry: impl Fn(&Record, usize) -> f64,
        weight: impl Fn(&Record) -> f64,
    ) -> f64 {
        let total: f64 = records.iter().map(&weight).sum();
        let of_entry = |k: usize| {
            let mean = records.iter().map(|r| weight(r) * entry(r, k)).sum::<f64>() / total;
            let square = |r: &Record| (entry(r, k) - mean) * (entry(r, k) - mean);
            records.iter().map(|r| weight(r) * square(r)).sum::<f64>()
        };
        (0..len).map(of_entry).sum()
    }
}
