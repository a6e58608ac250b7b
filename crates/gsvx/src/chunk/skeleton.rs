//! [`Skeleton`]: leaves, importance classes and weights of a chunk.

use super::CLASS_STEP;
use crate::attributes::side::Factors;
use crate::error::{Result, coding};
use crate::head::Header;
use crate::importance;
use gpcc_lite::coder::RansDecoder;
use gpcc_lite::geometry::decode_leaves;
use gpcc_lite::raht::{RahtPlan, Rows};
use gpcc_lite::{Leaf, attribute};

/// What all groups of a chunk share.
#[derive(Debug, Default)]
pub(crate) struct Skeleton {
    /// The leaves and their weighted transform.
    pub(crate) plan: RahtPlan,
    /// Importance class of each leaf.
    pub(crate) classes: Vec<u8>,
}

impl Skeleton {
    /// Classes from decoded values and the factors that predict them, and the classes as weights.
    pub(super) fn new(plan: RahtPlan, factors: Factors, rows: &Rows) -> Result<Self> {
        let class = |(i, &leaf): (usize, &Leaf)| {
            importance::class_of(rows.row(i)[0] + factors.predict(leaf, 0))
        };
        let classes: Vec<u8> = plan.leaves().iter().enumerate().map(class).collect();
        let weights: Vec<u32> = classes.iter().map(|&c| importance::weight(c)).collect();
        let plan = plan.weighted(&weights).map_err(coding("base layer"))?;
        Ok(Self { plan, classes })
    }

    /// Decodes the front of a base layer: geometry and importance classes, with the factors that predict them. `rows`
    /// are scratch space.
    pub(super) fn decode(
        coder: &mut RansDecoder<'_>,
        header: &Header,
        leaves: usize,
        importance: Factors,
        rows: &mut Rows,
    ) -> Result<Self> {
        let octree =
            decode_leaves(coder, leaves, header.cube, header.j_high).map_err(coding("geometry"))?;
        let plan = RahtPlan::new(octree);
        rows.resize(plan.len(), 1);
        attribute::decode(coder, &plan, &[CLASS_STEP], rows).map_err(coding("importance"))?;
        Self::new(plan, importance, rows)
    }

    /// Changes the first channel of each leaf by what depth and class predict.
    pub(super) fn each(&self, factors: Factors, rows: &mut Rows, op: impl Fn(f32, f32) -> f32) {
        for (i, (&leaf, &class)) in self.plan.leaves().iter().zip(&self.classes).enumerate() {
            let value = &mut rows.row_mut(i)[0];
            *value = op(*value, factors.predict(leaf, class));
        }
    }
}
