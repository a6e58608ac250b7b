//! One chunk whose values an optimiser moves: what the encoder makes of them, again and again.
//!
//! Leaves, classes and weights are fixed. Each [`ChunkLatents::code`] transforms the values, quantises
//! and reconstructs them as [`super::encode`] does, and leaves the result in a [`ChunkDecoder`], which
//! makes Gaussians of it as it does for a stream.
//!
//! *Invariant:* the Gaussians of [`ChunkLatents::decoded`] are those that a decoder makes of
//! [`ChunkLatents::layers`], bit for bit.

use super::encode::{encode_classes, subtract_predicted};
use super::{ChunkDecoder, SideFactors, steps_of};
use crate::attributes::prediction::Predictor;
use crate::attributes::side::Factors;
use crate::error::{Result, coding};
use crate::head::Steps;
use crate::importance;
use gpcc_lite::Leaf;
use gpcc_lite::attribute::{self, Options};
use gpcc_lite::coder::{Coder, Encoder, Silent, Tally};
use gpcc_lite::geometry;
use gpcc_lite::raht::{Plan, Rows};
use std::ops::Range;

/// Lagrangian multiplier of the quantisers, in `step^2` per bit. Values that were moved with the price of
/// their bits need less of a dead zone than others.
pub(crate) const LAMBDA: f32 = 0.04;

/// Bytes that a coder takes beside its words: four states and the number of words.
const CODER_BYTES: u64 = 18;

/// Channels of the covariance.
const SHAPE: usize = 6;

/// Values of all leaves of a chunk, leaf after leaf: ln(alpha), Y Co Cg of each SH coefficient, the six
/// log-Euclidean coordinates.
#[derive(Clone, Copy)]
pub(crate) struct Values<'a> {
    pub(crate) flat: &'a [f32],
    pub(crate) channels: usize,
}

impl Values<'_> {
    /// Distributes the values of all leaves to their groups.
    fn copy_to(self, sh_degree: u8, opacity: &mut Rows, sh: &mut [Rows; 4], shape: &mut Rows) {
        let leaves = self.flat.len() / self.channels;
        opacity.resize(leaves, 1);
        shape.resize(leaves, SHAPE);
        for degree in 0..=sh_degree {
            sh[usize::from(degree)].resize(leaves, channels_of(degree).len());
        }
        // In one pass, since memory decides how long it takes.
        for (i, values) in self.flat.chunks_exact(self.channels).enumerate() {
            opacity.row_mut(i)[0] = values[0];
            for degree in 0..=sh_degree {
                let sh = sh[usize::from(degree)].row_mut(i);
                copy_short(&values[channels_of(degree)], sh);
            }
            copy_short(&values[self.channels - SHAPE..], shape.row_mut(i));
        }
    }
}

/// Copies the channels of a group. With a number known at compile time that is a few instructions instead of
/// a call.
#[inline]
fn copy_short(from: &[f32], to: &mut [f32]) {
    fn copy<const N: usize>(from: &[f32], to: &mut [f32]) {
        if let (Some(from), Some(to)) = (from.first_chunk::<N>(), to.first_chunk_mut()) {
            *to = *from;
        }
    }
    match from.len() {
        1 => copy::<1>(from, to),
        3 => copy::<3>(from, to),
        6 => copy::<6>(from, to),
        9 => copy::<9>(from, to),
        15 => copy::<15>(from, to),
        21 => copy::<21>(from, to),
        _ => to.copy_from_slice(from),
    }
}

/// The channels of SH degree `degree`.
fn channels_of(degree: u8) -> Range<usize> {
    let d = usize::from(degree);
    1 + 3 * d * d..1 + 3 * (d + 1) * (d + 1)
}

/// See the module.
pub(crate) struct ChunkLatents {
    decoded: ChunkDecoder,
    predictors: [Option<Predictor>; 2],
    /// Holds geometry and importance classes.
    coder: Encoder,
    /// Bytes of geometry and importance classes alone.
    fixed_bytes: u64,
}

