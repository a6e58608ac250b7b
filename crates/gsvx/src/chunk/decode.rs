//! From the layers of a chunk to Gaussians.

use super::{CLASS_STEP, GaussiansMut, SideFactors, steps_of};
use crate::attributes::prediction::Predictor;
#[cfg(feature = "encode")]
use crate::attributes::side::Factors;
use crate::attributes::{colour, opacity};
use crate::bytes::Reader;
use crate::covariance;
use crate::error::{Error, Result, coding};
use crate::head::Header;
use crate::importance;
use gpcc_lite::coder::Decoder;
use gpcc_lite::geometry;
use gpcc_lite::raht::{Plan, Rows};
use gpcc_lite::{Leaf, attribute};

/// Covariances taken apart at a time.
const RUN: usize = 64;

/// The decoded values of one chunk. Its memory serves one chunk after another.
#[derive(Debug, Default)]
pub(crate) struct ChunkDecoder {
    plan: Option<Plan>,
    /// Importance class of each leaf.
    classes: Vec<u8>,
    side: SideFactors,
    opacity: Rows,
    /// Log-Euclidean coordinates.
    shape: Rows,
    /// By SH degree.
    sh: [Rows; 4],
    /// SH degrees decoded.
    sh_degree: u8,
}

/// What [`super::ChunkLatents`] fills in instead of a stream.
#[cfg(feature = "encode")]
pub(super) struct Parts<'a> {
    pub(super) plan: &'a Plan,
    pub(super) classes: &'a [u8],
    pub(super) side: &'a mut SideFactors,
    pub(super) opacity: &'a mut Rows,
    pub(super) shape: &'a mut Rows,
    pub(super) sh: &'a mut [Rows; 4],
    pub(super) sh_degree: &'a mut u8,
}

#[cfg(feature = "encode")]
impl ChunkDecoder {
    /// A chunk whose values are still to be filled in.
    pub(super) fn with_plan(plan: Plan, classes: Vec<u8>, side: SideFactors) -> Self {
        Self { plan: Some(plan), classes, side, ..Self::default() }
    }

    /// Everything that is decoded, to be filled in.
    ///
    /// # Errors
    /// If there is no plan.
    pub(super) fn parts(&mut self) -> Result<Parts<'_>> {
        let Self { plan, classes, side, opacity, shape, sh, sh_degree, .. } = self;
        let Some(plan) = plan else {
            return Err(Error::Corrupt { what: "chunk without leaves", value: 0 });
        };
        Ok(Parts { plan, classes, side, opacity, shape, sh, sh_degree })
    }
}

impl ChunkDecoder {
    /// Decodes the first layer of a chunk that has so many leaves.
    ///
    /// # Errors
    /// [`Error::Truncated`], [`Error::Corrupt`] and [`Error::Coding`].
    pub(crate) fn base(&mut self, header: &Header, count: u64, bytes: &[u8]) -> Result<()> {
        let mut r = Reader::new(bytes, "base layer");
        self.side = SideFactors::from_bytes(r.take(SideFactors::LEN)?);
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        let error = coding("base layer");
        let mut coder = Decoder::new(r.take(r.remaining())?).map_err(error)?;
        let leaves = geometry::decode_leaves(&mut coder, count, header.j_high)
            .map_err(coding("geometry"))?;
        let mut plan = Plan::of(leaves, header.j_high).map_err(coding("geometry"))?;
        self.decode_classes(&mut coder, &plan)?;
        let weights: Vec<u32> = self.classes.iter().map(|&c| importance::weight(c)).collect();
        plan = plan.weighted(&weights).map_err(error)?;
        let steps = &header.steps;
        let mut decode = |step: f32, channels: usize, rows: &mut Rows| {
            rows.resize(count, channels);
            attribute::decode(&mut coder, &plan, &steps_of(step, channels), rows).map_err(error)
        };
        decode(steps.opacity, 1, &mut self.opacity)?;
        decode(steps.dc, 3, &mut self.sh[0])?;
        decode(steps.covariance, 6, &mut self.shape)?;
        coder.finish().map_err(error)?;
        self.plan = Some(plan);
        self.sh_degree = 0;
        Ok(())
    }

    /// Importance classes, through the transform without weights.
    fn decode_classes(&mut self, coder: &mut Decoder<'_>, plan: &Plan) -> Result<()> {
        let rows = &mut self.opacity;
        rows.resize(plan.len(), 1);
        attribute::decode(coder, plan, &[CLASS_STEP], rows).map_err(coding("importance"))?;
        let factors = self.side.importance;
        let class = |(i, &leaf): (usize, &Leaf)| {
            importance::class_of(rows.row(i)[0] + factors.predict(leaf, 0))
        };
        self.classes = plan.leaves().iter().enumerate().map(class).collect();
        Ok(())
    }

