//! `transforms.json`, as NeRF tools write it (instant-ngp, nerfstudio, Blender scenes).
//!
//! Poses are camera-to-world matrices with OpenGL camera axes: x right, **y up, z backward**.
//! The reader negates the y and z axes to get those of [`Camera`]. World coordinates are
//! taken as they are.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use imagesize::ImageError;
use serde::Deserialize;
use serde_json::Value;

use crate::camera::{self, Camera, NEAR, View, checked_size};
use crate::error::{Error, Result};
use crate::lens::Lens;
use crate::nerfstudio::Placed;
use crate::photos::Finder;

#[derive(Deserialize)]
struct Transforms {
    #[serde(flatten)]
    all: BTreeMap<String, Value>,
    camera_model: Option<String>,
    frames: Vec<Frame>,
}

#[derive(Deserialize)]
struct Frame {
    file_path: String,
    /// Camera to world, row by row; the last row is 0 0 0 1 and may be missing.
    transform_matrix: Vec<[f64; 4]>,
    camera_model: Option<String>,
    #[serde(flatten)]
    own: BTreeMap<String, Value>,
}

/// The focal lengths in pixels, or else the fields of view in radians.
const FOCAL: [&str; 4] = ["fl_x", "fl_y", "camera_angle_x", "camera_angle_y"];
/// Coefficients of the lens in the orders of `FULL_OPENCV` and `OPENCV_FISHEYE`.
const OPENCV: [&str; 8] = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];
const FISHEYE: [&str; 4] = ["k1", "k2", "k3", "k4"];

/// The numbers of a frame, and those that the file states for all frames.
struct Intrinsics<'a> {
    own: &'a BTreeMap<String, Value>,
    all: &'a BTreeMap<String, Value>,
    /// The photo, which has the size that the file does not give.
    image_path: PathBuf,
}

impl Intrinsics<'_> {
    /// The number of that name: the frame's, or else the file's. Sizes are floats too, because instant-ngp
    /// writes `1080.0`.
    fn get(&self, name: &str) -> Option<f64> {
        let own = |name: &str| self.own.get(name).and_then(Value::as_f64);
        // A frame that states a focal length or a field of view inherits neither from the file.
        let complete = FOCAL.contains(&name) && FOCAL.iter().any(|n| own(n).is_some());
        let all = || self.all.get(name).and_then(Value::as_f64).filter(|_| !complete);
        own(name).or_else(all)
    }

    fn lens(&self, camera_model: Option<&str>) -> Option<Lens> {
        let value = |name: &str| self.get(name).unwrap_or(0.0);
        match camera_model.unwrap_or("OPENCV") {
            "PINHOLE" | "SIMPLE_PINHOLE" | "OPENCV" | "FULL_OPENCV" => {
                Lens::new("FULL_OPENCV", &OPENCV.map(value))
            }
            "OPENCV_FISHEYE" => Lens::new("OPENCV_FISHEYE", &FISHEYE.map(value)),
            other => Lens::new(other, &[]),
        }
    }
}

/// Reads the views from the bytes of a `transforms.json`, in file order. `file` is the path that the file would
/// have; the paths of the photos are relative to its folder.
///
/// [`Camera::name`] is the frame's `file_path` without a leading `./`; the photo is at that
/// path relative to the file's folder, or beside it with another extension (Blender scenes name none).
/// The focal length is `fl_x`, `fl_y`, else that of `camera_angle_x`, `camera_angle_y`; a missing `y` is the `x`. The principal point is `cx`, `cy`, else the
/// image's centre. A size that the file does not give is read from the photo. With nerfstudio's
/// `dataparser_transforms.json` beside the file, the cameras are those of the models that nerfstudio exports.
///
/// # Errors
/// [`Error::Io`], [`Error::Json`], [`Error::BadCamera`], [`Error::Malformed`] for a photo without a size.
pub fn views_from_bytes(file: impl AsRef<Path>, bytes: &[u8]) -> Result<Vec<View>> {
    let file = file.as_ref();
    let transforms: Transforms =
        serde_json::from_slice(bytes).map_err(|e| Error::json(file, "a camera file", e))?;
    let Transforms { all, camera_model, frames } = transforms;
    let placed = Placed::beside(file, &all)?;
    let mut finder = Finder::default();
    let dir = file.parent().unwrap_or(Path::new(""));
    let of_frame = |frame: &Frame| {
        let camera_model = frame.camera_model.as_ref().or(camera_model.as_ref());
        let name = frame.file_path.trim_start_matches("./");
        let found = finder.find(dir, Path::new(name))?;
        let image_path = found.unwrap_or_else(|| dir.join(name));
        let intrinsics = Intrinsics { own: &frame.own, all: &all, image_path };
        let mut view = view(file, frame, intrinsics, camera_model.map(|m| &m[..]))?;
        if let Some(placed) = &placed {
            view.camera = placed.camera(view.camera).checked(file)?;
        }
        Ok(view)
    };
    frames.iter().map(of_frame).collect()
}

