//! Uniform quantisation: steps, rounding offset, centroid shift.

/// Fraction bits of the values the attribute coder feeds to the transform.
pub const VALUE_BITS: u32 = 12;

/// A quantiser step in 1/65536 of a value unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Step(pub u64);

/// `65536 * 2^(i/6)`, rounded.
const SIXTH: [u64; 6] = [65_536, 73_562, 82_570, 92_682, 104_032, 116_772];

impl Step {
    /// The step of a G-PCC quantisation parameter: `2^((qp - 4) / 6)`, for `qp >= 4`.
    #[must_use]
    pub fn from_qp(qp: u8) -> Self {
        let e = qp.saturating_sub(4);
        Self(SIXTH[(e % 6) as usize] << (e / 6).min(40))
    }

    /// An absolute step; values below 1/65536 become 1/65536.
    #[must_use]
    pub fn new(step: f64) -> Self {
        Self(((step * 65536.0 + 0.5) as u64).clamp(1, 1 << 47))
    }

    /// The step as a real number.
    #[must_use]
    pub fn value(self) -> f64 {
        self.0 as f64 / 65536.0
    }
}

impl Step {
    /// Steps per unit of the coefficients' last place.
    pub(crate) fn per_unit(self) -> f64 {
        f64::from(1u32 << (16 - VALUE_BITS)) / self.0.max(1) as f64
    }

    /// Reconstructs one coefficient with [`VALUE_BITS`] fraction bits.
    #[inline]
    pub(crate) fn dequantise_one(self, q: i32, centroids: Centroids) -> i64 {
        if q == 0 {
            return 0;
        }
        let magnitude = ((i64::from(q).abs() << 8) - centroids.of(q.unsigned_abs())).max(0);
        let v = (i128::from(magnitude) * i128::from(self.0)) >> (8 + 16 - VALUE_BITS);
        let v = v.min(1 << 61) as i64;
        if q < 0 { -v } else { v }
    }
}

/// How far the mean of the values in a quantiser cell lies below the cell's centre, in 1/256 of
/// a step, for magnitudes 1, 2 and above.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Centroids([i8; 3]);

impl Centroids {
    /// What predicted residuals of real clouds ask for where `zeros` of 256 are below
    /// [`Centroids::SMALL`] steps: the finer the step, the flatter the cells. Measuring them
    /// would take another pass, for they must be known before the first level is reconstructed.
    pub(crate) fn typical(zeros: u32) -> Self {
        Self(match zeros {
            0..32 => [-6, -1, 2],
            32..96 => [-3, 4, 5],
            96..144 => [1, 12, 10],
            144..176 => [5, 13, 12],
            176..208 => [10, 17, 12],
            208..236 => [18, 20, 11],
            _ => [23, 20, 9],
        })
    }

    /// Values, in steps, that are mostly quantised to zero.
    pub(crate) const SMALL: f32 = 0.65;

    pub(crate) fn of(self, magnitude: u32) -> i64 {
        match magnitude {
            0 => 0,
            m => i64::from(self.0[(m as usize).min(3) - 1]),
        }
    }

    pub(crate) fn to_bytes(self) -> [u8; 3] {
        self.0.map(|v| v as u8)
    }

    pub(crate) fn from_bytes(b: [u8; 3]) -> Self {
        Self(b.map(|v| v as i8))
    }
}

/// Sums from which [`Centroids`] are measured.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CentroidSums {
    sum: [i64; 3],
    count: [i64; 3],
}

impl CentroidSums {
    /// Adds a value of `exact` steps that was quantised to `magnitude > 0`.
    #[inline]
    pub(crate) fn add(&mut self, magnitude: u32, exact: f64) {
        let class = (magnitude as usize).min(3) - 1;
        let below = (f64::from(magnitude) - exact) * 256.0;
        self.sum[class] += below.clamp(-512.0, 512.0) as i64;
        self.count[class] += 1;
    }

    /// The shifts that minimise the squared error of the values added.
    pub(crate) fn centroids(&self) -> Centroids {
        let mean = |i: usize| (self.sum[i] / self.count[i].max(1)).clamp(-127, 127) as i8;
        Centroids([mean(0), mean(1), mean(2)])
    }

    /// How much of the squared error [`CentroidSums::centroids`] take away, in squares of steps.
    pub(crate) fn saved(&self) -> f64 {
        let squares = self.sum.iter().zip(&self.count).map(|(&sum, &n)| {
            let mean = sum as f64 / 256.0;
            mean * mean / n.max(1) as f64
        });
        squares.sum()
    }
}
