//! Stages that compute in single precision, or sum much, against their twins in double precision at the places where
//! precision gives way. The bounds are those of docs/accuracy.md.

mod covariances;
mod merging;
mod rasterizer;
mod transform;

/// Half the distance between neighbours of 1 in single precision: the greatest relative error of a rounding.
const U: f64 = f64::EPSILON * (1u64 << 28) as f64;

/// How far a quantity of a stage was off for one input.
pub(crate) struct Figure {
    pub(crate) stage: &'static str,
    pub(crate) input: &'static str,
    /// Greatest error, in the unit that the stage names.
    pub(crate) error: f64,
    /// Greatest error over its bound.
    pub(crate) ratio: f64,
}

impl Figure {
    /// Whether the error is within its bound; a ratio of NaN is not.
    pub(crate) fn holds(&self) -> bool {
        self.ratio <= 1.0
    }

    /// What a bound that is broken says.
    pub(crate) fn failure(&self) -> String {
        let Self { stage, input, error, ratio } = self;
        format!("{stage}, {input}: {error:.1e}, {ratio:.2} of its bound")
    }
}

/// The greatest error of a quantity, and the greatest over its bound.
#[derive(Clone, Copy, Default)]
struct Greatest {
    error: f64,
    ratio: f64,
}

impl Greatest {
    /// Of a stage that does not run.
    const UNKNOWN: Self = Self { error: f64::NAN, ratio: f64::NAN };

    /// An error that is no number stays.
    fn add(&mut self, error: f64, bound: f64) {
        let greater = |a: f64, b: f64| if a.is_nan() || a > b { a } else { b };
        self.error = greater(error, self.error);
        self.ratio = greater(error / bound, self.ratio);
    }

    fn figure(self, stage: &'static str, input: &'static str) -> Figure {
        Figure { stage, input, error: self.error, ratio: self.ratio }
    }
}

/// Every stage and input. The sums have `many` terms.
pub(crate) fn all(many: usize) -> Vec<Figure> {
    let mut out = rasterizer::figures();
    out.extend(transform::figures(many));
    out.extend(merging::figures(many));
    out.extend(covariances::figures());
    out
}
