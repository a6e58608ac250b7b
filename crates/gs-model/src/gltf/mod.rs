//! glTF with Gaussians: the extension `KHR_gaussian_splatting`, in binary files (`.glb`).
//!
//! A Gaussian is a point of a primitive. The attributes are the mean, the rotation as a unit quaternion
//! (x, y, z, w), the linear standard deviations, the linear opacity, and the SH coefficients, one
//! attribute each. [`write()`] adds `COLOR_0`, the colour without view dependence, for viewers that show
//! points only.
//!
//! glTF's axes are x left, y up, z forward; those of a PLY file are x right, y down, z forward. Reader and
//! writer turn a model by half a turn about z, as splat-transform does: x and y of means and
//! quaternions, and every SH function that is odd in them, change sign.
//!
//! Not read: node transforms, compressed primitives, colours in linear light, other kernels, data in
//! other files. Each is an error that says so.

mod accessor;
mod axes;
mod container;
mod json;
mod read;
mod write;

pub use write::{write, write_to};

pub(crate) use read::decode;

use std::path::Path;

use crate::error::Error;

/// Name of the extension, and prefix of its attributes.
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

fn malformed(file: &Path, place: &str, reason: &str) -> Error {
    Error::malformed(file, "glTF", place, reason)
}
