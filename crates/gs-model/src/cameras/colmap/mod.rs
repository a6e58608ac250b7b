//! COLMAP sparse models: `cameras`, `images` and `points3D`, binary or text.
//!
//! Models with lens distortion are read as pinhole cameras with a [`Lens`]. COLMAP's convention is that of
//! [`Camera`]: x right, y down, z forward, world to camera, pixel centres at integer + 1/2.

mod binary;
mod entries;
mod text;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

pub use entries::Point;
use entries::{Intrinsics, PosedImage};

use crate::cameras::camera::{self, Camera, NEAR, checked_size};
use crate::cameras::lens::Lens;
use crate::error::{Error, Result};
use crate::fs;

/// Which of the files of a sparse model, `cameras` and `images`, `.bin` or `.txt`, are in a folder.
pub(crate) fn parts(dir: &Path) -> [bool; 2] {
    ["cameras", "images"].map(|stem| {
        ["bin", "txt"].iter().any(|extension| dir.join(stem).with_extension(extension).is_file())
    })
}

/// Reads the posed images of the sparse model in `dir` (say `sparse/0`), in file order.
///
/// [`Camera::name`] is the image's path relative to the images folder.
///
/// # Errors
/// [`Error::Io`], [`Error::Truncated`], [`Error::Malformed`], [`Error::BadCamera`].
pub fn read_cameras(dir: impl AsRef<Path>) -> Result<Vec<Camera>> {
    let dir = dir.as_ref();
    let [(cameras_file, cameras_form), (images_file, images_form)] =
        ["cameras", "images"].map(|stem| choose(dir, stem));
    let cameras = cameras(&cameras_file, &fs::read(&cameras_file)?, cameras_form)?;
    let images = images(&images_file, &fs::read(&images_file)?, images_form)?;
    with_intrinsics([&cameras_file, &images_file], cameras, images)
}

/// Reads the posed images from the bytes of a `cameras` and an `images` file of the same form.
///
/// # Errors
/// As [`read_cameras`]; the files in the errors are `<cameras>` and `<images>`.
pub fn cameras_from_bytes(
    cameras_file: &[u8],
    images_file: &[u8],
    form: Form,
) -> Result<Vec<Camera>> {
    let files = [Path::new("<cameras>"), Path::new("<images>")];
    let cameras = cameras(files[0], cameras_file, form)?;
    let images = images(files[1], images_file, form)?;
    with_intrinsics(files, cameras, images)
}

/// Reads the points of the sparse model in `dir`, in file order.
///
/// # Errors
/// [`Error::Io`], [`Error::Truncated`], [`Error::Malformed`]; `Malformed` too if there is no point, or a coordinate is not
/// finite.
pub fn read_points(dir: impl AsRef<Path>) -> Result<Vec<Point>> {
    let (file, form) = choose(dir.as_ref(), "points3D");
    let bytes = fs::read(&file)?;
    let points = match form {
        Form::Binary => binary::points(&file, &bytes)?,
        Form::Text => text::points(&file, &fs::text(&bytes))?,
    };
    let finite = |p: &Point| p.position.iter().all(|v| v.is_finite());
    if let Some(i) = points.iter().position(|p| !finite(p)) {
        return Err(Error::malformed(&file, &format!("point {i}"), "its position is not finite"));
    }
    if points.is_empty() {
        return Err(Error::malformed(&file, "the list of points", "it is empty"));
    }
    Ok(points)
}

fn cameras(file: &Path, bytes: &[u8], form: Form) -> Result<Vec<Intrinsics>> {
    match form {
        Form::Binary => binary::cameras(file, bytes),
        Form::Text => text::cameras(file, &fs::text(bytes)),
    }
}

fn images(file: &Path, bytes: &[u8], form: Form) -> Result<Vec<PosedImage>> {
    match form {
        Form::Binary => binary::images(file, bytes),
        Form::Text => text::images(file, &fs::text(bytes)),
    }
}

/// Each image with the intrinsics of its camera; `files` are those of cameras and images.
fn with_intrinsics(
    files: [&Path; 2],
    cameras: Vec<Intrinsics>,
    images: Vec<PosedImage>,
) -> Result<Vec<Camera>> {
    let mut by_id = BTreeMap::new();
    for camera in cameras {
        let place = format!("camera {}", camera.id);
        if by_id.insert(camera.id, camera).is_some() {
            return Err(Error::malformed(files[0], &place, "it is there twice"));
        }
    }
    images
        .into_iter()
        .map(|image| match by_id.get(&image.camera) {
            Some(camera) => posed(files, camera, image),
            None => {
                let camera = image.camera;
                let reason = format!("it names camera {camera}, which is not in the cameras file");
                Err(Error::malformed(files[1], &format!("image {:?}", image.name), reason))
            }
        })
        .collect()
}

/// How a file of a sparse model is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// `.bin`: little-endian, packed.
    Binary,
    /// `.txt`: words separated by white space.
    Text,
}

/// The text file if only that one exists; else the binary one, even if it does not exist.
fn choose(dir: &Path, stem: &str) -> (PathBuf, Form) {
    let (binary, text) = (dir.join(format!("{stem}.bin")), dir.join(format!("{stem}.txt")));
    if !binary.is_file() && text.is_file() { (text, Form::Text) } else { (binary, Form::Binary) }
}

/// An image with the intrinsics of its camera.
fn posed(
    [cameras_file, images_file]: [&Path; 2],
    intrinsics: &Intrinsics,
    image: PosedImage,
) -> Result<Camera> {
    let Intrinsics { id, model, width, height, ref params } = *intrinsics;
    let view = format!("camera {id}");
    let (w, h) = (width as f64, height as f64);
    let (fx, fy, cx, cy, bent) = match (model.focal_lengths(), params.as_slice()) {
        (0, _) => (w / 2.0, w / 2.0, w / 2.0, h / 2.0, &[][..]),
        (1, &[f, cx, cy, ref bent @ ..]) => (f, f, cx, cy, bent),
        (_, &[fx, fy, cx, cy, ref bent @ ..]) => (fx, fy, cx, cy, bent),
        _ => return Err(camera::bad(cameras_file, view, "too few parameters")),
    };
    let (width, height) = checked_size(cameras_file, &view, width, height)?;

    let [w, x, y, z] = image.rotation;
    // COLMAP writes unit quaternions, in text files with few digits, and normalises what it reads.
    let length = (w * w + x * x + y * y + z * z).sqrt();
    if !length.is_normal() {
        return Err(camera::bad(images_file, image.name, "quaternion has no direction"));
    }
    let rotation =
        DMat3::from_quat(DQuat::from_xyzw(x / length, y / length, z / length, w / length));
    let translation = DVec3::from_array(image.translation);
    let lens = Lens::new(model.name(), bent);
    // Windows tools.
    let name = image.name.replace('\\', "/");
    Camera { name, width, height, fx, fy, cx, cy, rotation, translation, lens, near: NEAR }
        .checked(images_file)
}