/// How a chunk's values become coefficients, for an executor that does not run in Rust. The leaves of a
/// chunk follow those of the chunks before.
#[derive(Clone, Debug)]
pub struct Transform<'a> {
    /// The transform; `None` without leaves.
    pub plan: Option<&'a Plan>,
    /// Importance class of each leaf.
    pub classes: &'a [u8],
    /// Factors of depth and class that predict ln(alpha).
    pub opacity: [f32; 2],
    /// Factors of depth and class that predict the first coordinate of the covariance.
    pub size: [f32; 2],
    /// The predictions of SH degrees 2 and 3 from the degree below: the binary logarithm of the leaves of a run,
    /// and the factors by run, coefficient of the degree and coefficient of the degree below.
    pub sh: [Option<(u8, Vec<f32>)>; 2],
}

/// How to code.
pub(crate) struct Coding<'a> {
    pub(crate) steps: &'a Steps,
    pub(crate) sh_degree: u8,
    /// Fit the predictions anew, and count bits.
    pub(crate) fit: bool,
}

/// A group of channels on its way through the coder.
struct Group<'a> {
    plan: &'a Plan,
    step: f32,
    prices: Option<&'a mut Rows>,
}

impl Group<'_> {
    fn code<C: Coder>(self, coder: &mut C, rows: &mut Rows) -> Result<bool> {
        let Self { plan, step, prices } = self;
        let (steps, options) = (steps_of(step, rows.channels()), Options { lambda: LAMBDA });
        match prices {
            None => attribute::encode(coder, plan, &steps, &options, rows),
            Some(prices) => {
                attribute::encode_with_prices(coder, plan, &steps, &options, rows, prices)
            }
        }
        .map_err(coding("attribute"))
    }

    /// As [`Group::code`], and the bits if they are `counted`.
    fn bits(self, counted: bool, rows: &mut Rows) -> Result<u64> {
        if !counted {
            return self.code(&mut Silent, rows).map(|_| 0);
        }
        let mut tally = Tally::default();
        self.code(&mut tally, rows)?;
        Ok(tally.bits())
    }
}

/// Derivatives of the bits by the values, group by group.
#[derive(Default)]
struct Prices {
    opacity: Rows,
    shape: Rows,
    sh: [Rows; 4],
}

impl ChunkLatents {
    /// Fixes leaves and classes; `log_classes` are real-valued classes of the leaves.
    pub(crate) fn new(leaves: Vec<Leaf>, j_high: u8, log_classes: &[f32]) -> Result<Self> {
        let plan = Plan::of(leaves, j_high).map_err(coding("geometry"))?;
        let mut coder = Encoder::default();
        geometry::encode_leaves(&mut coder, plan.leaves(), j_high).map_err(coding("geometry"))?;
        let (importance, classes) = encode_classes(&mut coder, &plan, log_classes)?;
        let weights: Vec<u32> = classes.iter().map(|&c| importance::weight(c)).collect();
        let plan = plan.weighted(&weights).map_err(coding("base layer"))?;
        let fixed_bytes = coder.clone().finish().len() as u64;
        let side = SideFactors { importance, ..SideFactors::default() };
        let decoded = ChunkDecoder::with_plan(plan, classes, side);
        Ok(Self { decoded, predictors: [None, None], coder, fixed_bytes })
    }

