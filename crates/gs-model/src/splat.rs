//! `.splat` files: 32 bytes per Gaussian, no header, no view dependence.
//!
//! A row is the mean and the standard deviations (three little-endian `f32` each, the latter
//! linear), then four bytes colour and opacity, then four bytes quaternion, w first. The format
//! is that of antimatter15/splat; world axes are those of the PLY file that it was made from.

use std::io::Write;
use std::path::Path;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::options::ReadOptions;
use crate::rows;
use crate::scene::{SH_C0, Scene};
use crate::{fs, report};

const ROW: usize = 32;

/// The logit of an opacity stored as a byte.
///
/// A byte `b` stands for the opacities that round to it; its logit is that of `b / 255`. For 0 and
/// 255 that logit would be infinite. Only half a step rounds to them, and they stand for its
/// middle, 1/4 and 254 3/4.
pub(crate) fn opacity_logit(byte: u8) -> f32 {
    let opacity = f64::from(byte).clamp(0.25, 254.75) / 255.0;
    libm::log(opacity / (1.0 - opacity)) as f32
}

pub(crate) fn decode(
    file: &Path,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<(Scene, report::Report)> {
    if !bytes.len().is_multiple_of(ROW) {
        return Err(Error::SplatLength { file: file.into(), len: bytes.len() });
    }
    let scene = rows::scene(bytes.len() / ROW, 0, |mut rows| {
        for i in 0..rows.len() {
            let at = ROW * (rows.first + i);
            let row = &bytes[at..at + ROW];
            let float = |k: usize| {
                f32::from_le_bytes([row[4 * k], row[4 * k + 1], row[4 * k + 2], row[4 * k + 3]])
            };
            rows.set(i, |c| match c {
                0..3 => float(c),
                3..7 => (f32::from(row[28 + c - 3]) - 128.0) / 128.0,
                7..10 => libm::logf(float(3 + c - 7)),
                10 => opacity_logit(row[27]),
                _ => (f32::from(row[24 + c - rows::SH]) / 255.0 - 0.5) / SH_C0,
            });
        }
        Ok(())
    })?;
    report::finish(file, scene, report::Format::Splat, options)
}

/// Writes a scene as a `.splat` file: SH coefficients above the DC are left out, colours and
/// opacities become bytes, rotations are good to about half a degree. Rows keep their order.
/// The file appears whole or not at all.
///
/// # Errors
/// [`Error::SceneShape`] or [`Error::SceneDegree`] if the arrays do not fit together,
/// [`Error::Io`].
pub fn write(path: impl AsRef<Path>, scene: &Scene) -> Result<()> {
    let path = path.as_ref();
    scene.check_shape()?;
    fs::write_atomically(path, |out| out.write_all(&rows_of(scene)))
}

/// Writes a scene as [`write()`] does, to anything that takes bytes.
///
/// # Errors
/// As [`write()`]; the file in an [`Error::Io`] is `<writer>`.
pub fn write_to(mut out: impl Write, scene: &Scene) -> Result<()> {
    scene.check_shape()?;
    out.write_all(&rows_of(scene)).map_err(|e| Error::io(Path::new("<writer>"), "write", e))
}

fn rows_of(scene: &Scene) -> Vec<u8> {
    let mut bytes = vec![0; ROW * scene.len()];
    bytes.par_chunks_mut(ROW).with_min_len(1024).enumerate().for_each(|(i, row)| {
        // A scale of zero or infinity could not be read back.
        let scales = scene.log_scales[i].map(|l| libm::expf(l).clamp(f32::MIN_POSITIVE, f32::MAX));
        for (slot, v) in row.chunks_exact_mut(4).zip(scene.means[i].into_iter().chain(scales)) {
            slot.copy_from_slice(&v.to_le_bytes());
        }
        for (o, v) in row[24..27].iter_mut().zip(scene.sh_of(i)[0]) {
            *o = libm::roundf(255.0 * (0.5 + SH_C0 * v)) as u8;
        }
        row[27] = libm::roundf(255.0 / (1.0 + libm::expf(-scene.opacity_logits[i]))) as u8;
        let q = scene.rotations[i];
        let norm = q.iter().map(|v| v * v).sum::<f32>().sqrt();
        for (o, v) in row[28..].iter_mut().zip(q) {
            *o = libm::roundf(128.0 + 128.0 * v / norm) as u8;
        }
    });
    bytes
}
