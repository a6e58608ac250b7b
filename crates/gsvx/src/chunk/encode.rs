//! From the values of a chunk to its layers, or to their number of bytes.
//!
//! Leaves, classes and weights are fixed when a [`ChunkEncoder`] is made. The values of each group then go through
//! the transform, the quantiser and a coder, and become those that a decoder will have. An optimiser does
//! that again and again.
//!
//! *Invariant:* [`ChunkEncoder::decoded`] makes the Gaussians that a decoder makes of the layers, bit for bit.

use super::check::{check, check_sh};
use super::gaussians::resize;
use super::groups::{BASE, GROUPS, Group, PredictFrom, Prediction, coded, colours};
use super::skeleton::Skeleton;
use super::{CLASS_STEP, ChunkValues, steps_of};
use crate::attributes::side::Factors;
use crate::error::{Result, coding};
use crate::head::Steps;
use gpcc_lite::Octree;
use gpcc_lite::attribute::{self, Quantisation};
use gpcc_lite::coder::{Coder, RansEncoder, Silent, Tally};
use gpcc_lite::geometry;
use gpcc_lite::raht::{RahtPlan, Rows};
use gs_model::{Scene, SceneMut};
use std::ops::Range;

/// Lagrangian multiplier of the quantiser of importance classes, in `step^2` per bit.
const LAMBDA_CLASSES: f32 = 18.0 / 256.0;
/// The same for values that an optimiser moves. It knows the price of their bits, so they need less of a dead
/// zone than others.
pub(crate) const LAMBDA_MOVED: f32 = 0.04;
/// Bytes that a coder takes beside its words: four states and the number of words.
const CODER_BYTES: u64 = 18;
/// Leaves whose SH coefficients are in memory as input at a time.
const PIECE: usize = 1 << 11;

/// How the values of a chunk are coded.
#[derive(Clone, Copy)]
pub(crate) struct CodingSettings<'a> {
    pub(crate) steps: &'a Steps,
    pub(crate) sh_degree: u8,
    /// Fit the predictions anew. Where nothing is written, bits are counted only then.
    pub(crate) fit: bool,
    /// Lagrangian multiplier of the quantisers; `None` for those of [`Group::lambda`], 0 rounds to nearest.
    pub(crate) lambda: Option<f32>,
}

/// Values of all leaves of a chunk, leaf after leaf: see [`Group::among`].
#[derive(Clone, Copy)]
pub(crate) struct Values<'a> {
    pub(crate) flat: &'a [f32],
    pub(crate) channels: usize,
}

/// How a chunk's values become coefficients, for an executor that does not run in Rust. The leaves of a
/// chunk follow those of the chunks before.
#[derive(Clone, Debug)]
pub struct Transform<'a> {
    /// The transform.
    pub plan: &'a RahtPlan,
    /// Importance class of each leaf.
    pub classes: &'a [u8],
    /// What predicts each of [`GROUPS`].
    pub predictions: [TransformPrediction; GROUPS.len()],
}

/// A prediction of the values of a group.
#[derive(Clone, Debug)]
pub enum TransformPrediction {
    /// Zero.
    None,
    /// Of the first channel: the factors of depth and class.
    Leaf([f32; 2]),
    /// From the SH degree below.
    Below {
        /// Binary logarithm of the leaves of a run.
        log_run: u8,
        /// By run, coefficient of the degree, and coefficient of the degree below.
        factors: Vec<f32>,
    },
}

/// See the module.
pub(crate) struct ChunkEncoder {
    values: ChunkValues,
    predictions: [Prediction; GROUPS.len()],
    /// The prediction of importance classes.
    importance: Factors,
    /// Holds geometry and importance classes.
    coder: RansEncoder,
    /// Derivatives of the bits by the values, by group.
    prices: [Rows; GROUPS.len()],
}

