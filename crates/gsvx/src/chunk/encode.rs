//! From the Gaussians of a chunk to its layers.

use super::{CLASS_STEP, SideFactors, steps_of};
use crate::attributes::prediction::Predictor;
use crate::attributes::side::Factors;
use crate::attributes::{colour, opacity};
use crate::covariance;
use crate::error::{Error, Result, coding};
use crate::head::Steps;
use crate::importance;
use gpcc_lite::attribute::Options;
use gpcc_lite::coder::Encoder;
use gpcc_lite::geometry;
use gpcc_lite::raht::{Plan, Rows};
use gpcc_lite::{Leaf, attribute};
use gs_model::Scene;
use std::ops::Range;

/// Lagrangian multipliers of the quantisers, in `step^2` per bit. What rate-distortion optimisation sets to
/// zero is missing from every pixel that the Gaussian is in, so they are below those of least squared
/// error; a higher one for SH coefficients saves fewer bytes than it costs at equal rendered error.
const LAMBDA: f32 = 18.0 / 256.0;
const LAMBDA_SH: f32 = 8.0 / 256.0;
const LAMBDA_COVARIANCE: f32 = 24.0 / 256.0;

/// What holds for all chunks of a stream.
pub(crate) struct Quantisation {
    pub(crate) steps: Steps,
    pub(crate) j_high: u8,
    pub(crate) sh_degree: u8,
    /// Round to the nearest level, whatever that costs in bits.
    pub(crate) to_nearest: bool,
}

/// What a chunk is encoded from.
pub(crate) struct ChunkInput<'a> {
    pub(crate) leaves: Vec<Leaf>,
    /// Real-valued importance class of each leaf.
    pub(crate) log_classes: &'a [f32],
    /// One Gaussian per leaf, of SH degree 0.
    pub(crate) base: Scene,
}

/// Leaves whose SH coefficients are in memory as input at a time.
const PIECE: usize = 1 << 11;

/// Encodes a chunk: its base layer, then one layer for each SH degree. `sh` gives the coefficients of a
/// degree for a range of leaves: `2 degree + 1` per leaf.
pub(crate) fn encode(
    q: &Quantisation,
    input: ChunkInput<'_>,
    sh: impl Fn(u8, Range<usize>) -> Result<Vec<[f32; 3]>> + Send,
) -> Result<Vec<Vec<u8>>> {
    let ChunkInput { leaves, log_classes, base } = input;
    let plan = Plan::of(leaves, q.j_high).map_err(coding("geometry"))?;
    let mut coder = Encoder::default();
    geometry::encode_leaves(&mut coder, plan.leaves(), q.j_high).map_err(coding("geometry"))?;
    let (importance, classes) = encode_classes(&mut coder, &plan, log_classes)?;
    let weights: Vec<u32> = classes.iter().map(|&c| importance::weight(c)).collect();
    let plan = plan.weighted(&weights).map_err(coding("base layer"))?;
    let chunk = Chunk { q, plan: &plan, classes: &classes };
    let side = SideFactors { importance, ..SideFactors::default() };
    let (base_layer, sh_layers) =
        rayon::join(|| chunk.base_layer(coder, side, base), || chunk.sh_layers(sh));
    let mut layers = vec![base_layer?];
    layers.extend(sh_layers?);
    Ok(layers)
}

/// Codes importance classes through the transform without weights, and returns those that a decoder will
/// have.
pub(super) fn encode_classes(
    coder: &mut Encoder,
    plan: &Plan,
    log_classes: &[f32],
) -> Result<(Factors, Vec<u8>)> {
    let leaves = plan.leaves();
    let even = vec![0; leaves.len()];
    let factors = Factors::fit(leaves, &even, |i| log_classes[i]);
    let factors = Factors { class: 0, ..factors };
    let mut rows = Rows::new(plan.len(), 1);
    for (i, &leaf) in leaves.iter().enumerate() {
        rows.row_mut(i)[0] = log_classes[i] - factors.predict(leaf, 0);
    }
    attribute::encode(coder, plan, &[CLASS_STEP], &Options { lambda: LAMBDA }, &mut rows)
        .map_err(coding("importance"))?;
    let class = |(i, &leaf): (usize, &Leaf)| {
        importance::class_of(rows.row(i)[0] + factors.predict(leaf, 0))
    };
    Ok((factors, leaves.iter().enumerate().map(class).collect()))
}

