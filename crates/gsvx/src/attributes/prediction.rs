//! Linear prediction of SH degrees 2 and 3 from the degree below.
//!
//! Cameras see a Gaussian from a part of the sphere only. On that part the SH basis functions are far from
//! independent, so training moves the coefficients of all degrees together. A linear prediction from the
//! degree below therefore removes much of a degree. It is the same for the three colour planes. It changes
//! from place to place with the directions of the cameras, so each run of leaves has its own factors. The
//! stream holds the residuals of the prediction from the decoded degree below.
//!
//! A decoder's arithmetic is `+` and `*` in single precision in a stated order.

use crate::bytes::SliceReader;
use crate::error::{Error, Result};
#[cfg(feature = "encode")]
use crate::importance;
#[cfg(feature = "encode")]
use gpcc_lite::raht::Rows;

/// Factors are multiples of 1/64.
const UNIT: f32 = 64.0;
/// Binary logarithms of the lengths that runs may have.
const LOG_RUNS: std::ops::RangeInclusive<u8> = 10..=30;
/// Run lengths that the encoder tries, as logarithms. At low rates short runs often do not pay, and longer ones do.
/// Half as many leaves save 0.1 % of a stream at best, twice as many cost up to 0.7 %.
#[cfg(feature = "encode")]
const TRIED: [u8; 2] = [12, 14];
/// Of this many consecutive leaves, one pair of neighbours serves to fit the factors. Another pair serves to
/// test whether they pay.
#[cfg(feature = "encode")]
const STRIDE: usize = 4;
/// Ridge of the least squares, in squares of steps: inputs of little energy get small factors.
#[cfg(feature = "encode")]
const RIDGE: f64 = 4.0;
/// Four channels of a row.
type Lanes = [f32; 4];

/// Coefficients of a degree.
const fn coefficients(degree: u8) -> usize {
    2 * degree as usize + 1
}

/// The prediction of SH degree 2 or 3.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Predictor {
    degree: u8,
    log_run: u8,
    /// By run, coefficient of the degree and coefficient of the degree below.
    factors: Vec<i8>,
    /// The same as they are used: by run, coefficient below and channel.
    lanes: Vec<Lanes>,
}

/// Chunks of four that hold the channels of degrees 2 and 3: the const parameter `V` below, beside
/// `IN`, the coefficients below.
const CHUNKS: [usize; 2] = [4, 6];

impl Predictor {
    fn new(degree: u8, log_run: u8, factors: Vec<i8>) -> Self {
        let (inputs, outputs) = (coefficients(degree - 1), coefficients(degree));
        let chunks = CHUNKS[usize::from(degree == 3)];
        let mut lanes = Vec::with_capacity(factors.len() / outputs * chunks);
        for run in factors.chunks_exact(inputs * outputs) {
            for input in 0..inputs {
                let of = |channel: usize| match run.get(channel / 3 * inputs + input) {
                    Some(&factor) => f32::from(factor) / UNIT,
                    None => 0.0,
                };
                lanes.extend((0..chunks).map(|k| std::array::from_fn(|i| of(4 * k + i))));
            }
        }
        Self { degree, log_run, factors, lanes }
    }

    /// Reads the prediction of `degree`, 2 or 3, of so many leaves; `None` if there is none.
    ///
    /// # Errors
    /// [`Error::Truncated`] and [`Error::Corrupt`].
    pub(crate) fn read(degree: u8, leaves: usize, r: &mut SliceReader<'_>) -> Result<Option<Self>> {
        let log_run = r.u8()?;
        if log_run == 0 {
            return Ok(None);
        }
        if !LOG_RUNS.contains(&log_run) {
            return Err(Error::Corrupt { what: "SH prediction", value: log_run.into() });
        }
        let need = leaves.div_ceil(1 << log_run) * coefficients(degree) * coefficients(degree - 1);
        let factors = r.take(need)?.iter().map(|&b| b as i8).collect();
        Ok(Some(Self::new(degree, log_run, factors)))
    }

    /// The logarithm of the run length, and the factors by run, coefficient of the degree and coefficient of the
    /// degree below.
    #[cfg(feature = "encode")]
    pub(crate) fn as_floats(&self) -> (u8, Vec<f32>) {
        (self.log_run, self.factors.iter().map(|&f| f32::from(f) / UNIT).collect())
    }

    /// Undoes [`Predictor::read`] of a prediction.
    #[cfg(feature = "encode")]
    pub(crate) fn write(&self, out: &mut Vec<u8>) {
        out.push(self.log_run);
        out.extend(self.factors.iter().map(|&f| f as u8));
    }

