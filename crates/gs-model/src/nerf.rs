//! `transforms.json`, as NeRF tools write it (instant-ngp, nerfstudio, Blender scenes).
//!
//! Poses are camera-to-world matrices with OpenGL camera axes: x right, **y up, z backward**.
//! The reader turns the y and z axes around to get those of [`Camera`]. World coordinates are
//! taken as they are.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde::Deserialize;

use crate::camera::Camera;
use crate::dataset::View;
use crate::error::{Error, Result};
use crate::{fs, image_size};

/// Numbers that a frame may override. Sizes are floats because instant-ngp writes `1080.0`.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(default)]
struct Intrinsics {
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    /// Horizontal and vertical field of view, radians.
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

#[derive(Deserialize)]
struct Transforms {
    #[serde(flatten)]
    intrinsics: Intrinsics,
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
    intrinsics: Intrinsics,
}

impl Intrinsics {
    /// These numbers, and for those that are missing the file's.
    ///
    /// A frame with a focal length of its own does not inherit a field of view, and the other
    /// way round.
    fn or(self, file: Self) -> Self {
        let own_focal = self.fl_x.or(self.fl_y).or(self.camera_angle_x).is_some();
        let focal = |own: Option<f64>, file: Option<f64>| if own_focal { own } else { file };
        Self {
            w: self.w.or(file.w),
            h: self.h.or(file.h),
            fl_x: focal(self.fl_x, file.fl_x),
            fl_y: focal(self.fl_y, file.fl_y),
            cx: self.cx.or(file.cx),
            cy: self.cy.or(file.cy),
            camera_angle_x: focal(self.camera_angle_x, file.camera_angle_x),
            camera_angle_y: focal(self.camera_angle_y, file.camera_angle_y),
            k1: self.k1.or(file.k1),
            k2: self.k2.or(file.k2),
            k3: self.k3.or(file.k3),
            k4: self.k4.or(file.k4),
            p1: self.p1.or(file.p1),
            p2: self.p2.or(file.p2),
        }
    }

    /// The first distortion coefficient that is not zero.
    fn distortion(&self) -> Option<String> {
        let all = [
            ("k1", self.k1),
            ("k2", self.k2),
            ("k3", self.k3),
            ("k4", self.k4),
            ("p1", self.p1),
            ("p2", self.p2),
        ];
        let found = all.into_iter().find_map(|(n, v)| v.filter(|&v| v != 0.0).map(|v| (n, v)));
        found.map(|(name, value)| format!("{name} = {value}"))
    }
}

/// Reads the views of a `transforms.json`, in file order.
///
/// [`Camera::name`] is the frame's `file_path` without a leading `./`; the photo is at that
/// path relative to the file's folder (with `.png` added if only that is there, as in Blender
/// scenes). The focal length is `fl_x`, `fl_y`, else that of `camera_angle_x`,
/// `camera_angle_y`; a missing `y` is the `x`. The principal point is `cx`, `cy`, else the
/// image's centre. A size that the file does not give is read from the photo.
///
/// # Errors
/// [`Error::Io`], [`Error::Json`], [`Error::DistortedCamera`] if a distortion coefficient is
/// not zero or the camera model is a fisheye, [`Error::ImageSize`], [`Error::BadCamera`].
pub fn read_views(file: impl AsRef<Path>) -> Result<Vec<View>> {
    let file = file.as_ref();
    parse(file, &fs::read(file)?)
}

/// Reads the views from the bytes of a `transforms.json`; `file` is where it would lie, which
/// decides where its photos are.
///
/// # Errors
/// As [`read_views`].
pub fn views_from_bytes(file: impl AsRef<Path>, bytes: &[u8]) -> Result<Vec<View>> {
    parse(file.as_ref(), bytes)
}

fn parse(file: &Path, bytes: &[u8]) -> Result<Vec<View>> {
    let transforms: Transforms = serde_json::from_slice(bytes)
        .map_err(|source| Error::Json { file: file.into(), source })?;
    let dir = file.parent().unwrap_or(Path::new(""));
    let Transforms { intrinsics, camera_model, frames } = transforms;
    frames
        .into_iter()
        .map(|frame| {
            let own = frame.intrinsics.or(intrinsics);
            let model = frame.camera_model.as_ref().or(camera_model.as_ref());
            view(file, dir, &frame, &own, model)
        })
        .collect()
}

fn view(
    file: &Path,
    dir: &Path,
    frame: &Frame,
    intrinsics: &Intrinsics,
    model: Option<&String>,
) -> Result<View> {
    let name = frame.file_path.trim_start_matches("./").to_owned();
    let fisheye = model.filter(|m| !matches!(m.as_str(), "PINHOLE" | "SIMPLE_PINHOLE" | "OPENCV"));
    if let Some(model) = fisheye.cloned().or_else(|| intrinsics.distortion()) {
        return Err(Error::DistortedCamera { file: file.into(), camera: name, model });
    }
    let bad = |reason| Error::BadCamera { file: file.into(), view: name.clone(), reason };

    let image_path = photo(dir, &name);
    let (width, height) = match (intrinsics.w, intrinsics.h) {
        (Some(w), Some(h)) => {
            let whole = |v: f64| {
                let fits = v >= 0.0 && v <= f64::from(u32::MAX) && v.fract() == 0.0;
                if fits { Ok(v as u32) } else { Err(bad("w or h is not a whole number of pixels")) }
            };
            (whole(w)?, whole(h)?)
        }
        _ => image_size::read(&image_path)?,
    };
    let (w, h) = (f64::from(width), f64::from(height));
    let of_angle = |angle: f64, size: f64| size / 2.0 / libm::tan(angle / 2.0);
    let fx = intrinsics.fl_x.or(intrinsics.camera_angle_x.map(|a| of_angle(a, w)));
    let fy = intrinsics.fl_y.or(intrinsics.camera_angle_y.map(|a| of_angle(a, h))).or(fx);
    let (Some(fx), Some(fy)) = (fx.or(fy), fy) else {
        return Err(bad("no focal length: neither fl_x nor camera_angle_x"));
    };

    let (x, y, z) = match frame.transform_matrix.as_slice() {
        &[x, y, z] | &[x, y, z, [0.0, 0.0, 0.0, 1.0]] => (x, y, z),
        _ => return Err(bad("transform_matrix is not a 4x4 pose")),
    };
    // Rows of camera-to-world, with the y and z axes of the camera turned around, are the
    // columns of world-to-camera.
    let column = |row: [f64; 4]| DVec3::new(row[0], -row[1], -row[2]);
    let rotation = DMat3::from_cols(column(x), column(y), column(z));
    let translation = -(rotation * DVec3::new(x[3], y[3], z[3]));
    let (cx, cy) = (intrinsics.cx.unwrap_or(w / 2.0), intrinsics.cy.unwrap_or(h / 2.0));
    let camera = Camera { name, width, height, fx, fy, cx, cy, rotation, translation };
    Ok(View { camera: camera.checked(file)?, image_path })
}

fn photo(dir: &Path, name: &str) -> PathBuf {
    let exact = dir.join(name);
    let png = dir.join(format!("{name}.png"));
    if !exact.is_file() && png.is_file() { png } else { exact }
}
