//! Rows of parameters for Adam: in one array ([`Flat`]), or gathered from the arrays of a scene.

use gs_model::Scene;
use rayon::prelude::*;

use super::CHUNK;

/// Up to 256 rows of parameters, in any memory layout.
pub trait RowChunk: Send {
    /// Copies the parameters of row `i` of the chunk.
    fn load(&self, i: usize, row: &mut [f32]);
    /// Puts them back.
    fn store(&mut self, i: usize, row: &[f32]);
}

/// Rows that follow each other in one array.
pub struct Flat<'a> {
    rows: &'a mut [f32],
    stride: usize,
}

impl<'a> Flat<'a> {
    /// The chunks of an array of rows.
    pub fn chunks(
        rows: &'a mut [f32],
        stride: usize,
    ) -> impl IndexedParallelIterator<Item = Flat<'a>> {
        rows.par_chunks_mut(CHUNK * stride).map(move |rows| Flat { rows, stride })
    }
}

impl RowChunk for Flat<'_> {
    fn load(&self, i: usize, row: &mut [f32]) {
        row.copy_from_slice(&self.rows[i * self.stride..(i + 1) * self.stride]);
    }

    fn store(&mut self, i: usize, row: &[f32]) {
        self.rows[i * self.stride..(i + 1) * self.stride].copy_from_slice(row);
    }
}

/// Up to 256 Gaussians of a scene. Their rows: mean, SH coefficients, opacity logit, log-scales, quaternion.
pub(super) struct SceneChunk<'a> {
    means: &'a mut [[f32; 3]],
    sh: &'a mut [[f32; 3]],
    opacity_logits: &'a mut [f32],
    log_scales: &'a mut [[f32; 3]],
    rotations: &'a mut [[f32; 4]],
}

/// The chunks of a scene.
pub(super) fn scene_chunks(
    scene: &mut Scene,
) -> impl IndexedParallelIterator<Item = SceneChunk<'_>> {
    let k = scene.sh_len();
    let Scene { means, rotations, log_scales, opacity_logits, sh, .. } = scene;
    let others = log_scales.par_chunks_mut(CHUNK).zip(rotations.par_chunks_mut(CHUNK));
    let all = means.par_chunks_mut(CHUNK).zip(sh.par_chunks_mut(CHUNK * k));
    let all = all.zip(opacity_logits.par_chunks_mut(CHUNK)).zip(others);
    all.map(|(((means, sh), opacity_logits), (log_scales, rotations))| SceneChunk {
        means,
        sh,
        opacity_logits,
        log_scales,
        rotations,
    })
}

impl RowChunk for SceneChunk<'_> {
    #[inline(always)]
    fn load(&self, i: usize, row: &mut [f32]) {
        let k = self.sh.len() / self.means.len();
        let at = 3 + 3 * k;
        row[..3].copy_from_slice(&self.means[i]);
        row[3..at].copy_from_slice(self.sh[i * k..(i + 1) * k].as_flattened());
        row[at] = self.opacity_logits[i];
        row[at + 1..at + 4].copy_from_slice(&self.log_scales[i]);
        row[at + 4..].copy_from_slice(&self.rotations[i]);
    }

    #[inline(always)]
    fn store(&mut self, i: usize, row: &[f32]) {
        let k = self.sh.len() / self.means.len();
        let at = 3 + 3 * k;
        copy(row, &mut self.means[i]);
        self.sh[i * k..(i + 1) * k].as_flattened_mut().copy_from_slice(&row[3..at]);
        self.opacity_logits[i] = row[at];
        copy(&row[at + 1..], &mut self.log_scales[i]);
        copy(&row[at + 4..], &mut self.rotations[i]);
    }
}

fn copy<const N: usize>(from: &[f32], to: &mut [f32; N]) {
    to.copy_from_slice(&from[..N]);
}

/// Parameters of a row, of `k` SH coefficients.
pub(super) fn stride(k: usize) -> usize {
    3 * k + 11
}

/// The rows of a scene.
#[cfg(feature = "gpu")]
pub(crate) fn rows_of(scene: &Scene) -> Vec<f32> {
    // A copy, because chunks borrow the scene mutably.
    let mut scene = scene.clone();
    let width = stride(scene.sh_len());
    let mut rows = vec![0.0; width * scene.len()];
    scene_chunks(&mut scene).zip(rows.par_chunks_mut(CHUNK * width)).for_each(|(from, rows)| {
        rows.chunks_exact_mut(width).enumerate().for_each(|(i, row)| from.load(i, row));
    });
    rows
}

/// Puts rows into a scene.
#[cfg(feature = "gpu")]
pub(crate) fn set_rows(scene: &mut Scene, rows: &[f32]) {
    let width = stride(scene.sh_len());
    scene_chunks(scene).zip(rows.par_chunks(CHUNK * width)).for_each(|(mut to, rows)| {
        rows.chunks_exact(width).enumerate().for_each(|(i, row)| to.store(i, row));
    });
}