impl ChunkEncoder {
    /// Codes leaves and classes; `log_classes` are real-valued classes of the leaves.
    pub(crate) fn new(octree: Octree, log_classes: &[f32]) -> Result<Self> {
        let plan = RahtPlan::new(octree);
        let leaves = plan.leaves();
        let mut coder = RansEncoder::default();
        geometry::encode_leaves(&mut coder, plan.octree()).map_err(coding("geometry"))?;
        let even = vec![0; leaves.len()];
        let fitted = Factors::fit(leaves, &even, |i| log_classes[i]);
        let importance = Factors { class: 0, ..fitted };
        let mut rows = Rows::new(plan.len(), 1);
        for (i, &leaf) in leaves.iter().enumerate() {
            rows.row_mut(i)[0] = log_classes[i] - importance.predict(leaf, 0);
        }
        let quantisation = Quantisation { steps: &[CLASS_STEP], lambda: LAMBDA_CLASSES };
        attribute::encode(&mut coder, &plan, &quantisation, &mut rows)
            .map_err(coding("importance"))?;
        let skeleton = Skeleton::new(plan, importance, &rows)?;
        let values = ChunkValues { skeleton, ..ChunkValues::default() };
        let (predictions, prices) = Default::default();
        Ok(Self { values, predictions, importance, coder, prices })
    }

    /// The layers of a chunk whose Gaussians, one per leaf, are read once. `base` holds them with SH degree
    /// 0. `sh` gives the coefficients of a degree for a range of leaves: `2 degree + 1` per leaf. Errors count
    /// leaves from `before` on. `kept` is an empty scene that gets the Gaussians that a decoder makes of the layers.
    pub(crate) fn encode(
        mut self,
        how: &CodingSettings<'_>,
        base: Scene,
        sh: impl Fn(u8, Range<usize>) -> Result<Vec<[f32; 3]>> + Send,
        before: usize,
        kept: Option<&mut Scene>,
    ) -> Result<Vec<Vec<u8>>> {
        check(&base, before)?;
        let keep = kept.is_some();
        let leaves = base.len();
        let (front, coder) = (self.importance.depth as u8, std::mem::take(&mut self.coder));
        let (mut low, mut high) = self.parts(how, false);
        let (base, degrees) = rayon::join(
            || {
                for (group, rows) in low.groups.iter().zip(&mut *low.rows) {
                    rows.resize(leaves, group.channels);
                    (0..leaves).for_each(|i| group.values(&base, i, rows.row_mut(i)));
                }
                drop(base);
                let layer = low.base_layer(front, coder);
                if !keep {
                    low.rows.fill(Rows::default());
                }
                layer
            },
            move || {
                let layer = |number: usize| {
                    let degree = number as u8 + 1;
                    let rows = &mut high.rows[number];
                    rows.resize(leaves, high.groups[number].channels);
                    for first in (0..leaves).step_by(PIECE) {
                        let piece = sh(degree, first..leaves.min(first + PIECE))?;
                        let own = usize::from(2 * degree + 1);
                        check_sh(&piece, own, before + first)?;
                        let each = piece.chunks_exact(own);
                        (first..).zip(each).for_each(|(i, sh)| colours(sh, rows.row_mut(i)));
                    }
                    let layer = high.degree_layer(number);
                    // Only the next degree needs its values.
                    if let Some(below) = number.checked_sub(1).filter(|_| !keep) {
                        high.rows[below] = Rows::default();
                    }
                    layer
                };
                (0..usize::from(how.sh_degree)).map(layer).collect::<Result<Vec<_>>>()
            },
        );
        let mut layers = vec![base?];
        layers.extend(degrees?);
        if let Some(kept) = kept {
            self.values.sh_degree = how.sh_degree;
            resize(kept, leaves)?;
            self.values.fill(0, &mut SceneMut::of(kept));
        }
        Ok(layers)
    }

