//! SOG (PlayCanvas): versions 1 and 2 are read, 2 is written.
//!
//! A `meta.json` and up to seven lossless WebP images, in which pixel `i` belongs to Gaussian `i`: in one
//! zip archive (`.sog`), or as files in one folder. Means are 16-bit steps between bounds, of
//! `sign(x) ln(1 + |x|)`; rotations are the three smallest components, a byte each; log-scales and colours are
//! bytes. The higher SH coefficients of a Gaussian are a row of a palette of bytes. In version 2 a byte is the
//! index of a codebook of 256 numbers, and opacities are bytes; in version 1, which does not say its version, a
//! byte is a step between bounds, and so is that of an opacity's logit. Axes are those of PLY files.
//!
//! *Limits:* images have at most 2^20 pixels and 4 more per byte of the textures. A scene therefore takes
//! at most about a thousand times the memory of its file, and some megabytes.

mod decoder;
mod members;
mod meta;
mod palette;
mod precision;
mod prefix;
mod texture;
mod webp;
mod write;

use std::path::Path;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::formats::Format;
use crate::report::Report;
use crate::scene::Scene;
pub use members::META;
use members::Members;
use meta::Meta;
use texture::Texture;
pub use write::{Files, files, files_of_chunk};

pub(crate) static FORMAT: Format = Format {
    name: "sog",
    about: "SOG of PlayCanvas: an archive, or meta.json with images beside it; reads versions 1 and 2, writes 2",
    extensions: &["sog", "json"],
    magic: &[b"PK\x03\x04"],
    max_sh_degree: 3,
    says_antialiased: true,
    says_origin: false,
    steps: Some(write::steps),
    read: |file, bytes, _| read(file, bytes),
    write: Some(write::write),
};

/// Reads a bundled `.sog`, or the `meta.json` of an unbundled one, with the images beside it.
fn read(file: &Path, bytes: &[u8]) -> Result<(Scene, Report)> {
    let (meta, mut members) = if bytes.starts_with(b"PK") {
        let mut archive = Members::archive(file, bytes)?;
        (archive.read(file, "meta.json")?, archive)
    } else if bytes.trim_ascii_start().starts_with(b"{") {
        (bytes.to_vec(), Members::Folder(file.parent().unwrap_or(Path::new(""))))
    } else {
        return Err(Error::other_format(file, "a SOG, neither archive nor meta.json", bytes));
    };
    let meta = Meta::parse(file, &meta)?;
    let images = meta.files.iter().map(|name| members.read(file, name));
    let images: Vec<Vec<u8>> = images.collect::<Result<_>>()?;
    let most_pixels = texture::most_pixels(&images);
    let textures: Vec<Result<Texture>> = (meta.files.par_iter().zip(&images))
        .map(|(name, image)| {
            Texture::decode(image, most_pixels).map_err(|reason| malformed(file, name, reason))
        })
        .collect();
    let textures: Vec<Texture> = textures.into_iter().collect::<Result<_>>()?;
    let scene = decoder::scene(file, &meta, &textures)?;
    let scene = Scene { antialiased: meta.antialiased, ..scene };
    let form = format!("SOG, version {}", meta.version);
    let bytes_beside = match members {
        Members::Folder(_) => images.iter().map(|image| image.len() as u64).sum(),
        Members::Archive(..) => 0,
    };
    Ok((scene, Report { bytes_beside, notes: meta.notes, ..Report::of(FORMAT.name, form) }))
}

fn malformed(file: &Path, place: &str, reason: impl AsRef<str>) -> Error {
    Error::malformed(file, &format!("SOG, {place}"), reason)
}
