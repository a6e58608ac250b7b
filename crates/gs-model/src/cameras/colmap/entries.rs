//! The entries of the files, and the camera models.

use std::path::Path;

use crate::cameras::lens::PANORAMA;
use crate::error::Error;

/// A row of the cameras file.
pub(super) struct Intrinsics {
    pub(super) id: u32,
    pub(super) model: CameraModel,
    pub(super) width: u64,
    pub(super) height: u64,
    pub(super) params: Vec<f64>,
}

/// A row of the images file.
pub(super) struct PosedImage {
    pub(super) name: String,
    pub(super) camera: u32,
    /// World to camera, w first.
    pub(super) rotation: [f64; 4],
    pub(super) translation: [f64; 3],
}

/// A point of a sparse model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Where it is, in the world's units.
    pub position: [f64; 3],
    /// RGB, 8 bits per value.
    pub colour: [u8; 3],
}

/// COLMAP's camera models, each at the index that is its id: name, number of parameters, and
/// how many of these are focal lengths. The focal lengths come first, then `cx` and `cy`, then the
/// distortion (`src/colmap/sensor/models.h`).
pub(super) const MODELS: [(&str, usize, usize); 18] = [
    ("SIMPLE_PINHOLE", 3, 1),
    ("PINHOLE", 4, 2),
    ("SIMPLE_RADIAL", 4, 1),
    ("RADIAL", 5, 1),
    ("OPENCV", 8, 2),
    ("OPENCV_FISHEYE", 8, 2),
    ("FULL_OPENCV", 12, 2),
    ("FOV", 5, 2),
    ("SIMPLE_RADIAL_FISHEYE", 4, 1),
    ("RADIAL_FISHEYE", 5, 1),
    ("THIN_PRISM_FISHEYE", 12, 2),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16, 2),
    ("SIMPLE_DIVISION", 4, 1),
    ("DIVISION", 5, 2),
    ("SIMPLE_FISHEYE", 3, 1),
    ("FISHEYE", 4, 2),
    ("EUCM", 6, 2),
    // Its parameters are width and height.
    (PANORAMA, 2, 0),
];

/// A camera model, as its index in [`MODELS`].
#[derive(Clone, Copy)]
pub(super) struct CameraModel(pub(super) usize);

impl CameraModel {
    pub(super) fn name(self) -> &'static str {
        MODELS[self.0].0
    }

    /// Number of parameters.
    pub(super) fn params(self) -> usize {
        MODELS[self.0].1
    }

    pub(super) fn focal_lengths(self) -> usize {
        MODELS[self.0].2
    }
}

/// The error of a camera whose model is not one of [`MODELS`].
pub(super) fn unknown_model(file: &Path, id: u32, model: &str) -> Error {
    let reason = format!(
        "unknown camera model {model}: undistort the images first with `colmap image_undistorter`"
    );
    Error::malformed(file, &format!("camera {id}"), reason)
}
