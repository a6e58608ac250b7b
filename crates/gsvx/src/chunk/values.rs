//! The decoded values of one chunk: from its layers, and to Gaussians.

use super::groups::{BASE, GROUPS, Prediction, coded, coefficients};
use super::skeleton::{Skeleton, classes};
use super::{CLASS_STEP, GaussiansMut, steps_of};
use crate::attributes::side::Factors;
use crate::bytes::Reader;
use crate::error::{Error, Result, coding};
use crate::head::Header;
use gpcc_lite::coder::Decoder;
use gpcc_lite::geometry;
use gpcc_lite::raht::{Plan, Rows};
use gpcc_lite::{Octree, attribute};
use std::ops::Range;

/// The decoded values of one chunk. Its memory serves one chunk after another.
#[derive(Debug, Default)]
pub(crate) struct ChunkValues {
    pub(super) skeleton: Skeleton,
    /// By group of [`GROUPS`].
    pub(super) rows: [Rows; GROUPS.len()],
    /// SH degrees that are decoded.
    pub(super) sh_degree: u8,
}

impl ChunkValues {
    /// Decodes the first layer of a chunk that has so many leaves.
    ///
    /// # Errors
    /// [`Error::Truncated`], [`Error::Corrupt`] and [`Error::Coding`].
    pub(crate) fn base(&mut self, header: &Header, count: u64, bytes: &[u8]) -> Result<()> {
        let mut r = Reader::new(bytes, "base layer");
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        let importance = Factors { depth: r.u8()? as i8, class: 0 };
        let predictions = predictions(0..BASE, count, &mut r)?;
        let mut coder = Decoder::new(r.take(r.remaining())?).map_err(coding("base layer"))?;
        let octree = geometry::decode_leaves(&mut coder, count, header.cube, header.j_high)
            .map_err(coding("geometry"))?;
        let plan = Plan::new(octree);
        let rows = &mut self.rows[0];
        rows.resize(plan.len(), 1);
        attribute::decode(&mut coder, &plan, &[CLASS_STEP], rows).map_err(coding("importance"))?;
        let classes = classes(importance, plan.leaves(), rows);
        self.skeleton = Skeleton::new(plan, classes)?;
        self.sh_degree = 0;
        self.groups(0..BASE, header, &predictions, coder)
    }

    /// Decodes the layer of the next SH degree.
    ///
    /// # Errors
    /// As [`ChunkValues::base`].
    pub(crate) fn next_degree(&mut self, header: &Header, bytes: &[u8]) -> Result<()> {
        self.sh_degree += 1;
        let group = BASE - 1 + usize::from(self.sh_degree);
        let leaves = self.skeleton.plan.len();
        if bytes.is_empty() {
            let rows = &mut self.rows[group];
            rows.resize(leaves, GROUPS[group].channels);
            (0..leaves).for_each(|i| rows.row_mut(i).fill(0.0));
            return Ok(());
        }
        let mut r = Reader::new(bytes, "SH prediction");
        let predictions = predictions(group..group + 1, leaves, &mut r)?;
        let coder = Decoder::new(r.take(r.remaining())?).map_err(coding("SH coefficients"))?;
        self.groups(group..group + 1, header, &predictions, coder)
    }

    /// Decodes the groups of a layer.
    fn groups(
        &mut self,
        numbers: Range<usize>,
        header: &Header,
        predictions: &[Prediction],
        mut coder: Decoder<'_>,
    ) -> Result<()> {
        let Self { skeleton, rows, .. } = self;
        for (number, prediction) in numbers.zip(predictions) {
            let group = &GROUPS[number];
            let (below, rest) = rows.split_at_mut(number);
            let rows = &mut rest[0];
            rows.resize(skeleton.plan.len(), group.channels);
            let steps = steps_of(group.step(&header.steps), group.channels);
            attribute::decode(&mut coder, &skeleton.plan, &steps, rows)
                .map_err(coding("attribute"))?;
            prediction.add(skeleton, below.last(), rows);
        }
        coder.finish().map_err(coding("attribute"))
    }

    /// The leaves.
    pub(crate) fn octree(&self) -> &Octree {
        self.skeleton.plan.octree()
    }

    /// Importance classes, one per leaf.
    pub(crate) fn classes(&self) -> &[u8] {
        &self.skeleton.classes
    }

    /// Puts the Gaussians of the leaves from `first` on into `out`. SH degrees that were not decoded
    /// become 0.
    ///
    /// # Errors
    /// [`Error::Corrupt`] if a mean is beyond what an f32 holds: an encoder refuses such scenes.
    pub(crate) fn fill(&self, first: usize, out: &mut GaussiansMut<'_>) -> Result<()> {
        let octree = self.octree();
        for (i, mean) in (first..).zip(&mut *out.means) {
            *mean = octree.centre(i);
            if !mean.iter().all(|v| v.is_finite()) {
                let value = octree.leaves()[i].morton;
                return Err(Error::Corrupt { what: "mean beyond f32", value });
            }
        }
        for (group, rows) in coded(self.sh_degree).iter().zip(&self.rows) {
            group.restore(rows, first, out);
        }
        let sh_len = out.sh.len() / out.len().max(1);
        let known = coefficients(self.sh_degree).end;
        if known < sh_len {
            out.sh.chunks_exact_mut(sh_len).for_each(|sh| sh[known..].fill([0.0; 3]));
        }
        Ok(())
    }
}

fn predictions(groups: Range<usize>, leaves: usize, r: &mut Reader<'_>) -> Result<Vec<Prediction>> {
    GROUPS[groups].iter().map(|group| group.read_prediction(leaves, r)).collect()
}
