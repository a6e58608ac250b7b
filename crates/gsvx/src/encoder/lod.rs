//! Levels of detail: coarser scenes that a viewer shows first or from afar.
//!
//! A Gaussian of a coarse level stands for all leaves of a cell of the octree. It matches the moments of
//! their Gaussians, weighted by importance, and then grows a little ([`super::source`]). All cells of a level hold about the same number of leaves.
//! Levels get coarser until one fits a chunk. Chunks nest: where a coarse chunk begins, a chunk of the
//! next finer level begins too, so that a viewer can replace a coarse chunk by finer ones.
//!
//! Invariant: no Gaussian of any level stands for leaves of two tiles, so the levels of a tile follow from its own
//! leaves and the number of levels.

use super::options::CodeOptions;
use crate::error::{Result, coding};
use gpcc_lite::{Leaf, Octree};
use std::ops::Range;
use voxel::Voxelization;

/// A coarse level has at most one Gaussian for so many of the next finer.
const RATIO: usize = 9;
/// A level of fewer Gaussians has no coarser one.
const LEAST: usize = 256;

/// One level of detail.
pub(crate) struct LodLevel {
    /// 0 is the finest.
    pub(crate) lod: u8,
    /// Its leaves; `None` for the finest, whose leaves are those of the voxelization.
    octree: Option<Octree>,
    /// For each leaf, the number of its first leaf of the finest level; then the number of those.
    first: Vec<u32>,
    /// The leaves of each tile.
    pub(crate) tiles: Vec<Range<usize>>,
    /// The number of the first leaf of each chunk, and of all leaves.
    pub(crate) cuts: Vec<usize>,
}

impl LodLevel {
    /// Its leaves.
    pub(crate) fn octree<'a>(&'a self, finest: &'a Voxelization) -> &'a Octree {
        self.octree.as_ref().unwrap_or_else(|| finest.octree())
    }

    /// Some of its leaves, with their Gaussians.
    pub(crate) fn part(&self, finest: &Voxelization, leaves: Range<usize>) -> Voxelization {
        let octree = self.octree(finest).part(leaves.clone());
        finest.regrouped(octree, &self.first[leaves.start..=leaves.end])
    }

    /// Sums of what the finest leaves have, per leaf of this level.
    pub(crate) fn sum(&self, finest: &[f32]) -> Vec<f32> {
        let of = |w: &[u32]| finest[w[0] as usize..w[1] as usize].iter().sum();
        self.first.windows(2).map(of).collect()
    }
}

/// The tiles of a voxelized scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LodTiles<'a> {
    /// The first leaf of each, and its Morton codes.
    pub(crate) tiles: &'a [(usize, Range<u64>)],
    /// Levels beside the finest, if other tiles have a say in it.
    pub(crate) coarse_levels: Option<usize>,
}

impl<'a> LodTiles<'a> {
    /// A scene that is not cut.
    pub(crate) const ONE: Self = Self { tiles: &[(0, 0..u64::MAX)], coarse_levels: None };

    /// Some tiles of a scene that has so many Gaussians in `several` tiles or in one.
    pub(crate) fn new(
        tiles: &'a [(usize, Range<u64>)],
        several: bool,
        gaussians: u64,
        options: &CodeOptions,
    ) -> Self {
        let mut levels = 0;
        let mut left = gaussians as usize;
        while another(levels, left, options) {
            left /= RATIO;
            levels += 1;
        }
        Self { tiles, coarse_levels: several.then_some(levels) }
    }
}

/// Whether a scene with so many coarse levels, the coarsest of so many leaves, has another.
fn another(levels: usize, leaves: usize, options: &CodeOptions) -> bool {
    options.lod
        && leaves >= LEAST
        && (levels == 0 || leaves > options.chunk_leaves.get())
        && levels + 1 < usize::from(crate::head::MAX_LODS)
}

