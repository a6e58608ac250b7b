//! COLMAP sparse models: `cameras`, `images` and `points3D`, binary or text.
//!
//! The images must be undistorted: only the camera models `PINHOLE` and `SIMPLE_PINHOLE` are
//! taken. COLMAP's convention is that of [`Camera`]: x right, y down, z forward, world to
//! camera, pixel centres at integer + 1/2.

mod binary;
mod text;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::fs;

/// A point of the sparse reconstruction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SfmPoint {
    /// Position, world units.
    pub position: [f64; 3],
    /// Colour, 0 to 255.
    pub rgb: [u8; 3],
    /// Mean reprojection error, pixels.
    pub error: f64,
}

/// True if `dir` holds a sparse model: `cameras` and `images`, `.bin` or `.txt`.
#[must_use]
pub fn is_model(dir: impl AsRef<Path>) -> bool {
    let dir = dir.as_ref();
    ["bin", "txt"].iter().any(|e| {
        dir.join("cameras").with_extension(e).is_file()
            && dir.join("images").with_extension(e).is_file()
    })
}

/// Reads the posed images of the sparse model in `dir` (say `sparse/0`), in file order.
///
/// [`Camera::name`] is the image's path relative to the images folder.
///
/// # Errors
/// [`Error::Io`], [`Error::ColmapTruncated`], [`Error::ColmapLine`]; [`Error::DistortedCamera`]
/// or [`Error::UnknownCameraModel`] for a camera that an image uses; [`Error::UnknownCamera`],
/// [`Error::DuplicateView`], [`Error::BadCamera`].
pub fn read_cameras(dir: impl AsRef<Path>) -> Result<Vec<Camera>> {
    let dir = dir.as_ref();
    let (cameras_file, form) = choose(dir, "cameras");
    let cameras = cameras(&cameras_file, &fs::read(&cameras_file)?, form)?;
    let (images_file, form) = choose(dir, "images");
    let images = images(&images_file, &fs::read(&images_file)?, form)?;
    posed(&cameras_file, cameras, &images_file, images)
}

/// Reads the posed images from the bytes of a `cameras` and an `images` file of one form.
///
/// # Errors
/// As [`read_cameras`]; the files in the errors are `<cameras>` and `<images>`.
pub fn cameras_from_bytes(
    cameras_file: &[u8],
    images_file: &[u8],
    form: Form,
) -> Result<Vec<Camera>> {
    let names = [Path::new("<cameras>"), Path::new("<images>")];
    let cameras = cameras(names[0], cameras_file, form)?;
    let images = images(names[1], images_file, form)?;
    posed(names[0], cameras, names[1], images)
}

fn cameras(file: &Path, bytes: &[u8], form: Form) -> Result<Vec<Intrinsics>> {
    match form {
        Form::Binary => binary::cameras(file, bytes),
        Form::Text => text::cameras(file, bytes),
    }
}

fn images(file: &Path, bytes: &[u8], form: Form) -> Result<Vec<Image>> {
    match form {
        Form::Binary => binary::images(file, bytes),
        Form::Text => text::images(file, bytes),
    }
}

/// Each image with the intrinsics of its camera.
fn posed(
    cameras_file: &Path,
    cameras: Vec<Intrinsics>,
    images_file: &Path,
    images: Vec<Image>,
) -> Result<Vec<Camera>> {
    let mut by_id = BTreeMap::new();
    for camera in cameras {
        let id = camera.id;
        if by_id.insert(id, camera).is_some() {
            let name = id.to_string();
            let file = cameras_file.into();
            return Err(Error::DuplicateView { file, what: "camera", name });
        }
    }
    images
        .into_iter()
        .map(|image| match by_id.get(&image.camera) {
            Some(camera) => pose(cameras_file, images_file, camera, image),
            None => {
                let (image, camera) = (image.name, image.camera);
                Err(Error::UnknownCamera { file: images_file.into(), image, camera })
            }
        })
        .collect()
}

