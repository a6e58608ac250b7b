//! Writes the Inria layout.

use std::io::Write;
use std::path::Path;

use rayon::prelude::*;

use super::{columns, origin};
use crate::error::{Error, Result};
use crate::rows::SH;
use crate::scene::{Scene, sh_len};

/// Rows encoded by one task, and rows encoded before they are written.
const ROWS_PER_TASK: usize = 1024;
const ROWS_PER_WRITE: usize = 64 * ROWS_PER_TASK;

/// Writes a scene as a binary little-endian PLY file in the full Inria layout: `x y z nx ny nz
/// f_dc f_rest opacity scale rot`, normals zero, `f_rest` channel-major.
///
/// The file appears whole or not at all: a temporary file beside it is written and renamed.
/// Every number is stored bit for bit, so reading the file gives the same scene again. [`Scene::origin`] is a comment,
/// `origin X Y Z`.
///
/// # Errors
/// [`Error::SceneShape`] or [`Error::SceneDegree`] if the arrays do not fit together,
/// [`Error::Io`] if the file cannot be written. Values are not validated.
pub fn write(path: impl AsRef<Path>, scene: &Scene) -> Result<()> {
    super::FORMAT.write(path, scene)
}

/// Writes a scene as [`write()`] does, to anything that takes bytes. No buffering is needed.
///
/// # Errors
/// As [`write()`]; the file in an [`Error::Io`] is `<writer>`.
pub fn write_to(out: impl Write, scene: &Scene) -> Result<()> {
    super::FORMAT.write_to("<writer>", out, scene)
}

/// The header that [`write()`] puts before the rows of `count` Gaussians of a scene, of which `scene` may hold none. With
/// [`rows`] it serves writers that do not hold the whole scene in memory.
#[must_use]
pub fn header(count: usize, scene: &Scene) -> Vec<u8> {
    let vertex = element("vertex", count, "float", &columns::inria_names(scene.sh_degree));
    header_of(&[vertex], scene)
}

/// The lines of a header that declare an element whose properties all have the type `kind`.
pub(super) fn element(
    name: &str,
    count: usize,
    kind: &str,
    properties: &[impl AsRef<str>],
) -> String {
    let properties = properties.iter().map(|name| format!("property {kind} {}\n", name.as_ref()));
    format!("element {name} {count}\n{}", properties.collect::<String>())
}

/// The header of a scene in these elements.
pub(super) fn header_of(elements: &[String], scene: &Scene) -> Vec<u8> {
    let mode = if scene.antialiased { "comment SplatRenderMode: mip\n" } else { "" };
    let comments = mode.to_owned() + &origin::comment(scene.origin);
    let elements = elements.concat();
    format!("ply\nformat binary_little_endian 1.0\n{comments}{elements}end_header\n").into_bytes()
}

/// Replaces the contents of `out` by the rows of a scene's Gaussians as [`write()`] makes them. Runs
/// on the calling thread alone and reuses the memory of `out`.
///
/// # Errors
/// As [`write()`].
pub fn rows(scene: &Scene, out: &mut Vec<u8>) -> Result<()> {
    scene.check_shape()?;
    let stride = row_bytes(scene.sh_degree);
    out.resize(stride * scene.len(), 0);
    for (i, row) in out.chunks_exact_mut(stride).enumerate() {
        encode_row(scene, i, row);
    }
    Ok(())
}

/// Writes the rows of a scene's Gaussians as [`write()`] does.
///
/// # Errors
/// As [`write_to`].
pub fn write_rows_to(mut out: impl Write, scene: &Scene) -> Result<()> {
    scene.check_shape()?;
    write_rows(Path::new("<writer>"), &mut out, scene)
}

/// Bytes of a row of [`rows`].
#[must_use]
pub fn row_bytes(sh_degree: u8) -> usize {
    4 * (SH + 3 * sh_len(sh_degree) + 3)
}

pub(super) fn write_all(file: &Path, out: &mut dyn Write, scene: &Scene) -> Result<()> {
    let header = header(scene.len(), scene);
    out.write_all(&header).map_err(|e| Error::io(file, "write", e))?;
    write_rows(file, out, scene)
}

fn write_rows(file: &Path, out: &mut dyn Write, scene: &Scene) -> Result<()> {
    let stride = row_bytes(scene.sh_degree);
    let mut buffer = vec![0; stride * ROWS_PER_WRITE.min(scene.len())];
    for first in (0..scene.len()).step_by(ROWS_PER_WRITE) {
        let rows = ROWS_PER_WRITE.min(scene.len() - first);
        let part = &mut buffer[..rows * stride];
        part.par_chunks_mut(stride * ROWS_PER_TASK).enumerate().for_each(|(task, bytes)| {
            for (i, row) in bytes.chunks_exact_mut(stride).enumerate() {
                encode_row(scene, first + task * ROWS_PER_TASK + i, row);
            }
        });
        out.write_all(part).map_err(|e| Error::io(file, "write", e))?;
    }
    Ok(())
}

/// Writes a row: the scene's numbers and a zero normal.
fn encode_row(scene: &Scene, i: usize, row: &mut [u8]) {
    let (sh, [x, y, z]) = (scene.sh_of(i), scene.means[i]);
    let (row, _) = row.as_chunks_mut::<4>();
    let (front, row) = row.split_at_mut(9);
    let [r, g, b] = sh[0];
    for (slot, v) in front.iter_mut().zip([x, y, z, 0.0, 0.0, 0.0, r, g, b]) {
        *slot = v.to_le_bytes();
    }
    let rest = sh.len() - 1;
    let (rest, row) = row.split_at_mut(3 * rest);
    let (red, rest) = rest.split_at_mut(sh.len() - 1);
    let (green, blue) = rest.split_at_mut(sh.len() - 1);
    for (((r, g), b), coefficient) in red.iter_mut().zip(green).zip(blue).zip(&sh[1..]) {
        *r = coefficient[0].to_le_bytes();
        *g = coefficient[1].to_le_bytes();
        *b = coefficient[2].to_le_bytes();
    }
    let ([s0, s1, s2], [w, x, y, z]) = (scene.log_scales[i], scene.rotations[i]);
    for (slot, v) in row.iter_mut().zip([scene.opacity_logits[i], s0, s1, s2, w, x, y, z]) {
        *slot = v.to_le_bytes();
    }
}
