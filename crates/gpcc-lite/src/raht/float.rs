//! The transform in floating point: references for the error of the fixed-point form.
//!
//! These are not used in any stream.

use super::Plan;
use crate::error::Result;

macro_rules! float_forms {
    ($real:ty, $forward:ident, $inverse:ident) => {
        impl Plan {
            #[doc = concat!("Forward transform in `", stringify!($real), "`, from leaf order to coefficient order, in place.")]
            ///
            /// # Errors
            /// If `values` is not one per point.
            pub fn $forward(&self, values: &mut Vec<$real>) -> Result<()> {
                self.check(values.len())?;
                for (v, r) in values.iter_mut().zip(self.root_weights()) {
                    *v *= r as $real;
                }
                for m in (0..self.left.len()).rev() {
                    let [c, s] = self.exact_factors(m).map(|f| f as $real);
                    let (i, j) = (self.left[m] as usize, self.right[m] as usize);
                    let (a, b) = (values[i], values[j]);
                    values[i] = c * a + s * b;
                    values[j] = c * b - s * a;
                }
                *values = self.to_coefficient_order(values);
                Ok(())
            }

            #[doc = concat!("Inverse of [`Plan::", stringify!($forward), "`].")]
            ///
            /// # Errors
            /// If `coefficients` is not one per point.
            pub fn $inverse(&self, coefficients: &mut Vec<$real>) -> Result<()> {
                self.check(coefficients.len())?;
                let mut values = self.to_leaf_order(coefficients);
                for m in 0..self.left.len() {
                    let [c, s] = self.exact_factors(m).map(|f| f as $real);
                    let (i, j) = (self.left[m] as usize, self.right[m] as usize);
                    let (low, high) = (values[i], values[j]);
                    values[i] = c * low - s * high;
                    values[j] = s * low + c * high;
                }
                for (v, r) in values.iter_mut().zip(self.root_weights()) {
                    *v /= r as $real;
                }
                *coefficients = values;
                Ok(())
            }
        }
    };
}

float_forms!(f32, forward_f32, inverse_f32);
float_forms!(f64, forward_f64, inverse_f64);

impl Plan {
    fn exact_factors(&self, merge: usize) -> [f64; 2] {
        let [a, b] = self.child_weights(merge + 1);
        let sum = (a + b) as f64;
        [(a as f64 / sum).sqrt(), (b as f64 / sum).sqrt()]
    }
}
