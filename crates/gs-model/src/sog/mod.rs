//! SOG (PlayCanvas), version 2: read only.
//!
//! A `meta.json` and up to seven lossless WebP images, in which pixel `i` belongs to Gaussian `i`: in one
//! zip archive (`.sog`), or as files in one folder. Means are 16-bit steps between bounds, of
//! `sign(x) ln(1 + |x|)`; log-scales and colours are indices of codebooks of 256 numbers; rotations are the
//! three smallest components, a byte each; opacities are bytes. The higher SH coefficients of a
//! Gaussian are a row of a palette whose entries are indices of a codebook. Axes are those of PLY files.
//!
//! *Limits:* images have at most 2^20 pixels and 4 more per byte of the textures. A scene therefore takes
//! at most about a thousand times the memory of its file, and some megabytes.

mod decoder;
mod members;
mod meta;
mod texture;

use std::path::Path;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::options::ReadOptions;
use crate::report;
use crate::rows;
use crate::scene::Scene;
use decoder::Decoder;
use members::Members;
use meta::Meta;
use texture::Texture;

/// Reads a bundled `.sog`.
pub(crate) fn decode(
    file: &Path,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<(Scene, report::Report)> {
    let mut archive = Members::archive(file, bytes)?;
    let meta = archive.read(file, "meta.json")?;
    unpack(file, &meta, archive, options)
}

/// Reads the `meta.json` of an unbundled one, with the images beside it.
pub(crate) fn decode_beside(
    file: &Path,
    meta: &[u8],
    options: &ReadOptions,
) -> Result<(Scene, report::Report)> {
    let folder = file.parent().unwrap_or(Path::new(""));
    unpack(file, meta, Members::Folder(folder), options)
}

fn unpack(
    file: &Path,
    meta: &[u8],
    mut members: Members,
    options: &ReadOptions,
) -> Result<(Scene, report::Report)> {
    let meta = Meta::parse(file, meta)?;
    let names = meta.textures();
    let images = names.iter().map(|name| members.read(file, name));
    let images: Vec<Vec<u8>> = images.collect::<Result<_>>()?;
    let most_pixels = texture::most_pixels(&images);
    let textures: Vec<Result<Texture>> = names
        .par_iter()
        .zip(&images)
        .map(|(name, image)| {
            Texture::decode(image, most_pixels).map_err(|reason| malformed(file, name, reason))
        })
        .collect();
    let textures: Vec<Texture> = textures.into_iter().collect::<Result<_>>()?;
    let decoder = Decoder::new(file, &meta, &textures)?;
    let scene = rows::scene(decoder.len(), meta.sh_degree(), |mut rows| {
        for i in 0..rows.len() {
            let row = decoder.row(rows.first + i);
            rows.set(i, |c| row.number(c));
        }
        Ok(())
    })?;
    report::finish(file, scene, report::Format::Sog, options)
}

fn malformed(file: &Path, place: &str, reason: &str) -> Error {
    Error::malformed(file, "SOG", place, reason)
}
