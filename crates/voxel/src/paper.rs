//! The paper's adaptive criteria, per voxel (section 3.2.2).

use gpcc_lite::Leaf;
use gs_model::Scene;
use rayon::prelude::*;

use crate::cube::Cube;
use crate::descend;
use crate::gaussian::log_volume;
use crate::order::MortonOrder;

/// Flags the Gaussians whose volume reaches the `100 - percent` percentile.
///
/// Ties at the threshold are all large. 0 % flags none, 100 % all.
pub(crate) fn large(scene: &Scene, percent: f64) -> Vec<bool> {
    let len = scene.len();
    let count = (len as f64 * percent / 100.0).round() as usize;
    if count == 0 {
        return vec![false; len];
    }
    let volumes: Vec<f64> = scene.log_scales.par_iter().map(|&l| log_volume(l)).collect();
    let mut sorted = volumes.clone();
    let (_, threshold, _) = sorted.select_nth_unstable_by(len - count, f64::total_cmp);
    let threshold = *threshold;
    volumes.par_iter().map(|v| v.total_cmp(&threshold).is_ge()).collect()
}

/// The criteria and what they look at.
pub(crate) struct Rule<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) cube: &'a Cube,
    pub(crate) large: &'a [bool],
    pub(crate) j_low: u8,
    pub(crate) j_high: u8,
    pub(crate) tau1: u32,
    pub(crate) tau2: f64,
}

impl Rule<'_> {
    /// Depth of the leaf of every Gaussian of `order`.
    pub(crate) fn depths(&self, order: &MortonOrder) -> Vec<u8> {
        descend::depths(order, self.j_low, self.j_high, |code, members, depth| {
            self.splits(code, members, depth)
        })
    }

    fn splits(&self, code: u64, members: &[u32], depth: u8) -> bool {
        if members.len() as u64 > u64::from(self.tau1) {
            return true;
        }
        let shift = 3 * u32::from(self.j_high - depth);
        let leaf = Leaf { morton: code >> shift << shift, depth };
        let centre = self.cube.centre_offset(leaf, self.j_high);
        let limit = self.tau2 * self.cube.cell(depth);
        members.iter().any(|&i| {
            let i = i as usize;
            let offset = self.cube.offset(self.scene.means[i]);
            let square: f64 = (0..3).map(|k| offset[k] - centre[k]).map(|d| d * d).sum();
            self.large[i] || square > limit * limit
        })
    }
}