fn view(
    file: &Path,
    frame: &Frame,
    intrinsics: Intrinsics<'_>,
    camera_model: Option<&str>,
) -> Result<View> {
    let name = frame.file_path.trim_start_matches("./").to_owned();
    let lens = intrinsics.lens(camera_model);
    let bad = |reason: &str| camera::bad(file, &name, reason);

    let (width, height) = size_of(file, &name, &intrinsics)?;
    let (w, h) = (f64::from(width), f64::from(height));
    let of_angle = |angle: f64, size: f64| size / 2.0 / libm::tan(angle / 2.0);
    let of = |name: &str| intrinsics.get(name);
    let fx = of("fl_x").or(of("camera_angle_x").map(|a| of_angle(a, w)));
    let fy = of("fl_y").or(of("camera_angle_y").map(|a| of_angle(a, h))).or(fx);
    let (Some(fx), Some(fy)) = (fx.or(fy), fy) else {
        return Err(bad("no focal length: neither fl_x nor camera_angle_x"));
    };

    let (x, y, z) = match frame.transform_matrix.as_slice() {
        &[x, y, z] | &[x, y, z, [0.0, 0.0, 0.0, 1.0]] => (x, y, z),
        _ => return Err(bad("transform_matrix is not a 4x4 pose")),
    };
    // The rows of camera-to-world, with the camera's y and z axes negated, are the columns of
    // world-to-camera.
    let column = |row: [f64; 4]| DVec3::new(row[0], -row[1], -row[2]);
    let rotation = DMat3::from_cols(column(x), column(y), column(z));
    let translation = -(rotation * DVec3::new(x[3], y[3], z[3]));
    let (cx, cy) = (of("cx").unwrap_or(w / 2.0), of("cy").unwrap_or(h / 2.0));
    let camera =
        Camera { name, width, height, fx, fy, cx, cy, rotation, translation, lens, near: NEAR };
    Ok(View { camera: camera.checked(file)?, image_path: intrinsics.image_path })
}

/// The size that the file states, else that of the photo.
fn size_of(file: &Path, name: &str, intrinsics: &Intrinsics<'_>) -> Result<(u32, u32)> {
    let image_path = &intrinsics.image_path;
    let (Some(w), Some(h)) = (intrinsics.get("w"), intrinsics.get("h")) else {
        let size = imagesize::size(image_path).map_err(|e| match e {
            ImageError::IoError(e) if e.kind() != ErrorKind::UnexpectedEof => {
                Error::io(image_path, "read", e)
            }
            _ => {
                let reason = "not that of a whole PNG, JPEG or WebP, so its size is not known";
                Error::malformed(image_path, "image header", reason)
            }
        })?;
        return checked_size(image_path, name, size.width as u64, size.height as u64);
    };
    if [w, h].iter().any(|v| v.fract() != 0.0 || *v < 0.0) {
        return Err(camera::bad(file, name, "w or h is not a whole number of pixels"));
    }
    // The cast saturates.
    checked_size(file, name, w as u64, h as u64)
}
