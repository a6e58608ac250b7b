//! `transforms.json`, as NeRF tools write it (instant-ngp, nerfstudio, Blender scenes).
//!
//! Poses are camera-to-world matrices with OpenGL camera axes: x right, **y up, z backward**.
//! The reader negates the y and z axes to get those of [`Camera`]. World coordinates are
//! taken as they are.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use imagesize::ImageError;
use serde_json::{Map, Value};

use crate::cameras::camera::{self, Camera, NEAR, View, checked_size, pose_of, whole_size};
use crate::cameras::json::{self, number, numbers, text};
use crate::cameras::lens::{Lens, PANORAMA};
use crate::cameras::nerfstudio::Placement;
use crate::cameras::photos::Finder;
use crate::error::{Error, Result};

/// The focal lengths in pixels, or else the fields of view in radians.
const FOCAL: [&str; 4] = ["fl_x", "fl_y", "camera_angle_x", "camera_angle_y"];
/// Coefficients of the lens in the orders of `FULL_OPENCV`, `OPENCV_FISHEYE` and `THIN_PRISM_FISHEYE`.
const OPENCV: [&str; 8] = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];
const FISHEYE: [&str; 4] = ["k1", "k2", "k3", "k4"];
const PRISM: [&str; 8] = ["k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"];
/// The last row of a pose is 0 0 0 1, to this.
const LAST_ROW: f64 = 1e-3;

/// The values of a frame, and those that the file states for all frames.
struct Values<'a> {
    own: &'a Map<String, Value>,
    all: &'a Map<String, Value>,
}

impl<'a> Values<'a> {
    /// The value of that name: the frame's, or else the file's.
    fn value(&self, name: &str) -> Option<&'a Value> {
        self.own.get(name).or_else(|| self.all.get(name))
    }

    /// The number of that name. Sizes are floats too, because instant-ngp writes `1080.0`.
    fn get(&self, name: &str) -> Option<f64> {
        let own = |name: &str| self.own.get(name).and_then(number);
        // A frame that states a focal length or a field of view inherits neither from the file.
        let complete = FOCAL.contains(&name) && FOCAL.iter().any(|n| own(n).is_some());
        let all = || self.all.get(name).and_then(number).filter(|_| !complete);
        own(name).or_else(all)
    }

    /// Whether instant-ngp's switch of that name is on.
    fn on(&self, name: &str) -> bool {
        let value = self.value(name);
        value.is_some_and(|v| v.as_bool().unwrap_or_else(|| number(v).is_some_and(|n| n != 0.0)))
    }

    /// The name of the lens model.
    fn model(&self) -> String {
        if self.on("is_fisheye") {
            return "OPENCV_FISHEYE".into();
        }
        if self.on("equirectangular") || self.on("latlong") {
            return PANORAMA.into();
        }
        if self.value("ftheta_p0").is_some() {
            return "FTHETA".into();
        }
        let named = self.value("camera_model").and_then(text);
        named.map_or_else(|| "OPENCV".into(), |name| name.trim().to_uppercase())
    }

    fn lens(&self) -> Option<Lens> {
        let value = |name: &str| self.get(name).unwrap_or(0.0);
        match &self.model()[..] {
            "PINHOLE" | "SIMPLE_PINHOLE" | "PERSPECTIVE" | "SIMPLE_RADIAL" | "RADIAL"
            | "OPENCV" | "FULL_OPENCV" => Lens::new("FULL_OPENCV", &OPENCV.map(value)),
            "OPENCV_FISHEYE"
            | "FISHEYE"
            | "SIMPLE_FISHEYE"
            | "SIMPLE_RADIAL_FISHEYE"
            | "RADIAL_FISHEYE" => Lens::new("OPENCV_FISHEYE", &FISHEYE.map(value)),
            "THIN_PRISM_FISHEYE" => Lens::new("THIN_PRISM_FISHEYE", &PRISM.map(value)),
            PANORAMA | "SPHERICAL" | "SPHERE" | "PANORAMA" => Lens::new(PANORAMA, &[]),
            other => Lens::new(other, &[]),
        }
    }
}

/// Reads the views from the bytes of a `transforms.json`, in file order. `file` is the path that the file would
/// have; the paths of the photos are relative to its folder.
///
/// [`Camera::name`] is the frame's `file_path` without a leading `./`, with `/` for the `\` of Windows; the photo is at
/// that path relative to the file's folder, or beside it with another extension (Blender scenes name none).
/// The focal length is `fl_x`, `fl_y`, else that of `camera_angle_x`, `camera_angle_y`; a missing `y` is the `x`. The
/// principal point is `cx`, `cy`, else the image's centre. A size that the file does not give is read from the photo. The
/// lens is that of `camera_model`, or of instant-ngp's switches (`is_fisheye`). A scale in a pose is divided out. With
/// nerfstudio's `dataparser_transforms.json` beside the file, the cameras are those of the models that nerfstudio exports.
///
/// # Errors
/// [`Error::Io`], [`Error::BadCamera`], [`Error::Malformed`], also for a photo without a size.
pub fn views_from_bytes(file: impl AsRef<Path>, bytes: &[u8]) -> Result<Vec<View>> {
    let file = file.as_ref();
    match json::parse(file, bytes)? {
        Value::Object(all) => views(file, &all, &mut Vec::new()),
        _ => Err(Error::malformed(file, "the file", "an object with frames expected")),
    }
}

