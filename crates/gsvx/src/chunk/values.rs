//! The decoded values of one chunk: from its layers, and to Gaussians.

use gs_model::SceneMut;

use super::groups::{BASE, GROUPS, coded, coefficients};
use super::skeleton::Skeleton;
use super::steps_of;
use crate::attributes::side::Factors;
use crate::bytes::SliceReader;
use crate::error::{Error, Result, coding};
use crate::head::Header;
use gpcc_lite::coder::RansDecoder;
use gpcc_lite::raht::Rows;
use gpcc_lite::{Cube, Octree, attribute};

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
    /// Decodes layer `number` of a chunk that has so many leaves, after the layers before it: the base layer, or an SH
    /// degree. An SH degree that cannot be decoded leaves the layers before it as they were; a base layer leaves nothing
    /// of use.
    ///
    /// # Errors
    /// [`Error::Truncated`], [`Error::Corrupt`] and [`Error::Coding`]. [`Error::Corrupt`] if a mean is beyond what an
    /// f32 holds: an encoder refuses such scenes.
    pub(crate) fn layer(
        &mut self,
        number: u8,
        header: &Header,
        leaves: usize,
        bytes: &[u8],
    ) -> Result<()> {
        let numbers =
            if number == 0 { 0..BASE } else { coded(number).len() - 1..coded(number).len() };
        if number > 0 && bytes.is_empty() {
            let (group, rows) = (&GROUPS[numbers.start], &mut self.rows[numbers.start]);
            rows.resize(leaves, group.channels);
            (0..leaves).for_each(|i| rows.row_mut(i).fill(0.0));
            self.sh_degree = number;
            return Ok(());
        }
        let mut r =
            SliceReader::new(bytes, if number == 0 { "base layer" } else { "SH prediction" });
        let importance = if number == 0 { Some(r.u8()? as i8) } else { None };
        let groups = GROUPS[numbers.clone()].iter();
        let predictions = groups.map(|group| group.read_prediction(leaves, &mut r));
        let predictions = predictions.collect::<Result<Vec<_>>>()?;
        let mut coder = RansDecoder::new(r.take(r.remaining())?).map_err(coding("attribute"))?;
        if let Some(depth) = importance {
            let importance = Factors { depth, class: 0 };
            self.skeleton =
                Skeleton::decode(&mut coder, header, leaves, importance, &mut self.rows[0])?;
            check_means(self.octree())?;
        }
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
        coder.finish().map_err(coding("attribute"))?;
        // The degree counts as decoded only now, when all of its values are whole.
        self.sh_degree = number;
        Ok(())
    }

    /// The leaves.
    pub(crate) fn octree(&self) -> &Octree {
        self.skeleton.plan.octree()
    }

    /// Importance classes, one per leaf.
    pub(crate) fn classes(&self) -> &[u8] {
        &self.skeleton.classes
    }

    /// The number of groups that are decoded.
    pub(crate) fn groups(&self) -> usize {
        coded(self.sh_degree).len()
    }

    /// The values of a leaf in a group.
    pub(crate) fn row(&self, group: usize, leaf: usize) -> &[f32] {
        self.rows[group].row(leaf)
    }

    /// Puts the Gaussians of the leaves from `first` on into `out`. SH degrees that were not decoded
    /// become 0.
    pub(crate) fn fill(&self, first: usize, out: &mut SceneMut<'_>) {
        let octree = self.octree();
        for (i, mean) in (first..).zip(&mut *out.means) {
            *mean = octree.centre(i);
        }
        for (group, rows) in coded(self.sh_degree).iter().zip(&self.rows) {
            group.restore(rows, first, out);
        }
        let sh_len = out.sh.len() / out.len().max(1);
        let known = coefficients(self.sh_degree).end;
        if known < sh_len {
            out.sh.chunks_exact_mut(sh_len).for_each(|sh| sh[known..].fill([0.0; 3]));
        }
    }
}

/// Refuses leaves whose centres are beyond what an f32 holds.
fn check_means(octree: &Octree) -> Result<()> {
    let Cube { origin, side } = octree.cube();
    let fits = |v: f64| (v as f32).is_finite();
    if origin.iter().all(|&v| fits(v) && fits(v + side)) {
        return Ok(());
    }
    let bad = (0..octree.len()).find(|&i| !octree.centre(i).iter().all(|v| v.is_finite()));
    match bad {
        Some(i) => {
            Err(Error::Corrupt { what: "mean beyond f32", value: octree.leaves()[i].morton })
        }
        None => Ok(()),
    }
}