    /// Adds its prediction to the values of leaf `leaf`, given those of the degree below; three channels
    /// per coefficient.
    #[inline]
    pub(crate) fn add(&self, leaf: usize, below: &[f32], values: &mut [f32]) {
        if self.degree == 2 {
            self.add_by::<3, 4>(leaf, below, values, |v, p| v + p);
        } else {
            self.add_by::<5, 6>(leaf, below, values, |v, p| v + p);
        }
    }

    /// Undoes [`Predictor::add`] up to rounding.
    #[cfg(feature = "encode")]
    #[inline]
    pub(crate) fn subtract(&self, leaf: usize, below: &[f32], values: &mut [f32]) {
        if self.degree == 2 {
            self.add_by::<3, 4>(leaf, below, values, |v, p| v - p);
        } else {
            self.add_by::<5, 6>(leaf, below, values, |v, p| v - p);
        }
    }

    #[inline]
    fn add_by<const IN: usize, const V: usize>(
        &self,
        leaf: usize,
        below: &[f32],
        values: &mut [f32],
        op: impl Fn(f32, f32) -> f32,
    ) {
        let run = leaf >> self.log_run;
        let (runs, _) = self.lanes.as_chunks::<V>().0.as_chunks::<IN>();
        let (below, _) = below.as_chunks::<3>();
        let Some(below) = below.first_chunk::<IN>() else { return };
        let predicted = predict(&runs[run], below);
        for (value, p) in values.iter_mut().zip(predicted.as_flattened()) {
            *value = op(*value, *p);
        }
    }

    /// Fits the prediction of `degree`, if it pays: `lower` are the decoded values of the degree
    /// below, `exact(i, row)` fills in the values of leaf `i`, both in units of the transform;
    /// `classes` the importance classes, `steps` those of luma and chroma in the same units.
    #[cfg(feature = "encode")]
    #[must_use]
    pub(crate) fn fit(
        degree: u8,
        lower: &Rows,
        classes: &[u8],
        steps: [f32; 2],
        exact: impl Fn(usize, &mut [f32]),
    ) -> Option<Self> {
        let fit = Fit { lower, classes, squares: steps.map(|s| 1.0 / (s * s)), exact };
        TRIED.into_iter().find_map(|log_run| {
            let (factors, saved) = if degree == 2 {
                fit.runs::<3, 3, 5, 4>(log_run)
            } else {
                fit.runs::<5, 4, 7, 6>(log_run)
            };
            (saved > 0.0).then(|| Self::new(degree, log_run, factors))
        })
    }
}

/// The predictions of a row. Each is a sum over the coefficients of the degree below, in the channel's plane, of
/// factor times coefficient, from left to right.
#[inline(always)]
fn predict<const IN: usize, const V: usize>(
    factors: &[[Lanes; V]; IN],
    lower: &[[f32; 3]; IN],
) -> [Lanes; V] {
    let mut sums = [[0.0; 4]; V];
    for (factors, &planes) in factors.iter().zip(lower) {
        let repeated = repeated(planes);
        for v in 0..V {
            for i in 0..4 {
                sums[v][i] += factors[v][i] * repeated[v % 3][i];
            }
        }
    }
    sums
}

/// Y, Co, Cg repeated, in the order of the channels of a row.
#[inline(always)]
fn repeated([y, o, g]: [f32; 3]) -> [Lanes; 3] {
    [[y, o, g, y], [o, g, y, o], [g, y, o, g]]
}

/// What factors are fitted to.
#[cfg(feature = "encode")]
struct Fit<'a, E> {
    lower: &'a Rows,
    classes: &'a [u8],
    /// One over the squares of the steps of luma and chroma.
    squares: [f32; 2],
    exact: E,
}

/// The differences between two neighbouring leaves, in the degree below and in the degree. A squared
/// difference times the weight of its plane is in squares of steps.
#[cfg(feature = "encode")]
struct Pair<const IN: usize, const V: usize> {
    lower: [[f32; 3]; IN],
    exact: [Lanes; V],
    weights: [f32; 3],
}

