//! The paper's adaptive criteria, per voxel (section 3.2.2):
//! [`Strategy::Paper`](crate::Strategy::Paper).

use bytemuck::{Pod, Zeroable};
use gpcc_lite::Leaf;
use gs_model::Scene;
use rayon::prelude::*;

use crate::descend::{self, OccupiedCell};
use crate::gaussian::log_volume;
use crate::order::{CHUNK, MortonOrder};
use crate::pages::Pages;
use gpcc_lite::Cube;

/// Flags the Gaussians whose volume reaches the `100 - percent` percentile.
///
/// All Gaussians at the threshold are flagged. 0 % flags none, 100 % all.
pub(crate) fn large(scene: &Scene, percent: f64) -> Vec<bool> {
    let len = scene.len();
    let count = (len as f64 * percent / 100.0).round() as usize;
    if count == 0 {
        return vec![false; len];
    }
    let key = |i: usize| ascending(log_volume(scene.log_scales[i]));
    // Counting finds the bucket that holds the threshold, a selection the threshold in it.
    let chunks = (0..len.div_ceil(CHUNK)).into_par_iter();
    let range = |chunk: usize| chunk * CHUNK..len.min((chunk + 1) * CHUNK);
    let counts = chunks
        .clone()
        .fold(
            || vec![0u32; BUCKETS],
            |mut counts, chunk| {
                range(chunk).for_each(|i| counts[bucket(key(i))] += 1);
                counts
            },
        )
        .reduce(
            || vec![0u32; BUCKETS],
            |mut a, b| {
                a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                a
            },
        );
    let (mut wanted, mut rank) = (0, len - count);
    while rank >= counts[wanted] as usize {
        rank -= counts[wanted] as usize;
        wanted += 1;
    }
    let mut inside: Vec<u64> = chunks
        .flat_map_iter(|chunk| range(chunk).map(key).filter(|&k| bucket(k) == wanted))
        .collect();
    let (_, &mut threshold, _) = inside.select_nth_unstable(rank);
    (0..len).into_par_iter().with_min_len(CHUNK).map(|i| key(i) >= threshold).collect()
}

/// The highest bits of a key are its bucket: sign, exponent and one bit of the mantissa.
const BUCKET_BITS: u32 = 13;
const BUCKETS: usize = 1 << BUCKET_BITS;

fn bucket(key: u64) -> usize {
    (key >> (u64::BITS - BUCKET_BITS)) as usize
}

/// An integer; these are ordered as `f64::total_cmp` orders the numbers.
fn ascending(x: f64) -> u64 {
    let bits = x.to_bits();
    if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
}

/// The criteria, and the scene that they are applied to.
pub(crate) struct PaperRule<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) cube: &'a Cube,
    pub(crate) large: &'a [bool],
    pub(crate) j_low: u8,
    pub(crate) j_high: u8,
    pub(crate) tau1: u32,
    pub(crate) tau2: f64,
}

/// What the criteria need of one Gaussian.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Point {
    mean: [f32; 3],
    /// 1 or 0.
    large: u32,
}

impl PaperRule<'_> {
    /// Depth of the leaf of every Gaussian of `order`.
    pub(crate) fn depths(&self, order: &MortonOrder) -> Vec<u8> {
        // In Morton order, because the members of a cell are read once for every depth.
        let mut points = Pages::<Point>::zeroed(order.members.len());
        let all = points.par_chunks_mut(CHUNK).zip(order.members.par_chunks(CHUNK));
        all.for_each(|(points, members)| {
            for (point, &i) in points.iter_mut().zip(members) {
                let i = i as usize;
                *point = Point { mean: self.scene.means[i], large: u32::from(self.large[i]) };
            }
        });
        let root = OccupiedCell { codes: &order.codes, members: &points };
        descend::depths(&root, self.j_low, self.j_high, |voxel, depth| self.splits(voxel, depth))
    }

    fn splits(&self, voxel: &OccupiedCell<'_, Point>, depth: u8) -> bool {
        let points = voxel.members;
        if points.len() as u64 > u64::from(self.tau1) || points.iter().any(|p| p.large != 0) {
            return true;
        }
        let leaf = Leaf::of(voxel.codes[0], depth, self.j_high);
        let centre = self.cube.centre_offset(leaf, self.j_high);
        let limit = self.tau2 * self.cube.cell(depth);
        points.iter().any(|point| {
            let offset = self.cube.offset(point.mean);
            let square: f64 = (0..3).map(|k| offset[k] - centre[k]).map(|d| d * d).sum();
            square > limit * limit
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against sorting, with many ties.
    #[test]
    fn large_is_the_percentile() {
        let mut scene = Scene { sh_degree: 0, ..Scene::default() };
        let mut x = 1u64;
        for _ in 0..10_000 {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            scene.log_scales.push(std::array::from_fn(|k| ((x >> (40 + 8 * k)) % 7) as f32 - 3.0));
        }
        scene.means = vec![[0.0; 3]; 10_000];
        let unsorted: Vec<f64> = scene.log_scales.iter().map(|&l| log_volume(l)).collect();
        let mut volumes = unsorted.clone();
        volumes.sort_by(f64::total_cmp);
        for (percent, count) in [(0.01, 1), (1.0, 100), (20.0, 2000), (99.0, 9900), (100.0, 10_000)]
        {
            let threshold = volumes[10_000 - count];
            let want: Vec<bool> = unsorted.iter().map(|v| *v >= threshold).collect();
            assert_eq!(large(&scene, percent), want, "{percent}");
        }
        assert!(large(&scene, 0.0).iter().all(|l| !l));
    }

    #[test]
    fn keys_order_as_the_numbers() {
        let x = [f64::NEG_INFINITY, -3.0, -1e-300, -0.0, 0.0, 1e-300, 2.5, f64::INFINITY];
        assert!(x.map(ascending).is_sorted_by(|a, b| a < b));
    }
}