/// Subtracts what depth and class predict from the first channel.
pub(super) fn subtract_predicted(
    factors: Factors,
    leaves: &[Leaf],
    classes: &[u8],
    rows: &mut Rows,
) {
    for (i, &leaf) in leaves.iter().enumerate() {
        rows.row_mut(i)[0] -= factors.predict(leaf, classes[i]);
    }
}

/// Writes Y, Co, Cg of the coefficients of some leaves into their rows, from row `first` on.
fn set_colours(rows: &mut Rows, first: usize, sh: &[[f32; 3]]) {
    let each = rows.channels() / 3;
    for (i, sh) in sh.chunks_exact(each).enumerate() {
        for (out, &rgb) in rows.row_mut(first + i).as_chunks_mut::<3>().0.iter_mut().zip(sh) {
            *out = colour::forward(rgb);
        }
    }
}

struct Chunk<'a> {
    q: &'a Quantisation,
    plan: &'a Plan,
    classes: &'a [u8],
}

impl Chunk<'_> {
    /// Codes rows of values with one step for all channels; says whether all levels are zero.
    fn code(&self, coder: &mut Encoder, step: f32, lambda: f32, rows: &mut Rows) -> Result<bool> {
        let steps = steps_of(step, rows.channels());
        let lambda = if self.q.to_nearest { 0.0 } else { lambda };
        attribute::encode(coder, self.plan, &steps, &Options { lambda }, rows)
            .map_err(coding("attribute"))
    }

    /// The first layer. `coder` holds geometry and importance already.
    fn base_layer(
        &self,
        mut coder: Encoder,
        mut side: SideFactors,
        base: Scene,
    ) -> Result<Vec<u8>> {
        let Self { q, plan, .. } = self;
        let Scene { opacity_logits, sh, rotations, log_scales, .. } = base;
        let log_alpha = |i: usize| opacity::log_alpha_of_logit(opacity_logits[i]) as f32;
        let (mut rows, factors) = self.less_predicted(1, |i, row| row[0] = log_alpha(i));
        side.opacity = factors;
        drop(opacity_logits);
        self.code(&mut coder, q.steps.opacity, LAMBDA, &mut rows)?;
        drop(rows);
        let mut rows = Rows::new(plan.len(), 3);
        set_colours(&mut rows, 0, &sh);
        drop(sh);
        self.code(&mut coder, q.steps.dc, LAMBDA, &mut rows)?;
        drop(rows);
        let (mut rows, factors) = self.less_predicted(6, |i, row| {
            row.copy_from_slice(&covariance::coordinates(rotations[i], log_scales[i]));
        });
        side.size = factors;
        drop((rotations, log_scales));
        self.code(&mut coder, q.steps.covariance, LAMBDA_COVARIANCE, &mut rows)?;
        let mut out = side.to_bytes().to_vec();
        out.extend(coder.finish());
        Ok(out)
    }

    /// Rows of values; the prediction from depth and class is subtracted from the first channel.
    fn less_predicted(
        &self,
        channels: usize,
        value: impl Fn(usize, &mut [f32]),
    ) -> (Rows, Factors) {
        let (leaves, classes) = (self.plan.leaves(), self.classes);
        let mut rows = Rows::new(leaves.len(), channels);
        (0..leaves.len()).for_each(|i| value(i, rows.row_mut(i)));
        let factors = Factors::fit(leaves, classes, |i| rows.row(i)[0]);
        subtract_predicted(factors, leaves, classes, &mut rows);
        (rows, factors)
    }

    /// The layers of all SH degrees. Each is predicted from what a decoder will have of the degree below,
    /// where that pays.
    fn sh_layers(
        &self,
        sh: impl Fn(u8, Range<usize>) -> Result<Vec<[f32; 3]>>,
    ) -> Result<Vec<Vec<u8>>> {
        let mut layers = Vec::new();
        let mut below: Option<Rows> = None;
        let leaves = self.plan.len();
        for degree in 1..=self.q.sh_degree {
            let mut rows = Rows::new(leaves, 3 * usize::from(2 * degree + 1));
            for first in (0..leaves).step_by(PIECE) {
                let piece = sh(degree, first..leaves.min(first + PIECE))?;
                set_colours(&mut rows, first, &piece);
            }
            let (layer, rows) = self.sh_layer(degree, rows, below)?;
            layers.push(layer);
            below = Some(rows);
        }
        Ok(layers)
    }

    /// The layer of one SH degree, and its values as a decoder will have them.
    fn sh_layer(&self, degree: u8, mut rows: Rows, below: Option<Rows>) -> Result<(Vec<u8>, Rows)> {
        let step = self.q.steps.sh[usize::from(degree) - 1];
        let mut out = Vec::new();
        let mut predictor = None;
        if let (2.., Some(below)) = (degree, &below) {
            let exact = |i: usize, row: &mut [f32]| row.copy_from_slice(rows.row(i));
            predictor = Predictor::fit(degree, below, self.classes, [step; 2], exact);
            Predictor::write(predictor.as_ref(), &mut out);
            if let Some(predictor) = &predictor {
                for i in 0..rows.leaves() {
                    predictor.subtract(i, below.row(i), rows.row_mut(i));
                }
            }
        }
        let mut coder = Encoder::default();
        let all_zero = self.code(&mut coder, step, LAMBDA_SH, &mut rows)?;
        if let (Some(predictor), Some(below)) = (&predictor, &below) {
            for i in 0..rows.leaves() {
                predictor.add(i, below.row(i), rows.row_mut(i));
            }
        } else if all_zero {
            return Ok((Vec::new(), rows));
        }
        out.extend(coder.finish());
        Ok((out, rows))
    }
}

