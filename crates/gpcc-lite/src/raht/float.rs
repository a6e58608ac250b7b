//! The transform in double precision, merge by merge: the reference for [`super::forward`] and
//! [`super::inverse`].

use super::RahtPlan;
use crate::error::Result;

impl RahtPlan {
    /// Forward transform of one channel, from leaf order to coefficient order, in place.
    ///
    /// # Errors
    /// If `values` is not one per point.
    pub fn forward_f64(&self, values: &mut Vec<f64>) -> Result<()> {
        self.check(values.len())?;
        for (v, r) in values.iter_mut().zip(self.root_weights()) {
            *v *= r;
        }
        for m in (0..self.left.len()).rev() {
            let [c, s] = self.factors(m);
            let (i, j) = (self.left[m] as usize, self.right[m] as usize);
            let (a, b) = (values[i], values[j]);
            values[i] = c * a + s * b;
            values[j] = c * b - s * a;
        }
        *values = self.to_coefficient_order(values);
        Ok(())
    }

    /// Inverse of [`RahtPlan::forward_f64`].
    ///
    /// # Errors
    /// If `coefficients` is not one per point.
    pub fn inverse_f64(&self, coefficients: &mut Vec<f64>) -> Result<()> {
        self.check(coefficients.len())?;
        let mut values = self.to_leaf_order(coefficients);
        for m in 0..self.left.len() {
            let [c, s] = self.factors(m);
            let (i, j) = (self.left[m] as usize, self.right[m] as usize);
            let (low, high) = (values[i], values[j]);
            values[i] = c * low - s * high;
            values[j] = s * low + c * high;
        }
        for (v, r) in values.iter_mut().zip(self.root_weights()) {
            *v /= r;
        }
        *coefficients = values;
        Ok(())
    }

    /// `[sqrt(w1 / w), sqrt(w2 / w)]` of a merge.
    fn factors(&self, merge: usize) -> [f64; 2] {
        let [a, b] = self.child_weights(merge + 1);
        [(a / (a + b)).sqrt(), (b / (a + b)).sqrt()]
    }
}