/// The views of a parsed `transforms.json`.
pub(crate) fn views(
    file: &Path,
    all: &Map<String, Value>,
    notes: &mut Vec<String>,
) -> Result<Vec<View>> {
    let Some(Value::Array(frames)) = all.get("frames") else {
        return Err(Error::malformed(file, "frames", "a list of cameras expected"));
    };
    let placed = Placement::beside(file, all)?;
    let mut finder = Finder::default();
    let dir = file.parent().unwrap_or(Path::new(""));
    let of_frame = |(i, frame): (usize, &Value)| {
        let place = format!("frame {i}");
        let Value::Object(own) = frame else {
            return Err(Error::malformed(file, &place, "an object expected"));
        };
        let Some(path) = own.get("file_path").and_then(text) else {
            return Err(Error::malformed(
                file,
                &place,
                "it has no file_path, which names its photo",
            ));
        };
        let path = path.replace('\\', "/");
        let name = path.trim_start_matches("./");
        let image_path = finder.find_named(dir, name)?.unwrap_or_else(|| dir.join(name));
        let mut view = view(file, name, &Values { own, all }, image_path, notes)?;
        if let Some(placed) = &placed {
            view.camera = placed.camera(view.camera).checked(file)?;
        }
        Ok(view)
    };
    frames.iter().enumerate().map(of_frame).collect()
}

fn view(
    file: &Path,
    name: &str,
    values: &Values<'_>,
    image_path: PathBuf,
    notes: &mut Vec<String>,
) -> Result<View> {
    let lens = values.lens();
    let bad = |reason: String| camera::bad(file, name, reason);
    let (width, height) = size_of(file, name, values, &image_path)?;
    let (w, h) = (f64::from(width), f64::from(height));
    let of_angle = |angle: f64, size: f64| size / 2.0 / libm::tan(angle / 2.0);
    let of = |name: &str| values.get(name);
    // A panorama has no focal length in its file.
    let panorama = lens.as_ref().filter(|l| l.model == PANORAMA).map(|_| w / 2.0);
    let angle = ["camera_angle_x", "camera_angle_y"].into_iter().filter_map(of);
    let full = angle.into_iter().find(|&angle| angle >= std::f64::consts::TAU);
    if let (Some(angle), None) = (full, of("fl_x")) {
        let why = format!(
            "camera_angle_x is {angle}, more than a full turn in radians: it is in degrees"
        );
        return Err(bad(why));
    }
    let fx = of("fl_x").or(of("camera_angle_x").map(|a| of_angle(a, w))).or(panorama);
    let fy = of("fl_y").or(of("camera_angle_y").map(|a| of_angle(a, h))).or(fx);
    let (Some(fx), Some(fy)) = (fx.or(fy), fy) else {
        return Err(bad("no focal length: neither fl_x nor camera_angle_x is a number".into()));
    };
    let (matrix, centre) = pose(values.own.get("transform_matrix")).map_err(bad)?;
    let (rotation, translation) = pose_of(file, name, matrix, centre, notes)?;
    let (cx, cy) = (of("cx").unwrap_or(w / 2.0), of("cy").unwrap_or(h / 2.0));
    let name = name.to_owned();
    let camera =
        Camera { name, width, height, fx, fy, cx, cy, rotation, translation, lens, near: NEAR };
    Ok(View { camera: camera.checked(file)?, image_path })
}

/// World to camera, which may be scaled, and the camera's centre.
fn pose(matrix: Option<&Value>) -> Result<(DMat3, DVec3), String> {
    let Some(matrix) = matrix else { return Err("no transform_matrix, the camera's pose".into()) };
    let rows = numbers(matrix, 16).unwrap_or_default();
    let is_last = |row: [f64; 4]| {
        row.iter().zip([0.0, 0.0, 0.0, 1.0]).all(|(a, b)| (a - b).abs() <= LAST_ROW)
    };
    match *rows.as_slice() {
        [.., a, b, c, d] if rows.len() == 16 && !is_last([a, b, c, d]) => {
            let turned = is_last([rows[3], rows[7], rows[11], rows[15]]);
            return Err(match turned {
                true => {
                    "transform_matrix is transposed: its last column is 0 0 0 1, not its last row"
                }
                false => "transform_matrix is not a 4x4 pose: its last row is not 0 0 0 1",
            }
            .into());
        }
        [..] if ![12, 16].contains(&rows.len()) => {
            return Err(
                "transform_matrix is not a 4x4 pose: 3 or 4 rows of 4 numbers expected".into()
            );
        }
        _ => {}
    }
    // The rows of camera-to-world, with the camera's y and z axes negated, are the columns of
    // world-to-camera.
    let column = |k: usize| DVec3::new(rows[4 * k], -rows[4 * k + 1], -rows[4 * k + 2]);
    let centre = DVec3::new(rows[3], rows[7], rows[11]);
    Ok((DMat3::from_cols(column(0), column(1), column(2)), centre))
}

/// The size that the file states, else that of the photo.
fn size_of(file: &Path, name: &str, values: &Values<'_>, image_path: &Path) -> Result<(u32, u32)> {
    if ["w", "h"].iter().any(|n| values.get(n).is_none()) {
        let size = imagesize::size(image_path).map_err(|e| match e {
            ImageError::IoError(e) if e.kind() == ErrorKind::NotFound => camera::bad(
                file,
                name,
                format!(
                    "no size: w and h are not in the file, and the photo is not there ({})",
                    image_path.display()
                ),
            ),
            ImageError::IoError(e) if e.kind() != ErrorKind::UnexpectedEof => {
                Error::io(image_path, "read", e)
            }
            _ => {
                let reason = "not that of a whole PNG, JPEG or WebP, so its size is not known";
                Error::malformed(image_path, "image header", reason)
            }
        })?;
        return checked_size(image_path, name, size.width as u64, size.height as u64);
    }
    whole_size(file, name, ["w", "h"], |n| Ok(values.get(n).unwrap_or_default()))
}