/// The levels of detail of a voxelized scene, the finest first; only that if no others are wanted. Chunks of
/// all levels also begin where tiles begin.
pub(crate) fn levels(
    voxels: &Voxelization,
    options: &CodeOptions,
    tiles: LodTiles<'_>,
) -> Result<Vec<LodLevel>> {
    let n = voxels.len();
    let ends = tiles.tiles.iter().skip(1).map(|t| t.0).chain([n]);
    let runs: Vec<_> = tiles.tiles.iter().zip(ends).map(|(t, end)| t.0..end).collect();
    let first = (0..=n as u32).collect();
    let finest = LodLevel { lod: 0, octree: None, first, tiles: runs.clone(), cuts: Vec::new() };
    let mut levels = vec![finest];
    let wanted = |levels: usize, leaves: usize| match tiles.coarse_levels {
        Some(wanted) => options.lod && levels < wanted,
        None => another(levels, leaves, options),
    };
    while let Some(last) = levels.last()
        && wanted(levels.len() - 1, last.first.len() - 1)
    {
        let runs = runs.iter().zip(tiles.tiles).zip(&last.tiles);
        let runs = runs.map(|((run, (_, codes)), last)| (run, codes, last.len() / RATIO));
        levels.push(coarser(voxels.octree(), levels.len() as u8, runs)?);
    }
    // Cuts from the coarsest on: a level is cut wherever a coarser one is.
    let mut inherited: Vec<u64> = Vec::new();
    for level in levels.iter_mut().rev() {
        let leaves = level.octree(voxels).leaves();
        let fixed = level.tiles.iter().map(|t| t.start);
        let cuts = cuts(leaves, &inherited, fixed, options.chunk_leaves.get());
        inherited = cuts.iter().filter_map(|&i| leaves.get(i)).map(|l| l.morton).collect();
        level.cuts = cuts;
    }
    Ok(levels)
}

/// A level, from the finest leaves of each tile, its codes, and how many cells it may have at most.
fn coarser<'a>(
    finest: &Octree,
    lod: u8,
    tiles: impl Iterator<Item = (&'a Range<usize>, &'a Range<u64>, usize)>,
) -> Result<LodLevel> {
    let mut all = Vec::new();
    let mut runs = Vec::new();
    for (run, codes, most) in tiles {
        let start = all.len();
        let found = at_most(&finest.leaves()[run.clone()], codes, finest.depth(), most);
        all.extend(found.into_iter().map(|(first, cell)| (run.start + first, cell)));
        runs.push(start..all.len());
    }
    let end = finest.len() as u32;
    let first: Vec<u32> = all.iter().map(|c| c.0 as u32).chain([end]).collect();
    let leaves = all.into_iter().map(|c| c.1).collect();
    let octree =
        Octree::new(finest.cube(), finest.depth(), leaves).map_err(coding("level of detail"))?;
    Ok(LodLevel { lod, octree: Some(octree), first, tiles: runs, cuts: Vec::new() })
}

/// The smallest cells of a tile that are at most `most`, or as few as it has.
fn at_most(leaves: &[Leaf], codes: &Range<u64>, tree_depth: u8, most: usize) -> Vec<(usize, Leaf)> {
    // More leaves per cell make fewer cells.
    let (mut too_few, mut enough) = (1, leaves.len());
    while enough.saturating_sub(too_few) > 1 {
        let middle = too_few + (enough - too_few) / 2;
        if cells(leaves, codes, tree_depth, middle).len() <= most {
            enough = middle;
        } else {
            too_few = middle;
        }
    }
    cells(leaves, codes, tree_depth, enough)
}

/// Divides a tile into the largest cells that hold at most `most` leaves each and lie within its codes. Returns the first
/// leaf of each cell, and the smallest cell around its leaves.
fn cells(leaves: &[Leaf], codes: &Range<u64>, tree_depth: u8, most: usize) -> Vec<(usize, Leaf)> {
    let mut cells = Vec::new();
    // Nodes in Morton order, the next one last: first leaf, leaf behind the last, depth.
    let mut nodes = vec![(0, leaves.len(), 0u8)];
    while let Some((first, end, depth)) = nodes.pop() {
        if first == end {
            continue;
        }
        let bits = 3 * u32::from(tree_depth - depth);
        let start = leaves[first].morton >> bits << bits;
        let within = codes.start <= start && start + (1 << bits) <= codes.end;
        if end - first <= most && within {
            cells.push((first, common_cell(leaves[first], leaves[end - 1], tree_depth)));
            continue;
        }
        // There are two leaves or more, or the node reaches beyond the tile: all leaves are deeper than it.
        let shift = bits - 3;
        let mut behind = end;
        while behind > first {
            let child = leaves[behind - 1].morton >> shift;
            let start =
                first + leaves[first..behind].partition_point(|l| l.morton >> shift < child);
            nodes.push((start, behind, depth + 1));
            behind = start;
        }
    }
    cells
}

