//! glTF with Gaussians: the extension `KHR_gaussian_splatting`, in `.glb` and `.gltf` files.
//!
//! A Gaussian is a point of a primitive. The attributes are the mean, the rotation as a unit quaternion
//! (x, y, z, w), the linear standard deviations, the linear opacity, and the SH coefficients, one
//! attribute each. What is written also has `COLOR_0`, the colour without view dependence, for viewers that show
//! points only.
//!
//! glTF's axes are x left, y up, z forward; those of a PLY file are x right, y down, z forward. Reader and
//! writer turn a model by half a turn about z, as splat-transform does: x and y of means and
//! quaternions, and every SH function that is odd in them, change sign.
//!
//! Means and SH coefficients are written bit for bit. Rotations become unit quaternions, scales and
//! opacities linear, all as `f32`: log-scales come back to within 2^-22 of their size or of 1, opacities
//! to within 2^-24. glTF holds no empty scene, and at most 4 GiB.
//!
//! The reader joins all Gaussians in the scene, where its nodes have them: turned, mirrored, scaled and shifted, with
//! their SH coefficients. A node that shears or scales axes apart is an error, since no Gaussian follows it. Data are
//! in the file, in `data:` URIs, or in files beside it, but nowhere else.
//!
//! A primitive may be compressed by an extension of the extension. SPZ (`KHR_gaussian_splatting_compression_spz_2`) is
//! read; for others the reader needs a [`crate::Codec`]. [`CompressedGltf`] writes one.
//!
//! Not read: primitives that something else compresses, colours in linear light, other kernels and projections. Each
//! is an error that says so.

mod accessor;
mod buffers;
mod coded;
mod compressed;
mod container;
mod document;
mod instances;
mod json;
mod read;
mod spz;
mod write;

pub use compressed::CompressedGltf;
pub use spz::write_spz;

use std::path::Path;

use crate::error::Error;
use crate::formats::Format;

pub(crate) static FORMAT: Format = Format {
    name: "glb",
    about: "glTF (.glb, .gltf) with KHR_gaussian_splatting, also compressed as SPZ; written as .glb",
    extensions: &["glb", "gltf"],
    magic: &[container::MAGIC],
    max_sh_degree: 3,
    says_antialiased: false,
    says_origin: true,
    steps: None,
    read: read::read,
    write: Some(write::write),
};

/// Name of the extension of glTF, and prefix of its attributes.
const EXTENSION: &str = "KHR_gaussian_splatting";

/// The name of an attribute of the extension.
fn attribute(name: &str) -> String {
    format!("{EXTENSION}:{name}")
}

/// The name of the attribute of basis function `k`.
fn sh_attribute(k: usize) -> String {
    let degree = k.isqrt();
    attribute(&format!("SH_DEGREE_{degree}_COEF_{}", k - degree * degree))
}

fn malformed(file: &Path, place: &str, reason: impl AsRef<str>) -> Error {
    Error::malformed(file, &format!("glTF, {place}"), reason)
}
