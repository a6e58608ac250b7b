//! Least-squares cubic.

use glam::{DMat4, DVec4};

use super::Curve;

/// A cubic in the normalised variable `(x - middle) / half`, where `x` spans -1 to 1: the normal
/// equations of raw powers of PSNR would lose half the digits.
pub(super) struct Cubic {
    coefficients: [f64; 4],
    middle: f64,
    half: f64,
}

impl Cubic {
    /// Fits `ys` over `xs`; `None` for fewer than four distinct abscissae.
    pub(super) fn fit(xs: &[f64], ys: &[f64]) -> Option<Self> {
        let mut distinct = xs.to_vec();
        distinct.sort_by(f64::total_cmp);
        distinct.dedup();
        let (&low, &high) = (distinct.first()?, distinct.last()?);
        if distinct.len() < 4 || !(high - low).is_normal() {
            return None;
        }
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let (mut products, mut sums) = (DMat4::ZERO, DVec4::ZERO);
        for (&x, &y) in xs.iter().zip(ys) {
            let t = (x - middle) / half;
            let powers = DVec4::new(1.0, t, t * t, t * t * t);
            products +=
                DMat4::from_cols_array(&std::array::from_fn(|i| powers[i / 4] * powers[i % 4]));
            sums += powers * y;
        }
        let coefficients = (products.inverse() * sums).to_array();
        coefficients.iter().all(|c| c.is_finite()).then_some(Self { coefficients, middle, half })
    }

    fn antiderivative(&self, x: f64) -> f64 {
        let t = (x - self.middle) / self.half;
        let [a, b, c, d] = self.coefficients;
        self.half * t * (a + t * (b / 2.0 + t * (c / 3.0 + t * d / 4.0)))
    }
}

impl Curve for Cubic {
    fn integral(&self, a: f64, b: f64) -> f64 {
        self.antiderivative(b) - self.antiderivative(a)
    }
}