/// The smallest cell that holds two leaves.
fn common_cell(first: Leaf, last: Leaf, tree_depth: u8) -> Leaf {
    if first == last {
        return first;
    }
    let above = 1 + (63 - (first.morton ^ last.morton).leading_zeros()) / 3;
    Leaf { morton: first.morton >> (3 * above) << (3 * above), depth: tree_depth - above as u8 }
}

/// Where chunks begin: at the inherited cells, at the fixed leaves, and between them so that chunks have at most
/// `size` leaves and about the same number.
fn cuts(
    leaves: &[Leaf],
    inherited: &[u64],
    fixed: impl Iterator<Item = usize>,
    size: usize,
) -> Vec<usize> {
    let first_in = |&cell: &u64| leaves.partition_point(|l| l.morton < cell);
    let mut fixed: Vec<usize> = inherited.iter().map(first_in).chain(fixed).collect();
    fixed.extend([0, leaves.len()]);
    fixed.sort_unstable();
    fixed.dedup();
    let mut cuts = vec![0];
    for pair in fixed.windows(2) {
        let (start, len) = (pair[0], pair[1] - pair[0]);
        let parts = len.div_ceil(size).max(1);
        cuts.extend(
            (1..=parts).map(|i| start + (len as u128 * i as u128 / parts as u128) as usize),
        );
    }
    if leaves.is_empty() { Vec::new() } else { cuts }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::num::NonZeroUsize;

    #[test]
    fn chunks_of_levels_nest() {
        let leaves: Vec<Leaf> =
            (0..20_000u64).map(|i| Leaf { morton: i * i * 19, depth: 11 }).collect();
        let cube = gpcc_lite::Cube { origin: [0.0; 3], side: 1.0 };
        let voxels = Voxelization::one_each(Octree::new(cube, 11, leaves).unwrap());
        let chunk_leaves = NonZeroUsize::new(64).unwrap();
        let options = CodeOptions { lod: true, chunk_leaves, ..CodeOptions::default() };
        // Two tiles: the second begins with leaf 700.
        let code = voxels.octree().leaves()[700].morton;
        let tiles = [(0, 0..code), (700, code..u64::MAX)];
        let tiles = LodTiles { tiles: &tiles, coarse_levels: Some(3) };
        let levels = levels(&voxels, &options, tiles).unwrap();
        assert!(levels[0].cuts.contains(&700));
        assert_eq!(levels.len(), 4);
        let leaves_of = |level: &LodLevel| level.octree(&voxels).leaves().to_vec();
        for pair in levels.windows(2) {
            let (fine, coarse) = (leaves_of(&pair[0]), leaves_of(&pair[1]));
            // No fine chunk has leaves of two coarse ones.
            for &cut in &pair[1].cuts[..pair[1].cuts.len() - 1] {
                let first = fine.partition_point(|l| l.morton < coarse[cut].morton);
                assert!(pair[0].cuts.contains(&first));
            }
            for (fine, coarse) in pair[0].tiles.iter().zip(&pair[1].tiles) {
                assert!(coarse.len() * RATIO <= fine.len() || coarse.len() < 8 * 11);
            }
            // No cell reaches beyond its tile.
            let level = &pair[1];
            let tile = &leaves_of(level)[level.tiles[0].clone()];
            let end = tile.last().map(|l| l.morton + (1 << (3 * (11 - l.depth))));
            assert!(end.unwrap() <= code);
            assert!(pair[1].cuts.windows(2).all(|w| w[1] - w[0] <= 64));
        }
    }
}
