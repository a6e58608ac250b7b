//! [`write_spz`]: files whose Gaussians are compressed as SPZ, for CesiumJS.

use std::io::Write;
use std::path::Path;

use super::compressed::{empty, finish};
use super::document::{Document, bound};
use super::json::{F32, U8};
use super::{attribute, sh_attribute};
use crate::axes::ABOUT_X;
use crate::error::Result;
use crate::formats::spz::{ShBits, pack_version_3};
use crate::scene::{Scene, sh_len};

pub(super) const EXTENSION: &str = "KHR_gaussian_splatting_compression_spz_2";

/// Writes a `.glb` file with `KHR_gaussian_splatting_compression_spz_2`, as CesiumJS 1.140 reads it in 3D Tiles.
///
/// CesiumJS takes the numbers of the SPZ as they are for those of glTF. So the axes of this file are those of SPZ,
/// `(x, -y, -z)` of a PLY file: y is up. Where the origin of the model lies is the translation of the node.
///
/// # Errors
/// As [`crate::spz::pack`]; [`crate::Error::Unwritable`] for an empty scene, [`crate::Error::Io`].
pub fn write_spz(
    name: impl AsRef<Path>,
    mut out: impl Write,
    scene: &Scene,
    bits: ShBits,
) -> Result<()> {
    let file = name.as_ref();
    if scene.is_empty() {
        return Err(empty(file));
    }
    let data = pack_version_3(file, scene, bits)?;
    let mut document = Document::new(scene.len());
    bound(document.attribute("POSITION".into(), F32, "VEC3", None), scene.bounds(), &ABOUT_X);
    document.attribute("COLOR_0".into(), U8, "VEC4", None);
    document.attribute(attribute("SCALE"), F32, "VEC3", None);
    document.attribute(attribute("ROTATION"), F32, "VEC4", None);
    // CesiumJS tells the degree by the number of these; degree 0 is the colour.
    for k in 1..sh_len(scene.sh_degree) {
        document.attribute(sh_attribute(k), F32, "VEC3", None);
    }
    finish(file, &mut out, document, (EXTENSION, &data), ABOUT_X.place(scene.origin))
}