    /// Decodes the layer of the next SH degree.
    ///
    /// # Errors
    /// As [`ChunkDecoder::base`].
    pub(crate) fn next_degree(&mut self, header: &Header, bytes: &[u8]) -> Result<()> {
        let Some(plan) = &self.plan else { return Ok(()) };
        let degree = usize::from(self.sh_degree) + 1;
        let (below, rest) = self.sh.split_at_mut(degree);
        let (below, rows) = (&below[degree - 1], &mut rest[0]);
        let channels = 3 * (2 * degree + 1);
        rows.resize(plan.len(), channels);
        if bytes.is_empty() {
            (0..plan.len()).for_each(|i| rows.row_mut(i).fill(0.0));
        } else {
            let (predictor, bytes) = if degree >= 2 {
                Predictor::split(degree as u8, plan.len(), bytes)?
            } else {
                (None, bytes)
            };
            let error = coding("SH coefficients");
            let mut coder = Decoder::new(bytes).map_err(error)?;
            let steps = steps_of(header.steps.sh[degree - 1], channels);
            attribute::decode(&mut coder, plan, &steps, rows).map_err(error)?;
            coder.finish().map_err(error)?;
            if let Some(predictor) = predictor {
                (0..plan.len()).for_each(|i| predictor.add(i, below.row(i), rows.row_mut(i)));
            }
        }
        self.sh_degree = degree as u8;
        Ok(())
    }

    #[cfg(feature = "encode")]
    pub(super) fn plan(&self) -> Option<&Plan> {
        self.plan.as_ref()
    }

    /// What predicts opacity and size.
    #[cfg(feature = "encode")]
    pub(super) fn side_factors(&self) -> (Factors, Factors) {
        (self.side.opacity, self.side.size)
    }

    /// The leaves.
    pub(crate) fn leaves(&self) -> &[Leaf] {
        self.plan.as_ref().map_or(&[], Plan::leaves)
    }

    /// Importance classes, one per leaf.
    pub(crate) fn classes(&self) -> &[u8] {
        &self.classes
    }

    /// Puts the Gaussians of the leaves from `first` on into `out`. SH degrees that were not decoded
    /// become 0.
    ///
    /// # Errors
    /// [`Error::Corrupt`] if a mean is beyond what an f32 holds: an encoder refuses such scenes.
    pub(crate) fn fill(
        &self,
        header: &Header,
        first: usize,
        out: &mut GaussiansMut<'_>,
    ) -> Result<()> {
        let range = first..first + out.len();
        let leaves = &self.leaves()[range.clone()];
        for (mean, &leaf) in out.means.iter_mut().zip(leaves) {
            *mean = header.cube.leaf_centre(leaf, header.j_high);
            if !mean.iter().all(|v| v.is_finite()) {
                return Err(Error::Corrupt { what: "mean beyond f32", value: leaf.morton });
            }
        }
        for ((i, logit), &leaf) in range.clone().zip(&mut *out.opacity_logits).zip(leaves) {
            let predicted = self.side.opacity.predict(leaf, self.classes[i]);
            *logit = opacity::logit_of_log_alpha(self.opacity.row(i)[0] + predicted);
        }
        self.fill_shapes(first, leaves, out);
        self.fill_sh(first, out);
        Ok(())
    }

    fn fill_shapes(&self, first: usize, leaves: &[Leaf], out: &mut GaussiansMut<'_>) {
        let mut coordinates = [[0.0; 6]; RUN];
        let runs = out.rotations.chunks_mut(RUN).zip(out.log_scales.chunks_mut(RUN));
        for (run, (rotations, log_scales)) in runs.enumerate() {
            let coordinates = &mut coordinates[..rotations.len()];
            for (k, c) in coordinates.iter_mut().enumerate() {
                let at = run * RUN + k;
                c.copy_from_slice(self.shape.row(first + at));
                c[0] += self.side.size.predict(leaves[at], self.classes[first + at]);
            }
            covariance::decompose_into(coordinates, rotations, log_scales);
        }
    }

    fn fill_sh(&self, first: usize, out: &mut GaussiansMut<'_>) {
        let sh_len = out.sh.len() / out.len().max(1);
        for (i, sh) in (first..).zip(out.sh.chunks_exact_mut(sh_len.max(1))) {
            let mut rest = sh;
            for rows in &self.sh[..=usize::from(self.sh_degree)] {
                let (ycc, _) = rows.row(i).as_chunks::<3>();
                if ycc.len() > rest.len() {
                    break;
                }
                let (here, after) = rest.split_at_mut(ycc.len());
                for (rgb, ycc) in here.iter_mut().zip(ycc) {
                    *rgb = colour::inverse(*ycc);
                }
                rest = after;
            }
            rest.fill([0.0; 3]);
        }
    }
}