/// Greatest magnitude of a log-scale or an SH coefficient, far beyond any trained attribute.
pub(crate) const LARGEST: f32 = 18_900.0;

/// Checks that Gaussians are what lossy coding can hold; `first` is the number of the first, for the error.
pub(crate) fn check(scene: &Scene, first: usize) -> Result<()> {
    let each = |field: &'static str, bad: &dyn Fn(usize) -> bool| match (0..scene.len())
        .find(|&i| bad(i))
    {
        Some(i) => Err(Error::NonFinite { index: first + i, field }),
        None => Ok(()),
    };
    each("mean", &|i| !scene.means[i].iter().all(|v| v.is_finite()))?;
    each("opacity", &|i| !scene.opacity_logits[i].is_finite())?;
    each("rotation", &|i| {
        let q = scene.rotations[i];
        !q.iter().all(|v| v.is_finite()) || q == [0.0; 4]
    })?;
    each("log-scale", &|i| !scene.log_scales[i].iter().all(|v| v.is_finite()))?;
    let fits = |field, values: &dyn Fn(usize) -> Vec<f32>| {
        for i in 0..scene.len() {
            if let Some(&value) = values(i).iter().find(|v| v.abs() > LARGEST) {
                return Err(Error::TooLarge { index: first + i, field, value, limit: LARGEST });
            }
        }
        Ok(())
    };
    fits("log-scale", &|i| scene.log_scales[i].to_vec())?;
    check_sh(&scene.sh, scene.sh_len(), first)
}

/// Checks that SH coefficients, `each` per Gaussian, are what lossy coding can hold.
pub(crate) fn check_sh(sh: &[[f32; 3]], each: usize, first: usize) -> Result<()> {
    let field = "SH coefficient";
    for (i, sh) in sh.chunks_exact(each).enumerate() {
        let index = first + i;
        for &value in sh.as_flattened() {
            if !value.is_finite() {
                return Err(Error::NonFinite { index, field });
            }
            if value.abs() > LARGEST {
                return Err(Error::TooLarge { index, field, value, limit: LARGEST });
            }
        }
    }
    Ok(())
}