/// Reads the points of the sparse model in `dir`, in file order.
///
/// # Errors
/// [`Error::Io`], [`Error::ColmapTruncated`], [`Error::ColmapLine`].
pub fn read_points(dir: impl AsRef<Path>) -> Result<Vec<SfmPoint>> {
    let (file, form) = choose(dir.as_ref(), "points3D");
    points(&file, &fs::read(&file)?, form)
}

/// Reads the points from the bytes of a `points3D` file.
///
/// # Errors
/// As [`read_points`]; the file in the errors is `<points3D>`.
pub fn points_from_bytes(bytes: &[u8], form: Form) -> Result<Vec<SfmPoint>> {
    points(Path::new("<points3D>"), bytes, form)
}

fn points(file: &Path, bytes: &[u8], form: Form) -> Result<Vec<SfmPoint>> {
    match form {
        Form::Binary => binary::points(file, bytes),
        Form::Text => text::points(file, bytes),
    }
}

/// How a file of a sparse model is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// `.bin`: little-endian, packed.
    Binary,
    /// `.txt`: words separated by white space.
    Text,
}

/// The text file if it is the only one there; else the binary one, present or not.
fn choose(dir: &Path, stem: &str) -> (PathBuf, Form) {
    let (binary, text) = (dir.join(format!("{stem}.bin")), dir.join(format!("{stem}.txt")));
    if !binary.is_file() && text.is_file() { (text, Form::Text) } else { (binary, Form::Binary) }
}

/// A row of the cameras file.
struct Intrinsics {
    id: u32,
    model: Model,
    width: u64,
    height: u64,
    params: Vec<f64>,
}

/// A row of the images file.
struct Image {
    name: String,
    camera: u32,
    /// World to camera, w first.
    rotation: [f64; 4],
    translation: [f64; 3],
}

/// COLMAP's camera models: name and number of parameters, at the index that is their id.
const MODELS: [(&str, usize); 12] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

/// A camera model, as its index in [`MODELS`].
#[derive(Clone, Copy)]
struct Model(usize);

impl Model {
    fn name(self) -> &'static str {
        MODELS[self.0].0
    }

    fn params(self) -> usize {
        MODELS[self.0].1
    }
}

fn pose(
    cameras_file: &Path,
    images_file: &Path,
    intrinsics: &Intrinsics,
    image: Image,
) -> Result<Camera> {
    let (fx, fy, cx, cy) = match (intrinsics.model.name(), intrinsics.params.as_slice()) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => (f, f, cx, cy),
        ("PINHOLE", &[fx, fy, cx, cy]) => (fx, fy, cx, cy),
        (model, _) => {
            let (camera, model) = (intrinsics.id.to_string(), model.to_owned());
            return Err(Error::DistortedCamera { file: cameras_file.into(), camera, model });
        }
    };
    let bad = |reason| {
        let view = format!("camera {}", intrinsics.id);
        Error::BadCamera { file: cameras_file.into(), view, reason }
    };
    let size = |v: u64| u32::try_from(v).map_err(|_| bad("image size above 2^32"));
    let (width, height) = (size(intrinsics.width)?, size(intrinsics.height)?);

    let [w, x, y, z] = image.rotation;
    // COLMAP writes unit quaternions, in text with few digits: normalised like COLMAP does.
    let length = (w * w + x * x + y * y + z * z).sqrt();
    if !length.is_normal() {
        let (file, view) = (images_file.into(), image.name);
        return Err(Error::BadCamera { file, view, reason: "quaternion has no direction" });
    }
    let rotation =
        DMat3::from_quat(DQuat::from_xyzw(x / length, y / length, z / length, w / length));
    let translation = DVec3::from_array(image.translation);
    Camera { name: image.name, width, height, fx, fy, cx, cy, rotation, translation }
        .checked(images_file)
}