    /// The layers. Predictions are those of the last [`ChunkEncoder::code`] with a fit.
    pub(crate) fn layers(
        &mut self,
        how: &CodingSettings<'_>,
        values: Values<'_>,
    ) -> Result<Vec<Vec<u8>>> {
        self.set(how.sh_degree, values);
        let (front, coder) = (self.importance.depth as u8, self.coder.clone());
        let (mut low, mut high) = self.parts(how, false);
        let mut layers = vec![low.base_layer(front, coder)?];
        for number in 0..usize::from(how.sh_degree) {
            layers.push(high.degree_layer(number)?);
        }
        Ok(layers)
    }

    /// Transforms, quantises and reconstructs. With a fit it returns the number of bytes of the layers,
    /// as the coder would write them but for the rounding of its last words. Without, attributes are not
    /// counted. `prices` take the derivatives of the number of bits by the values.
    pub(crate) fn code(
        &mut self,
        how: &CodingSettings<'_>,
        values: Values<'_>,
        prices: Option<&mut [f32]>,
    ) -> Result<u64> {
        self.set(how.sh_degree, values);
        let (mut low, mut high) = self.parts(how, prices.is_some());
        let (base, degrees) = rayon::join(
            || (0..BASE).map(|number| Ok(low.count(number)?.0)).sum::<Result<u64>>(),
            || (0..usize::from(how.sh_degree)).map(|n| high.degree_bytes(n)).sum::<Result<u64>>(),
        );
        if let Some(out) = prices {
            let groups = coded(how.sh_degree);
            for (i, out) in out.chunks_exact_mut(values.channels).enumerate() {
                for (group, prices) in groups.iter().zip(&self.prices) {
                    copy_short(prices.row(i), &mut out[group.among(values.channels)]);
                }
            }
        }
        if !how.fit {
            return Ok(0);
        }
        let from_leaf = GROUPS.iter().filter(|g| g.predicted == PredictFrom::FromLeaf).count();
        let fixed = 1 + 2 * from_leaf + self.coder.clone().finish().len();
        Ok(fixed as u64 + base?.div_ceil(8) + degrees?)
    }

    /// The values as a decoder would have them.
    pub(crate) fn decoded(&self) -> &ChunkValues {
        &self.values
    }

    /// The transform and the predictions.
    pub(crate) fn transform(&self) -> Transform<'_> {
        Transform {
            plan: &self.values.skeleton.plan,
            classes: &self.values.skeleton.classes,
            predictions: self.predictions.each_ref().map(|prediction| match prediction {
                Prediction::None => TransformPrediction::None,
                Prediction::Leaf(factors) => TransformPrediction::Leaf(factors.as_floats()),
                Prediction::Below(predictor) => {
                    let (log_run, factors) = predictor.as_floats();
                    TransformPrediction::Below { log_run, factors }
                }
            }),
        }
    }

    /// Distributes the values of all leaves to their groups.
    fn set(&mut self, sh_degree: u8, values: Values<'_>) {
        let leaves = values.flat.len() / values.channels;
        let groups = coded(sh_degree);
        let all_rows = &mut self.values.rows[..groups.len()];
        for (group, rows) in groups.iter().zip(&mut *all_rows) {
            rows.resize(leaves, group.channels);
        }
        // In one pass, since memory decides how long it takes.
        for (i, flat) in values.flat.chunks_exact(values.channels).enumerate() {
            for (group, rows) in groups.iter().zip(&mut *all_rows) {
                copy_short(&flat[group.among(values.channels)], rows.row_mut(i));
            }
        }
        self.values.sh_degree = sh_degree;
    }

    /// The groups of the base layer, and those of the SH degrees: they do not depend on each other.
    fn parts<'a>(&'a mut self, how: &'a CodingSettings<'a>, priced: bool) -> (Part<'a>, Part<'a>) {
        let Self { values: ChunkValues { skeleton, rows, .. }, predictions, prices, .. } = self;
        let (groups, high_groups) = GROUPS.split_at(BASE);
        let (rows, high_rows) = rows.split_at_mut(BASE);
        let (predictions, high_predictions) = predictions.split_at_mut(BASE);
        let (prices, high_prices) = prices.split_at_mut(BASE);
        let low =
            Part { skeleton, how, groups, rows, predictions, prices: priced.then_some(prices) };
        let high = Part {
            skeleton,
            how,
            groups: high_groups,
            rows: high_rows,
            predictions: high_predictions,
            prices: priced.then_some(high_prices),
        };
        (low, high)
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

/// Some groups of a chunk on their way through a coder.
struct Part<'a> {
    skeleton: &'a Skeleton,
    how: &'a CodingSettings<'a>,
    groups: &'static [Group],
    rows: &'a mut [Rows],
    predictions: &'a mut [Prediction],
    prices: Option<&'a mut [Rows]>,
}

