//! The paper's adaptive criteria, per voxel (section 3.2.2).

use gpcc_lite::Leaf;
use gs_model::Scene;
use rayon::prelude::*;

use crate::cube::Cube;
use crate::gaussian::log_volume;
use crate::order::{MortonOrder, cell_end};

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
        let mut depths = vec![self.j_high; order.codes.len()];
        // Voxels at j_low are independent of each other.
        let mut tasks = Vec::new();
        let (mut start, mut rest) = (0, depths.as_mut_slice());
        while start < order.codes.len() {
            let end = cell_end(&order.codes, start, self.j_high, self.j_low);
            let (head, tail) = rest.split_at_mut(end - start);
            tasks.push((start, head));
            (start, rest) = (end, tail);
        }
        tasks.par_iter_mut().with_min_len(64).for_each(|(start, depths)| {
            let range = *start..*start + depths.len();
            self.divide(&order.codes[range.clone()], &order.members[range], self.j_low, depths);
        });
        depths
    }

    /// Decides one voxel, which holds all of `codes`, and what lies below it.
    fn divide(&self, codes: &[u64], members: &[u32], depth: u8, depths: &mut [u8]) {
        if depth == self.j_high || !self.splits(codes[0], members, depth) {
            depths.fill(depth);
            return;
        }
        let mut start = 0;
        while start < codes.len() {
            let end = cell_end(codes, start, self.j_high, depth + 1);
            let child = start..end;
            self.divide(
                &codes[child.clone()],
                &members[child.clone()],
                depth + 1,
                &mut depths[child],
            );
            start = end;
        }
    }

    fn splits(&self, code: u64, members: &[u32], depth: u8) -> bool {
        if members.len() as u64 > u64::from(self.tau1) {
            return true;
        }
        let shift = 3 * u32::from(self.j_high - depth);
        let leaf = Leaf { morton: code >> shift << shift, depth };
        let centre = self.cube.leaf_centre_f64(leaf, self.j_high);
        let limit = self.tau2 * self.cube.cell(depth);
        members.iter().any(|&i| {
            let i = i as usize;
            let mean = self.scene.means[i];
            let square: f64 = (0..3).map(|k| f64::from(mean[k]) - centre[k]).map(|d| d * d).sum();
            self.large[i] || square > limit * limit
        })
    }
}
