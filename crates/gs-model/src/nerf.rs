//! `transforms.json`, as NeRF tools write it (instant-ngp, nerfstudio, Blender scenes).
//!
//! Poses are camera-to-world matrices with OpenGL camera axes: x right, **y up, z backward**.
//! The reader negates the y and z axes to get those of [`Camera`]. World coordinates are
//! taken as they are.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde::Deserialize;

use crate::camera::{Camera, LensDistortion, checked_size};
use crate::error::{Error, Result};
use crate::view::View;
use crate::{fs, image_size};

/// Numbers that the file states for all frames and a frame may override. Sizes are floats because instant-ngp writes `1080.0`.
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
    /// The numbers of a frame, and the file's where the frame has none.
    ///
    /// A frame that states a focal length or a field of view inherits neither from the file.
    fn or(self, file: Self) -> Self {
        let frame_has_focal = self.fl_x.or(self.fl_y).or(self.camera_angle_x).is_some();
        let focal =
            |frame: Option<f64>, file: Option<f64>| if frame_has_focal { frame } else { file };
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
/// not zero or the camera model is a fisheye, [`Error::ImageSize`], [`Error::ImageTooLarge`],
/// [`Error::BadCamera`].
pub fn read_views(file: impl AsRef<Path>) -> Result<Vec<View>> {
    read_views_with(file, LensDistortion::Refuse)
}

/// As [`read_views`], with a choice of what to do with distorted cameras.
///
/// # Errors
/// As [`read_views`], without [`Error::DistortedCamera`] for [`LensDistortion::Ignore`].
pub fn read_views_with(file: impl AsRef<Path>, distortion: LensDistortion) -> Result<Vec<View>> {
    let file = file.as_ref();
    parse(file, &fs::read(file)?, distortion)
}

/// Reads the views from the bytes of a `transforms.json`. `file` is the path that the file would
/// have; the paths of the photos are relative to its folder.
///
/// # Errors
/// As [`read_views`].
pub fn views_from_bytes(file: impl AsRef<Path>, bytes: &[u8]) -> Result<Vec<View>> {
    parse(file.as_ref(), bytes, LensDistortion::Refuse)
}

fn parse(file: &Path, bytes: &[u8], distortion: LensDistortion) -> Result<Vec<View>> {
    let transforms: Transforms =
        serde_json::from_slice(bytes).map_err(|cause| Error::Json { file: file.into(), cause })?;
    let Transforms { intrinsics, camera_model, frames } = transforms;
    frames
        .into_iter()
        .map(|frame| {
            let camera_model = frame.camera_model.as_ref().or(camera_model.as_ref());
            view(file, &frame, &frame.intrinsics.or(intrinsics), camera_model, distortion)
        })
        .collect()
}

fn view(
    file: &Path,
    frame: &Frame,
    intrinsics: &Intrinsics,
    camera_model: Option<&String>,
    distortion: LensDistortion,
) -> Result<View> {
    let name = frame.file_path.trim_start_matches("./").to_owned();
    let fisheye =
        camera_model.filter(|m| !matches!(m.as_str(), "PINHOLE" | "SIMPLE_PINHOLE" | "OPENCV"));
    let found = fisheye.cloned().or_else(|| intrinsics.distortion());
    let ignored_distortion = match (found, distortion) {
        (Some(model), LensDistortion::Refuse) => {
            return Err(Error::DistortedCamera { file: file.into(), camera: name, model });
        }
        (found, _) => found,
    };
    let bad = |reason| Error::BadCamera { file: file.into(), view: name.clone(), reason };

    let image_path = photo(file.parent().unwrap_or(Path::new("")), &name);
    let (width, height) = size_of(file, &name, intrinsics, &image_path)?;
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
    // The rows of camera-to-world, with the camera's y and z axes negated, are the columns of
    // world-to-camera.
    let column = |row: [f64; 4]| DVec3::new(row[0], -row[1], -row[2]);
    let rotation = DMat3::from_cols(column(x), column(y), column(z));
    let translation = -(rotation * DVec3::new(x[3], y[3], z[3]));
    let (cx, cy) = (intrinsics.cx.unwrap_or(w / 2.0), intrinsics.cy.unwrap_or(h / 2.0));
    let camera =
        Camera { name, width, height, fx, fy, cx, cy, rotation, translation, ignored_distortion };
    Ok(View { camera: camera.checked(file)?, image_path })
}

/// The size that the file states, else that of the photo.
fn size_of(
    file: &Path,
    name: &str,
    intrinsics: &Intrinsics,
    image_path: &Path,
) -> Result<(u32, u32)> {
    let (Some(w), Some(h)) = (intrinsics.w, intrinsics.h) else {
        let (width, height) = image_size::read(image_path)?;
        return checked_size(image_path, name, width.into(), height.into());
    };
    if [w, h].iter().any(|v| v.fract() != 0.0 || *v < 0.0) {
        let (view, reason) = (name.to_owned(), "w or h is not a whole number of pixels");
        return Err(Error::BadCamera { file: file.into(), view, reason });
    }
    // The cast saturates.
    checked_size(file, name, w as u64, h as u64)
}

/// Where a frame's photo is: at its path, or with `.png` added if only that file exists.
fn photo(dir: &Path, name: &str) -> PathBuf {
    let exact = dir.join(name);
    let png = dir.join(format!("{name}.png"));
    if !exact.is_file() && png.is_file() { png } else { exact }
}
