//! [`MortonOrder`]: the Gaussians of a scene in Morton order, in which the Gaussians of every cell
//! are a range.

use gpcc_lite::morton;
use gs_model::Scene;
use multiversion::multiversion;
use rayon::prelude::*;

use crate::check::check_cube;
use crate::check::check_depths;
use crate::error::{Error, Result};
use crate::pages::Pages;
use gpcc_lite::{Cube, Grid};

/// Gaussians per parallel work item. Fixed, so that no result depends on the number of threads.
pub(crate) const CHUNK: usize = 4096;

/// The Gaussians of a scene in Morton order at one depth.
#[derive(Debug)]
pub(crate) struct MortonOrder {
    /// Ascending Morton codes at `depth`.
    pub(crate) codes: Pages<u64>,
    /// `members[i]` is the Gaussian whose code is `codes[i]`; ties ascend.
    pub(crate) members: Vec<u32>,
}

impl MortonOrder {
    /// Codes every mean at `depth` and sorts.
    pub(crate) fn of(scene: &Scene, cube: &Cube, depth: u8) -> Result<Self> {
        let len = scene.len();
        if u32::try_from(len).is_err() {
            return Err(Error::TooMany(len));
        }
        let mut codes = Pages::<u64>::zeroed(len);
        fill(&mut codes, &scene.means, cube, depth)?;
        Ok(Self::sorted(codes))
    }

    /// Sorts the codes of Gaussians 0, 1, ... (fewer than 2^32); ties keep that order.
    pub(crate) fn sorted(mut codes: Pages<u64>) -> Self {
        let mut pairs = Pages::<[u64; 2]>::zeroed(codes.len());
        let numbered = pairs.par_iter_mut().zip(&codes[..]).enumerate();
        numbered.for_each(|(i, (pair, &code))| *pair = [code, i as u64]);
        // No two are equal, so the result does not depend on the number of threads.
        pairs.par_sort_unstable();
        codes.par_iter_mut().zip(&pairs[..]).for_each(|(code, pair)| *code = pair[0]);
        let members = pairs.par_iter().map(|pair| pair[1] as u32).collect();
        Self { codes, members }
    }
}

/// The Morton code of each mean at `depth`.
///
/// # Errors
/// [`Error::OutsideCube`], [`Error::NonFiniteMean`] and [`Error::DepthTooGreat`].
pub fn morton_codes(means: &[[f32; 3]], cube: &Cube, depth: u8) -> Result<Vec<u64>> {
    check_depths(0, depth)?;
    check_cube(cube)?;
    let mut codes = vec![0; means.len()];
    fill(&mut codes, means, cube, depth)?;
    Ok(codes)
}

/// Writes the code of each mean.
fn fill(codes: &mut [u64], means: &[[f32; 3]], cube: &Cube, depth: u8) -> Result<()> {
    let grid = cube.grid(depth);
    let first_outside = codes
        .par_chunks_mut(CHUNK)
        .zip(means.par_chunks(CHUNK))
        .enumerate()
        .filter_map(|(chunk, (codes, means))| {
            encode(grid, codes, means);
            // No cell has this code.
            let outside = codes.iter().position(|&code| code == u64::MAX)?;
            Some(chunk * CHUNK + outside)
        })
        .min();
    let Some(index) = first_outside else { return Ok(()) };
    let finite = means[index].iter().all(|x| x.is_finite());
    Err(if finite { Error::OutsideCube { index } } else { Error::NonFiniteMean { index } })
}

/// Writes the code of each mean; all bits are set for a mean outside the cube.
#[multiversion(targets("x86_64+avx2"))]
fn encode(grid: Grid, codes: &mut [u64], means: &[[f32; 3]]) {
    for (code, mean) in codes.iter_mut().zip(means) {
        let (index, inside) = grid.nearest(*mean);
        *code = if inside { morton::encode(index) } else { u64::MAX };
    }
}

/// End of the run, starting at `start`, of codes that share their cell at `depth`.
pub(crate) fn cell_end(codes: &[u64], start: usize, j_high: u8, depth: u8) -> usize {
    let shift = 3 * u32::from(j_high - depth);
    let cell = codes[start] >> shift;
    // Galloping search: most runs are short, and long ones take logarithmic time.
    let mut step = 1;
    let mut low = start;
    while low + step < codes.len() && codes[low + step] >> shift == cell {
        low += step;
        step *= 2;
    }
    let high = (low + step).min(codes.len());
    low + codes[low..high].partition_point(|&c| c >> shift == cell)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cell_end_agrees_with_a_scan() {
        let codes: Vec<u64> = (0..300u64).map(|i| i * i / 7).collect();
        for depth in 0..=6 {
            let shift = 3 * (6 - depth);
            for start in 0..codes.len() {
                let scan = (start..codes.len())
                    .find(|&i| codes[i] >> shift != codes[start] >> shift)
                    .unwrap_or(codes.len());
                assert_eq!(cell_end(&codes, start, 6, depth as u8), scan);
            }
        }
    }
}
