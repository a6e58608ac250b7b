//! The transform in fixed point: integers whose inverse has the same bits on every machine.
//!
//! For callers that want integers. Streams of [`crate::attribute`] hold differences of means
//! instead (`rows.rs`), whose single-precision operations are exact to the bit as well and take a
//! fraction of the time.

use super::{FACTOR_BITS, Plan};
use crate::error::Result;

impl Plan {
    /// Forward transform in fixed point, from leaf order to coefficient order, in place.
    ///
    /// The scale of `values` is the caller's; rounding errors are a few units of its last place,
    /// so give it fraction bits, say 12.
    ///
    /// # Errors
    /// If `values` is not one per point.
    pub fn forward_fixed(&self, values: &mut Vec<i64>) -> Result<()> {
        self.check(values.len())?;
        for (v, r) in values.iter_mut().zip(self.root_weights()) {
            *v = scale_up(*v, r);
        }
        for m in (0..self.left.len()).rev() {
            let [c, s] = self.factors(m).map(i128::from);
            let (i, j) = (self.left[m] as usize, self.right[m] as usize);
            let (a, b) = (i128::from(values[i]), i128::from(values[j]));
            values[i] = round_shift(c * a + s * b);
            values[j] = round_shift(c * b - s * a);
        }
        *values = self.to_coefficient_order(values);
        Ok(())
    }

    /// Inverse of [`Plan::forward_fixed`]: integers only (and correctly rounded IEEE square
    /// roots for the factors), hence the same bits on every machine.
    ///
    /// # Errors
    /// If `coefficients` is not one per point.
    pub fn inverse_fixed(&self, coefficients: &mut Vec<i64>) -> Result<()> {
        self.check(coefficients.len())?;
        let mut values = self.to_leaf_order(coefficients);
        for m in 0..self.left.len() {
            let [c, s] = self.factors(m).map(i128::from);
            let (i, j) = (self.left[m] as usize, self.right[m] as usize);
            let (low, high) = (i128::from(values[i]), i128::from(values[j]));
            values[i] = round_shift(c * low - s * high);
            values[j] = round_shift(s * low + c * high);
        }
        for (v, r) in values.iter_mut().zip(self.root_weights()) {
            *v = scale_down(*v, r);
        }
        *coefficients = values;
        Ok(())
    }

    /// `[sqrt(w1 / w), sqrt(w2 / w)]` of a merge: IEEE division and square root, then exact scaling
    /// by a power of two, so the integers agree everywhere.
    fn factors(&self, merge: usize) -> [i32; 2] {
        let [a, b] = self.child_weights(merge + 1);
        let w = (a + b) as f64;
        let one = f64::from(1u32 << FACTOR_BITS);
        [a, b].map(|x| ((x as f64 / w).sqrt() * one + 0.5) as i32)
    }
}

#[inline]
fn round_shift(v: i128) -> i64 {
    ((v + (1 << (FACTOR_BITS - 1))) >> FACTOR_BITS) as i64
}

fn scale_up(v: i64, root: f64) -> i64 {
    ((i128::from(v) * i128::from((root * 65536.0) as i64)) >> 16) as i64
}

fn scale_down(v: i64, root: f64) -> i64 {
    // proof: root >= 1, so the divisor is at least 65536.
    ((i128::from(v) << 16) / i128::from((root * 65536.0) as i64)) as i64
}
