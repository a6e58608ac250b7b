//! A model of the caller, and its stream.

use crate::error::{Error, Result};
use crate::plain::{EncodeOptions, Model};
use crate::stream::axes;
use gs_model::Scene;
use gsvx::{Aim, DEFAULT_QUALITY, Encoder};

/// The arrays of a model, of which lengths are right.
pub(crate) struct Arrays<'a> {
    pub(crate) axes: u32,
    pub(crate) sh_degree: u8,
    pub(crate) antialiased: bool,
    pub(crate) means: &'a [f32],
    pub(crate) rotations: &'a [f32],
    pub(crate) log_scales: &'a [f32],
    pub(crate) opacity_logits: &'a [f32],
    pub(crate) sh: &'a [f32],
}

/// The number of Gaussians of a model, and its SH degree.
pub(crate) fn shape(model: &Model) -> Result<(usize, u8)> {
    let count = usize::try_from(model.gaussians).map_err(|_| Error::TooMany(model.gaussians))?;
    Ok((count, sh_degree(model.sh_degree)?))
}

/// Encodes a model. Returns the stream, and what is to be said of it.
pub(crate) fn encode(
    arrays: &Arrays<'_>,
    options: Option<&EncodeOptions>,
) -> Result<(Vec<u8>, String)> {
    let mut scene = Scene {
        means: rows(arrays.means),
        rotations: rows(arrays.rotations),
        log_scales: rows(arrays.log_scales),
        opacity_logits: arrays.opacity_logits.to_vec(),
        sh_degree: arrays.sh_degree,
        sh: rows(arrays.sh),
        antialiased: arrays.antialiased,
        ..Scene::default()
    };
    axes(arrays.axes)?.turn_back(&mut scene);
    let aim = match options {
        None | Some(EncodeOptions { max_bytes: 0, quality: 0.0 }) => Aim::Quality(DEFAULT_QUALITY),
        Some(EncodeOptions { max_bytes: 0, quality }) => Aim::Quality(*quality),
        Some(options) => Aim::Bytes(options.max_bytes),
    };
    let made = Encoder::new(aim).encode(&scene, None)?;
    if let Some(missed) = made.missed {
        return Err(Error::Missed(missed));
    }
    let remarks: Vec<String> = made.warnings.iter().map(ToString::to_string).collect();
    Ok((made.encoded.bytes, remarks.join("; ")))
}

fn rows<const N: usize>(floats: &[f32]) -> Vec<[f32; N]> {
    floats.as_chunks().0.to_vec()
}

/// An SH degree.
fn sh_degree(degree: u32) -> Result<u8> {
    let fits = u8::try_from(degree).ok().filter(|d| *d <= 3);
    fits.ok_or(Error::Argument { what: "SH degree", value: degree.into(), range: "0 to 3" })
}
