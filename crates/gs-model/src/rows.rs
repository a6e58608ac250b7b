//! Fills a [`Scene`] row by row, in parallel.
//!
//! Inside the readers and the writer a Gaussian is a row of numbers in *scene order*: mean
//! (3), rotation (4), log-scale (3), opacity logit (1), then the SH coefficients
//! coefficient-major (`3 * sh_len`).

use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::scene::{Scene, SceneMut, sh_len};

/// First SH number of a row in scene order.
pub(crate) const SH: usize = 11;

/// Numbers per Gaussian at an SH degree.
pub(crate) const fn row_len(sh_degree: u8) -> usize {
    SH + 3 * sh_len(sh_degree)
}

/// Rows per task: about 250 kB of a file of SH degree 3, enough to make the cost of a task negligible.
const ROWS_PER_TASK: usize = 1024;

impl SceneMut<'_> {
    /// Sets Gaussian `i` from the numbers of its row; `get(c)` is number `c` in scene order.
    #[inline]
    pub(crate) fn set(&mut self, i: usize, get: impl Fn(usize) -> f32) {
        let k = self.sh_len();
        self.means[i] = [get(0), get(1), get(2)];
        self.rotations[i] = [get(3), get(4), get(5), get(6)];
        self.log_scales[i] = [get(7), get(8), get(9)];
        self.opacity_logits[i] = get(10);
        for (j, rgb) in self.sh[i * k..(i + 1) * k].iter_mut().enumerate() {
            let c = SH + 3 * j;
            *rgb = [get(c), get(c + 1), get(c + 2)];
        }
    }
}

impl Scene {
    /// The Gaussians of a range in parts of `rows`, for several threads, each with the index of its first one.
    ///
    /// # Panics
    /// If the range exceeds the scene.
    pub fn par_parts_mut(
        &mut self,
        range: Range<usize>,
        rows: usize,
    ) -> impl IndexedParallelIterator<Item = (usize, SceneMut<'_>)> {
        let k = self.sh_len();
        self.means[range.clone()]
            .par_chunks_mut(rows)
            .zip(self.rotations[range.clone()].par_chunks_mut(rows))
            .zip(self.log_scales[range.clone()].par_chunks_mut(rows))
            .zip(self.opacity_logits[range.clone()].par_chunks_mut(rows))
            .zip(self.sh[range.start * k..range.end * k].par_chunks_mut(rows * k))
            .enumerate()
            .map(move |(part, ((((means, rotations), log_scales), opacity_logits), sh))| {
                let part_of = SceneMut { means, rotations, log_scales, opacity_logits, sh };
                (range.start + part * rows, part_of)
            })
    }
}

/// A scene of `n` Gaussians, filled by `fill` in parallel over disjoint runs of rows, each with the index of its first.
///
/// The caller has checked that the input is long enough to hold `n` rows, which bounds the
/// allocation. Of several errors, the one of the first rows is returned. `file` is for the message where there is no
/// memory.
pub(crate) fn scene(
    file: &Path,
    n: usize,
    sh_degree: u8,
    fill: impl Fn(usize, SceneMut<'_>) -> Result<()> + Sync,
) -> Result<Scene> {
    let mut scene = zeros(file, n, sh_degree)?;
    fill_range(&mut scene, 0..n, fill)?;
    Ok(scene)
}

/// As [`scene`], where each row is decoded by itself: `row(i)` gives the numbers of Gaussian `i` by their place
/// in scene order.
#[cfg(feature = "formats")]
pub(crate) fn scene_of<R: Fn(usize) -> f32>(
    file: &Path,
    n: usize,
    sh_degree: u8,
    row: impl Fn(usize) -> R + Sync,
) -> Result<Scene> {
    scene(file, n, sh_degree, |first, mut rows| {
        for i in 0..rows.len() {
            rows.set(i, row(first + i));
        }
        Ok(())
    })
}

fn zeros(file: &Path, n: usize, sh_degree: u8) -> Result<Scene> {
    Scene::try_zeros(n, sh_degree).map_err(|_| Error::Memory { file: file.into(), gaussians: n })
}

/// As [`scene`], for a range of the rows of an existing scene.
pub(crate) fn fill_range(
    scene: &mut Scene,
    range: Range<usize>,
    fill: impl Fn(usize, SceneMut<'_>) -> Result<()> + Sync,
) -> Result<()> {
    let parts = scene.par_parts_mut(range, ROWS_PER_TASK);
    let outcomes: Vec<Result<()>> = parts.map(|(first, rows)| fill(first, rows)).collect();
    outcomes.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_no_memory_holds_are_an_error_that_counts_them() {
        // On 32 bits, `usize::MAX` is the largest claim.
        const CLAIM: usize = if usize::BITS > 32 { usize::MAX >> 24 } else { usize::MAX };
        let fill = |_, _: SceneMut<'_>| unreachable!("there are no rows");
        let error = scene(Path::new("a.ply"), CLAIM, 3, fill).unwrap_err();
        assert_eq!(error.to_string(), format!("a.ply: no memory for its {CLAIM} Gaussians"));
    }
}