    /// The transform and the predictions.
    pub(crate) fn transform(&self) -> Transform<'_> {
        let (opacity, size) = self.decoded.side_factors();
        Transform {
            plan: self.decoded.plan(),
            classes: self.decoded.classes(),
            opacity: opacity.as_floats(),
            size: size.as_floats(),
            sh: self.predictors.each_ref().map(|p| p.as_ref().map(Predictor::as_floats)),
        }
    }

    /// The values as a decoder would have them.
    pub(crate) fn decoded(&self) -> &ChunkDecoder {
        &self.decoded
    }

    /// Transforms, quantises and reconstructs. With a fit it returns the number of bytes of the layers,
    /// as the coder would write them but for the rounding of its last words. Without, attributes are not
    /// counted. `prices` take the derivatives of the number of bits by the values.
    pub(crate) fn code(
        &mut self,
        how: &Coding<'_>,
        values: Values<'_>,
        prices: Option<&mut [f32]>,
    ) -> Result<u64> {
        let mut found = prices.is_some().then(Prices::default);
        let Prices { opacity, shape, sh } = &mut *found.get_or_insert_with(Prices::default);
        let priced = prices.is_some();
        let Self { decoded, predictors, .. } = self;
        let parts = decoded.parts()?;
        let (plan, classes) = (parts.plan, parts.classes);
        values.copy_to(how.sh_degree, parts.opacity, parts.sh, parts.shape);
        let group = |step, prices| Group { plan, step, prices };
        let [sh_dc, sh_rest @ ..] = parts.sh;
        let [dc_prices, rest_prices @ ..] = sh;
        let side = parts.side;
        let (base, rest) = rayon::join(
            || {
                rayon::join(
                    || -> Result<u64> {
                        let g = group(how.steps.opacity, priced.then_some(opacity));
                        let bits = one(g, &mut side.opacity, (how, classes), parts.opacity)?;
                        let g = group(how.steps.dc, priced.then_some(dc_prices));
                        Ok(bits + g.bits(how.fit, sh_dc)?)
                    },
                    || -> Result<u64> {
                        let g = group(how.steps.covariance, priced.then_some(shape));
                        one(g, &mut side.size, (how, classes), parts.shape)
                    },
                )
            },
            || {
                let degrees = Degrees { plan, classes, how };
                degrees.code(predictors, sh_rest, priced.then_some(rest_prices))
            },
        );
        *parts.sh_degree = how.sh_degree;
        let bits = base.0? + base.1?;
        if let Some(out) = prices {
            spread(&found.unwrap_or_default(), how.sh_degree, values.channels, out);
        }
        let base_bytes = self.fixed_bytes + SideFactors::LEN as u64 + bits.div_ceil(8);
        Ok(base_bytes + rest?)
    }

    /// The layers. Predictions are those of the last [`ChunkLatents::code`] with a fit.
    pub(crate) fn layers(
        &mut self,
        steps: &Steps,
        sh_degree: u8,
        values: Values<'_>,
    ) -> Result<Vec<Vec<u8>>> {
        let mut coder = self.coder.clone();
        let parts = self.decoded.parts()?;
        let (plan, classes, leaves) = (parts.plan, parts.classes, parts.plan.leaves());
        let group = |step| Group { plan, step, prices: None };
        values.copy_to(sh_degree, parts.opacity, parts.sh, parts.shape);
        subtract_predicted(parts.side.opacity, leaves, classes, parts.opacity);
        group(steps.opacity).code(&mut coder, parts.opacity)?;
        let [sh_dc, sh_rest @ ..] = parts.sh;
        group(steps.dc).code(&mut coder, sh_dc)?;
        subtract_predicted(parts.side.size, leaves, classes, parts.shape);
        group(steps.covariance).code(&mut coder, parts.shape)?;
        let mut base = parts.side.to_bytes().to_vec();
        base.extend(coder.finish());
        let mut layers = vec![base];
        let how = &Coding { steps, sh_degree, fit: false };
        let degrees = Degrees { plan, classes, how };
        for degree in 1..=sh_degree {
            layers.push(degrees.layer(degree, &mut self.predictors, sh_rest)?);
        }
        *parts.sh_degree = sh_degree;
        Ok(layers)
    }
}

/// Codes a group whose first channel is predicted from depth and class; returns the bits.
fn one(
    group: Group<'_>,
    factors: &mut Factors,
    (how, classes): (&Coding<'_>, &[u8]),
    rows: &mut Rows,
) -> Result<u64> {
    let leaves = group.plan.leaves();
    if how.fit {
        *factors = Factors::fit(leaves, classes, |i| rows.row(i)[0]);
    }
    subtract_predicted(*factors, leaves, classes, rows);
    group.bits(how.fit, rows)
}

/// The SH degrees of a chunk, from 1 on.
struct Degrees<'a> {
    plan: &'a Plan,
    classes: &'a [u8],
    how: &'a Coding<'a>,
}