impl Part<'_> {
    /// Codes a group, whose rows become what a decoder will have. Says whether all levels are zero.
    fn code<C: Coder>(&mut self, number: usize, coder: &mut C) -> Result<bool> {
        let (group, plan) = (&self.groups[number], &self.skeleton.plan);
        let (below, rest) = self.rows.split_at_mut(number);
        let (below, rows) = (below.last(), &mut rest[0]);
        let step = group.step(self.how.steps);
        let prediction = &mut self.predictions[number];
        if self.how.fit {
            *prediction = group.fit(self.skeleton, step, below, rows);
        }
        prediction.subtract(self.skeleton, below, rows);
        let steps = steps_of(step, group.channels);
        let lambda = self.how.lambda.unwrap_or(group.lambda());
        let quantisation = &Quantisation { steps: &steps, lambda };
        let prices = self.prices.as_mut().map(|prices| &mut prices[number]);
        let all_zero = attribute::encode_with_prices(coder, plan, quantisation, rows, prices);
        let all_zero = all_zero.map_err(coding("attribute"))?;
        prediction.add(self.skeleton, below, rows);
        Ok(all_zero)
    }

    /// The bits of a group, if they are counted, and whether all levels are zero.
    fn count(&mut self, number: usize) -> Result<(u64, bool)> {
        if !self.how.fit {
            return Ok((0, self.code(number, &mut Silent)?));
        }
        let mut tally = Tally::default();
        let all_zero = self.code(number, &mut tally)?;
        Ok((tally.bits(), all_zero))
    }

    /// The bytes of the layer of an SH degree, if they are counted.
    fn degree_bytes(&mut self, number: usize) -> Result<u64> {
        let (bits, all_zero) = self.count(number)?;
        if !self.how.fit || self.is_empty(number, all_zero) {
            return Ok(0);
        }
        let mut prediction = Vec::new();
        self.groups[number].write_prediction(&self.predictions[number], &mut prediction);
        Ok(prediction.len() as u64 + CODER_BYTES + bits.div_ceil(8))
    }

    /// Whether an SH degree needs no layer: it is zero.
    fn is_empty(&self, number: usize, all_zero: bool) -> bool {
        all_zero && self.predictions[number] == Prediction::None
    }

    /// The layer of an SH degree.
    fn degree_layer(&mut self, number: usize) -> Result<Vec<u8>> {
        let mut coder = RansEncoder::default();
        let all_zero = self.code(number, &mut coder)?;
        let mut out = Vec::new();
        if !self.is_empty(number, all_zero) {
            self.groups[number].write_prediction(&self.predictions[number], &mut out);
            out.extend(coder.finish());
        }
        Ok(out)
    }

    /// The base layer. `coder` holds geometry and importance classes already, `importance` is their prediction.
    fn base_layer(&mut self, importance: u8, mut coder: RansEncoder) -> Result<Vec<u8>> {
        let mut out = vec![importance];
        for (number, group) in self.groups.iter().enumerate() {
            self.code(number, &mut coder)?;
            group.write_prediction(&self.predictions[number], &mut out);
        }
        out.extend(coder.finish());
        Ok(out)
    }
}
