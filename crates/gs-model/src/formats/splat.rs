//! `.splat` files: 32 bytes per Gaussian, no header, no view dependence.
//!
//! A row is the mean and the standard deviations (three little-endian `f32` each, the latter
//! linear), then four bytes colour and opacity, then four bytes quaternion, w first. The format
//! is that of antimatter15/splat; world axes are those of the PLY file that it was made from.
//!
//! What is written lacks the SH coefficients above the DC; colours and opacities are bytes, rotations are good
//! to about half a degree. Rows keep their order.

use std::io::Write;
use std::path::Path;

use rayon::prelude::*;

use crate::bytes::float;
use crate::error::{Error, Result};
use crate::formats::Format;
use crate::formats::foreign;
use crate::math::unit;
use crate::report::Report;
use crate::rows::{self, SH};
use crate::scene::{SH_C0, Scene};

pub(crate) static FORMAT: Format = Format {
    name: "splat",
    about: ".splat of antimatter15: 32 bytes per Gaussian, no view dependence",
    extensions: &["splat"],
    magic: &[],
    max_sh_degree: 0,
    says_antialiased: false,
    says_origin: false,
    steps: None,
    read: |file, bytes, _| read(file, bytes),
    write: Some(write),
};

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

/// The byte of the opacity of a logit.
pub(crate) fn opacity_byte(logit: f32) -> u8 {
    libm::roundf(255.0 / (1.0 + libm::expf(-logit))) as u8
}

/// The header of the first files of GaussianSplats3D, which are called `.splat` too. Most of it is zero.
const OLD_HEADER: usize = 1024;

fn read(file: &Path, bytes: &[u8]) -> Result<(Scene, Report)> {
    if bytes.get(2 * ROW..OLD_HEADER).is_some_and(|rows| rows.iter().all(|&b| b == 0)) {
        let what = "an early file of GaussianSplats3D rather than a .splat of antimatter15; make it anew from the \
                    model's PLY";
        return Err(foreign::is(file, what));
    }
    if !bytes.len().is_multiple_of(ROW) {
        let missing = format!("the rows of a .splat are {ROW} bytes each, the last is not whole");
        return Err(Error::truncated(file, bytes.len(), missing));
    }
    let scene = rows::scene_of(file, bytes.len() / ROW, 0, |i| {
        let row = &bytes[ROW * i..ROW * (i + 1)];
        move |c| match c {
            0..3 => float(row, 4 * c),
            3..7 => (f32::from(row[28 + c - 3]) - 128.0) / 128.0,
            7..10 => libm::logf(float(row, 4 * (c - 4))),
            10 => opacity_logit(row[27]),
            _ => (f32::from(row[24 + c - SH]) / 255.0 - 0.5) / SH_C0,
        }
    })?;
    Ok((scene, Report::of(FORMAT.name, ".splat")))
}

fn write(file: &Path, out: &mut dyn Write, scene: &Scene) -> Result<()> {
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
        row[27] = opacity_byte(scene.opacity_logits[i]);
        for (o, v) in row[28..].iter_mut().zip(unit(scene.rotations[i])) {
            *o = libm::round(128.0 + 128.0 * v) as u8;
        }
    });
    out.write_all(&bytes).map_err(|e| Error::io(file, "write", e))
}