#[cfg(feature = "encode")]
impl<E: Fn(usize, &mut [f32])> Fit<'_, E> {
    /// The factors of all runs, zero where they do not pay, and the estimated bits that they save beyond
    /// their own. `INV` and `V` are the numbers of chunks of four that the channels of the degree below
    /// and of the degree fill.
    fn runs<const IN: usize, const INV: usize, const OUT: usize, const V: usize>(
        &self,
        log_run: u8,
    ) -> (Vec<i8>, f64) {
        let n = self.lower.leaves();
        let of = |run: usize| {
            let first = run << log_run;
            let last = n.min(first + (1 << log_run));
            let pairs = |from: usize| (first + from..last).step_by(STRIDE);
            let mut factors = self.factors::<IN, INV, OUT, V>(pairs(1));
            let saved = self.saved::<IN, OUT, V>(&factors, pairs(3));
            if saved <= 0.0 {
                factors.fill(0);
            }
            (factors, saved.max(0.0) - 8.0 * (IN * OUT) as f64)
        };
        let runs: Vec<(Vec<i8>, f64)> = (0..n.div_ceil(1 << log_run)).map(of).collect();
        let saved = runs.iter().map(|run| run.1).sum();
        (runs.into_iter().flat_map(|run| run.0).collect(), saved)
    }

    /// The differences between leaf `i` and the leaf before it.
    fn pair<const IN: usize, const V: usize>(&self, channels: usize, i: usize) -> Pair<IN, V> {
        let mut lower = [[[0.0; 3]; IN]; 2];
        for (k, lower) in lower.iter_mut().enumerate() {
            lower.as_flattened_mut().copy_from_slice(self.lower.row(i - 1 + k));
        }
        let mut exact = [[[0.0; 4]; V]; 2];
        for (k, exact) in exact.iter_mut().enumerate() {
            (self.exact)(i - 1 + k, &mut exact.as_flattened_mut()[..channels]);
        }
        let class = self.classes[i].min(self.classes[i - 1]);
        let class = importance::weight(class) as f32;
        let [luma, chroma] =
            self.squares.map(|s| s * (class / importance::weight(importance::MEAN_CLASS) as f32));
        Pair {
            lower: std::array::from_fn(|j| {
                std::array::from_fn(|plane| lower[1][j][plane] - lower[0][j][plane])
            }),
            exact: std::array::from_fn(|v| {
                std::array::from_fn(|k| exact[1][v][k] - exact[0][v][k])
            }),
            weights: [luma, chroma, chroma],
        }
    }

    /// Least squares over differences between neighbours, since the transform codes mostly differences.
    fn factors<const IN: usize, const INV: usize, const OUT: usize, const V: usize>(
        &self,
        pairs: impl Iterator<Item = usize>,
    ) -> Vec<i8> {
        // The products of each input with all inputs, and with all outputs, channel by channel.
        let mut a = [[[0.0f32; 4]; INV]; IN];
        let mut b = [[[0.0f32; 4]; V]; IN];
        for i in pairs {
            let pair: Pair<IN, V> = self.pair(3 * OUT, i);
            let mut below = [[0.0; 4]; INV];
            below.as_flattened_mut()[..3 * IN].copy_from_slice(pair.lower.as_flattened());
            for (j, planes) in pair.lower.iter().enumerate() {
                let weighted = repeated(std::array::from_fn(|p| planes[p] * pair.weights[p]));
                for v in 0..INV {
                    for k in 0..4 {
                        a[j][v][k] += weighted[v % 3][k] * below[v][k];
                    }
                }
                for v in 0..V {
                    for k in 0..4 {
                        b[j][v][k] += weighted[v % 3][k] * pair.exact[v][k];
                    }
                }
            }
        }
        // The three planes share their factors.
        let planes = |channels: &[f32], k: usize| -> f64 {
            channels[3 * k..3 * k + 3].iter().map(|&v| f64::from(v)).sum()
        };
        let mut energies = [[0.0; IN]; IN];
        for (j, row) in energies.iter_mut().enumerate() {
            for (k, energy) in row.iter_mut().enumerate() {
                *energy = planes(a[j].as_flattened(), k);
            }
            row[j] += RIDGE;
        }
        let mut factors = Vec::with_capacity(IN * OUT);
        for k in 0..OUT {
            let wanted = std::array::from_fn(|j| planes(b[j].as_flattened(), k));
            let of = |v: f64| {
                libm::round(v * f64::from(UNIT)).clamp(i8::MIN.into(), i8::MAX.into()) as i8
            };
            factors.extend(gs_model::math::solve(&energies, wanted).map(of));
        }
        factors
    }

    /// The estimated bits that the factors of a run save, without their own bits. `pairs` should not be those
    /// of the fit.
    fn saved<const IN: usize, const OUT: usize, const V: usize>(
        &self,
        factors: &[i8],
        pairs: impl Iterator<Item = usize>,
    ) -> f64 {
        let degree = ((OUT - 1) / 2) as u8;
        let lanes = Predictor::new(degree, 0, factors.to_vec()).lanes;
        let (by_input, _) = lanes.as_chunks::<V>();
        let Some(lanes) = by_input.first_chunk::<IN>() else { return 0.0 };
        let (mut plain, mut left) = (0u64, 0u64);
        for i in pairs {
            let pair: Pair<IN, V> = self.pair(3 * OUT, i);
            let predicted = predict(lanes, &pair.lower);
            let weights = repeated(pair.weights);
            for v in 0..V {
                for k in 0..4 {
                    let (weight, whole) = (weights[v % 3][k], pair.exact[v][k]);
                    let rest = whole - predicted[v][k];
                    plain += u64::from(half_bits(weight * (whole * whole)));
                    left += u64::from(half_bits(weight * (rest * rest)));
                }
            }
        }
        (plain as f64 - left as f64) * (0.5 * STRIDE as f64 / f64::from(1 << 23))
    }
}