impl Degrees<'_> {
    /// All degrees, one after another; returns the bytes if they are counted.
    fn code(
        &self,
        predictors: &mut [Option<Predictor>; 2],
        sh: &mut [Rows],
        mut prices: Option<&mut [Rows]>,
    ) -> Result<u64> {
        let mut bytes = 0;
        for degree in 1..=self.how.sh_degree {
            let prices = prices.as_mut().map(|p| &mut p[usize::from(degree) - 1]);
            if !self.how.fit {
                self.degree(degree, (&mut Silent, prices), predictors, sh)?;
                continue;
            }
            let mut tally = Tally::default();
            let all_zero = self.degree(degree, (&mut tally, prices), predictors, sh)?;
            let mut head = Vec::new();
            if degree >= 2 {
                Predictor::write(predictors[usize::from(degree) - 2].as_ref(), &mut head);
            }
            if head.len() > 1 || !all_zero {
                bytes += head.len() as u64 + CODER_BYTES + tally.bits().div_ceil(8);
            }
        }
        Ok(bytes)
    }

    /// The layer of one degree, from the reconstruction of the degree below.
    fn layer(
        &self,
        degree: u8,
        predictors: &mut [Option<Predictor>; 2],
        sh: &mut [Rows],
    ) -> Result<Vec<u8>> {
        let mut coder = Encoder::default();
        let all_zero = self.degree(degree, (&mut coder, None), predictors, sh)?;
        let mut out = Vec::new();
        if degree >= 2 {
            Predictor::write(predictors[usize::from(degree) - 2].as_ref(), &mut out);
        }
        if all_zero && out.len() <= 1 {
            return Ok(Vec::new());
        }
        out.extend(coder.finish());
        Ok(out)
    }

    /// Codes one degree; says whether all levels are zero.
    fn degree<C: Coder>(
        &self,
        degree: u8,
        (coder, prices): (&mut C, Option<&mut Rows>),
        predictors: &mut [Option<Predictor>; 2],
        sh: &mut [Rows],
    ) -> Result<bool> {
        let step = self.how.steps.sh[usize::from(degree) - 1];
        let (below, rest) = sh.split_at_mut(usize::from(degree) - 1);
        let rows = &mut rest[0];
        let mut predictor = None;
        if let (2.., Some(below)) = (degree, below.last()) {
            let kept = &mut predictors[usize::from(degree) - 2];
            if self.how.fit {
                let exact = |i: usize, row: &mut [f32]| row.copy_from_slice(rows.row(i));
                *kept = Predictor::fit(degree, below, self.classes, [step; 2], exact);
            }
            predictor = kept.as_ref().map(|p| (p, below));
        }
        if let Some((predictor, below)) = predictor {
            (0..rows.leaves()).for_each(|i| predictor.subtract(i, below.row(i), rows.row_mut(i)));
        }
        let all_zero = Group { plan: self.plan, step, prices }.code(coder, rows)?;
        if let Some((predictor, below)) = predictor {
            (0..rows.leaves()).for_each(|i| predictor.add(i, below.row(i), rows.row_mut(i)));
        }
        Ok(all_zero)
    }
}

/// Prices of all groups, in the layout of [`Values`].
fn spread(prices: &Prices, sh_degree: u8, channels: usize, out: &mut [f32]) {
    for (i, out) in out.chunks_exact_mut(channels).enumerate() {
        out[0] = prices.opacity.row(i)[0];
        for degree in 0..=sh_degree {
            copy_short(prices.sh[usize::from(degree)].row(i), &mut out[channels_of(degree)]);
        }
        copy_short(prices.shape.row(i), &mut out[channels - SHAPE..]);
    }
}
