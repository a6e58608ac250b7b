//! The locally adaptive part of the prediction, in integers.
//!
//! What the global predictor leaves of one Gaussian is a vector with one entry per column. Its
//! covariance is followed along the coding order with a fading memory; the factor `L` of
//! `covariance = L D L^T` predicts each entry from the innovations of the entries before it:
//! `z_c = sum_j L_cj e_j + e_c`. The views that see a region decide which SH coefficients move
//! together, so this covariance changes from place to place.

/// Fraction bits of a normalised entry: 256 is the column's typical error.
const UNIT: u32 = 8;
/// Entries are cut off here.
const CLIP: i32 = 6 << UNIT;
/// An entry in units of the column, `2^scale`.
#[inline]
pub(super) fn unscale(entry: i32, scale: u32) -> i64 {
    i64::from(entry) << scale >> UNIT
}

/// Fraction bits of the factor. Factor and innovations fit 16 bits, their products' sum 32.
const FACTOR_BITS: u32 = 12;
/// Entries of the factor are cut off here.
const FACTOR_CLIP: i64 = 2 << FACTOR_BITS;
/// Numerators of the factor are cut off here, so that no sum can leave 64 bits; a clipped factor
/// need not belong to any covariance.
const NUMERATOR_CLIP: i64 = 1 << 36;
/// Rows between two factorisations.
const BLOCK: u32 = 32;
/// Each block forgets 1 / 2^FADE of what was known.
const FADE: u32 = 3;
/// Rows of no correlation that the covariance starts with and never forgets.
const RIDGE: i64 = 6 << (2 * UNIT);

/// The covariance of the remainders of all columns, its factor, and the current row.
#[derive(Clone, Debug)]
pub(super) struct Local {
    columns: usize,
    /// Lower triangle, row-major in a square.
    covariance: Vec<i64>,
    /// The same of the rows since the last factorisation.
    recent: Vec<i32>,
    factor: Vec<i16>,
    innovations: Vec<i16>,
    row: Vec<i16>,
    rows: u32,
}

impl Local {
    pub(super) fn new(columns: usize) -> Self {
        Self {
            columns,
            covariance: vec![0; columns * columns],
            recent: vec![0; columns * columns],
            factor: vec![0; columns * columns],
            innovations: vec![0; columns],
            row: vec![0; columns],
            rows: 0,
        }
    }

    /// The predicted entry `c`; a column's typical error is 256.
    #[inline]
    pub(super) fn predict(&self, c: usize) -> i32 {
        let factor = &self.factor[c * self.columns..c * self.columns + c];
        let mut sum = 0i32;
        for (&l, &e) in factor.iter().zip(&self.innovations[..c]) {
            sum += i32::from(l) * i32::from(e);
        }
        (sum >> FACTOR_BITS).clamp(-CLIP, CLIP)
    }

    /// Sets entry `c`, which was predicted as `predicted`; `rest` is in units of
    /// `2^scale / 256`, or `None` if the value was coded without prediction.
    #[inline]
    pub(super) fn set(&mut self, c: usize, scale: u32, predicted: i32, rest: Option<i64>) {
        let z = match rest {
            Some(rest) => ((rest << UNIT) >> scale).clamp(-i64::from(CLIP), i64::from(CLIP)) as i32,
            None => predicted,
        };
        self.row[c] = z as i16;
        self.innovations[c] = (z - predicted) as i16;
    }

    /// Ends a row.
    pub(super) fn end_row(&mut self) {
        let n = self.columns;
        // Rows far from typical count less: each is brought towards unit energy.
        let energy: i64 =
            self.row.iter().map(|&z| i64::from(z) * i64::from(z)).sum::<i64>() / n as i64;
        let gain = (1 << (UNIT + 8))
            / ((energy.unsigned_abs() + (1 << (2 * UNIT - 2))).isqrt() as i32 + 1);
        for z in &mut self.row {
            *z = ((i32::from(*z) * gain) >> 8) as i16;
        }
        for i in 0..n {
            let zi = self.row[i];
            if zi == 0 {
                continue;
            }
            let out = &mut self.recent[i * n..i * n + i + 1];
            for (r, &z) in out.iter_mut().zip(&self.row) {
                *r += i32::from(zi) * i32::from(z);
            }
        }
        self.rows += 1;
        if self.rows.is_multiple_of(BLOCK) {
            self.factorise();
        }
    }

    fn factorise(&mut self) {
        let n = self.columns;
        for (g, r) in self.covariance.iter_mut().zip(&mut self.recent) {
            *g += i64::from(*r) - (*g >> FADE);
            *r = 0;
        }
        // Row i of L D, in units of the covariance.
        let mut scaled = vec![0i64; n];
        let mut pivots = vec![0i64; n];
        for i in 0..n {
            for j in 0..i {
                let factor = &self.factor[j * n..j * n + j];
                let mut sum = 0i64;
                for (&s, &l) in scaled.iter().zip(factor) {
                    sum += s * i64::from(l);
                }
                let s = self.covariance[i * n + j] - (sum >> FACTOR_BITS);
                let s = s.clamp(-NUMERATOR_CLIP, NUMERATOR_CLIP);
                scaled[j] = s;
                let l = (s << FACTOR_BITS) / pivots[j];
                self.factor[i * n + j] = l.clamp(-FACTOR_CLIP, FACTOR_CLIP) as i16;
            }
            let mut sum = 0i64;
            for (&s, &l) in scaled[..i].iter().zip(&self.factor[i * n..]) {
                sum += s * i64::from(l);
            }
            let pivot = self.covariance[i * n + i] + RIDGE - (sum >> FACTOR_BITS);
            pivots[i] = pivot.max(RIDGE / 2);
        }
    }
}