/// About twice the bits of a difference whose square is `square` squared steps, in units of 2^-23. It is
/// `log2(1 + 6 square)`, read from the bits of a float, so it is linear between powers of two. Far below a
/// step the bits grow in proportion to the square, far above with its logarithm.
#[cfg(feature = "encode")]
#[inline(always)]
fn half_bits(square: f32) -> u32 {
    (1.0 + 6.0 * square).to_bits() - 1f32.to_bits()
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What [`Predictor::add`] does, as docs/format.md says it.
    fn add_slowly(predictor: &Predictor, first: usize, lower: &[f32], values: &mut [f32]) {
        let (inputs, outputs) =
            (coefficients(predictor.degree - 1), coefficients(predictor.degree));
        for (i, row) in values.chunks_exact_mut(3 * outputs).enumerate() {
            let run = (first + i) >> predictor.log_run;
            for (channel, value) in row.iter_mut().enumerate() {
                let mut sum = 0.0;
                for input in 0..inputs {
                    let factor = predictor.factors[(run * outputs + channel / 3) * inputs + input];
                    let below = lower[3 * inputs * i + 3 * input + channel % 3];
                    sum += f32::from(factor) / 64.0 * below;
                }
                *value += sum;
            }
        }
    }

    fn some(degree: u8) -> usize {
        coefficients(degree) * coefficients(degree - 1)
    }

    proptest! {
        #[test]
        fn the_fast_way_has_the_bits_of_the_slow_one(
            degree in 2u8..4,
            factors in prop::collection::vec(any::<i8>(), 70),
            values in prop::collection::vec(-1e6f32..1e6, 36 * 40),
            first in 1000usize..1024,
        ) {
            let predictor = Predictor::new(degree, 10, factors[..2 * some(degree)].to_vec());
            let (below, own) = (3 * coefficients(degree - 1), 3 * coefficients(degree));
            let lower = &values[..40 * below];
            let mut fast = values[values.len() - 40 * own..].to_vec();
            let mut slow = fast.clone();
            for (i, (lower, fast)) in lower.chunks(below).zip(fast.chunks_mut(own)).enumerate() {
                predictor.add(first + i, lower, fast);
            }
            add_slowly(&predictor, first, lower, &mut slow);
            let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&fast), bits(&slow));
        }

        #[test]
        fn factors_come_back_from_bytes(
            degree in 2u8..4,
            leaves in 0usize..5000,
            factors in prop::collection::vec(any::<i8>(), 5 * 35),
            rest in prop::collection::vec(any::<u8>(), 0..3),
        ) {
            let len = leaves.div_ceil(1 << 10) * some(degree);
            let predictor = Predictor::new(degree, 10, factors[..len].to_vec());
            let mut bytes = Vec::new();
            predictor.write(&mut bytes);
            let head = bytes.len();
            bytes.extend(&rest);
            let read = |bytes| Predictor::read(degree, leaves, &mut SliceReader::new(bytes, "test"));
            let mut r = SliceReader::new(&bytes, "test");
            prop_assert_eq!(Predictor::read(degree, leaves, &mut r).unwrap(), Some(predictor));
            prop_assert_eq!(r.remaining(), rest.len());
            prop_assert!(read(&bytes[..head - 1]).is_err());
            prop_assert_eq!(read(&[0]).unwrap(), None);
        }

        #[test]
        fn equations_are_solved(
            rows in prop::collection::vec(prop::array::uniform5(-1f64..1.0), 9),
            wanted in prop::array::uniform5(-2f64..2.0),
        ) {
            let mut a = [[0.0; 5]; 5];
            for (j, row) in a.iter_mut().enumerate() {
                for (k, a) in row.iter_mut().enumerate() {
                    *a = rows.iter().map(|r| r[j] * r[k]).sum();
                }
                row[j] += 0.1;
            }
            let b = a.map(|row| row.iter().zip(&wanted).map(|(a, x)| a * x).sum());
            for (found, wanted) in gs_model::math::solve(&a, b).iter().zip(wanted) {
                prop_assert!((found - wanted).abs() < 1e-9);
            }
        }
    }
}
