//! Writing the Inria layout.

use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

use rayon::prelude::*;

use super::columns;
use crate::error::{Error, Result};
use crate::fs;
use crate::rows::SH;
use crate::scene::Scene;

/// Rows encoded by one task, and rows encoded before they are written.
const ROWS_PER_TASK: usize = 1024;
const ROWS_PER_WRITE: usize = 64 * ROWS_PER_TASK;

/// Writes a scene as a binary little-endian PLY file in the full Inria layout: `x y z nx ny nz
/// f_dc f_rest opacity scale rot`, normals zero, `f_rest` channel-major.
///
/// The file appears whole or not at all: a temporary file beside it is written and renamed.
/// Every number is stored bit for bit, so reading the file gives the same scene again.
///
/// # Errors
/// [`Error::SceneShape`] or [`Error::SceneDegree`] if the arrays do not fit together,
/// [`Error::Io`] if the file cannot be written. Values are not validated.
pub fn write(path: impl AsRef<Path>, scene: &Scene) -> Result<()> {
    let path = path.as_ref();
    scene.check_shape()?;
    fs::write_atomically(path, |out| write_rows(out, scene))
}

/// Writes a scene as [`write()`] does, to anything that takes bytes. No buffering is needed.
///
/// # Errors
/// As [`write()`]; the file in an [`Error::Io`] is `<writer>`.
pub fn write_to(mut out: impl Write, scene: &Scene) -> Result<()> {
    scene.check_shape()?;
    write_rows(&mut out, scene).map_err(|e| Error::io(Path::new("<writer>"), "write", e))
}

fn write_rows(out: &mut dyn Write, scene: &Scene) -> std::io::Result<()> {
    let names = columns::inria_names(scene.sh_degree);
    let mut header =
        format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", scene.len());
    for name in &names {
        // Writing to a String does not fail.
        let _ = writeln!(header, "property float {name}");
    }
    header.push_str("end_header\n");
    out.write_all(header.as_bytes())?;

    let stride = 4 * names.len();
    let mut buffer = vec![0; stride * ROWS_PER_WRITE.min(scene.len())];
    for first in (0..scene.len()).step_by(ROWS_PER_WRITE) {
        let rows = ROWS_PER_WRITE.min(scene.len() - first);
        let part = &mut buffer[..rows * stride];
        part.par_chunks_mut(stride * ROWS_PER_TASK).enumerate().for_each(|(task, bytes)| {
            for (i, row) in bytes.chunks_exact_mut(stride).enumerate() {
                encode_row(scene, first + task * ROWS_PER_TASK + i, row);
            }
        });
        out.write_all(part)?;
    }
    Ok(())
}

fn encode_row(scene: &Scene, i: usize, row: &mut [u8]) {
    let (sh, [x, y, z]) = (scene.sh_of(i), scene.means[i]);
    let mut slots = row.chunks_exact_mut(4);
    let mut put = |v: f32| {
        if let Some(slot) = slots.next() {
            slot.copy_from_slice(&v.to_le_bytes());
        }
    };
    for v in [x, y, z, 0.0, 0.0, 0.0] {
        put(v);
    }
    sh[0].into_iter().for_each(&mut put);
    for channel in 0..3 {
        for coefficient in &sh[1..] {
            put(coefficient[channel]);
        }
    }
    put(scene.opacity_logits[i]);
    scene.log_scales[i].into_iter().for_each(&mut put);
    scene.rotations[i].into_iter().for_each(&mut put);
    debug_assert_eq!(
        row.len(),
        4 * (SH + 3 * sh.len() + 3),
        "a row is the scene's numbers and three normals"
    );
}
