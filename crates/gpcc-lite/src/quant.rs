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
    /// Quantises coefficients with [`VALUE_BITS`] fraction bits: `sign(c) floor(|c| / step + r)`
    /// with the rounding offset `r = rounding / 256`. The DC (index 0) is rounded to nearest.
    #[must_use]
    pub fn quantise(self, coefficients: &[i64], rounding: u8) -> Vec<i32> {
        let scale = self.per_unit();
        let offset = f64::from(rounding) / 256.0;
        let one = |c: i64, offset: f64| {
            let q = (c.unsigned_abs() as f64 * scale + offset) as i32;
            if c < 0 { -q } else { q }
        };
        let mut out: Vec<i32> = coefficients.iter().map(|&c| one(c, offset)).collect();
        if let (Some(q), Some(&c)) = (out.first_mut(), coefficients.first()) {
            *q = one(c, 0.5);
        }
        out
    }

    /// Steps per unit of the coefficients' last place.
    fn per_unit(self) -> f64 {
        f64::from(1u32 << (16 - VALUE_BITS)) / self.0.max(1) as f64
    }

    /// Reconstructs coefficients with [`VALUE_BITS`] fraction bits.
    #[must_use]
    pub fn dequantise(self, quantised: &[i32], centroids: Centroids) -> Vec<i64> {
        let step = i128::from(self.0);
        let one = |q: i32, shift: i64| {
            let magnitude = ((i64::from(q).abs() << 8) - shift).max(0);
            let v = (i128::from(magnitude) * step) >> (8 + 16 - VALUE_BITS);
            let v = v.min(1 << 61) as i64;
            if q < 0 { -v } else { v }
        };
        let mut out: Vec<i64> =
            quantised.iter().map(|&q| one(q, centroids.of(q.unsigned_abs()))).collect();
        if let (Some(v), Some(&q)) = (out.first_mut(), quantised.first()) {
            *v = one(q, 0);
        }
        out
    }
}

/// How far the mean of the values in a quantiser cell lies below the cell's centre, in 1/256 of
/// a step, for magnitudes 1, 2 and above.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Centroids([i8; 3]);

impl Centroids {
    /// The shifts that minimise the squared error of `quantised`.
    #[must_use]
    pub fn measure(coefficients: &[i64], quantised: &[i32], step: Step) -> Self {
        let scale = step.per_unit() * 256.0;
        let mut sum = [0i64; 3];
        let mut count = [0i64; 3];
        for (&c, &q) in coefficients.iter().zip(quantised).skip(1) {
            if q == 0 {
                continue;
            }
            let m = q.unsigned_abs();
            let class = (m as usize).min(3) - 1;
            let exact = (c.unsigned_abs() as f64 * scale) as i64;
            sum[class] += (i64::from(m) << 8).saturating_sub(exact).clamp(-512, 512);
            count[class] += 1;
        }
        let mean = |i: usize| (sum[i] / count[i].max(1)).clamp(-127, 127) as i8;
        Self([mean(0), mean(1), mean(2)])
    }

    fn of(self, magnitude: u32) -> i64 {
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
