//! [`Camera`]: a pinhole view, and [`View`]: its photo.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use crate::cameras::lens::Lens;
use crate::error::{Error, Result};

/// Longest edge of an image, in pixels. It is the longest edge that a JPEG file can hold, and no
/// camera needs more.
const MAX_IMAGE_EDGE: u32 = 65_535;

/// Most pixels of an image. It is the limit of COLMAP, which computes the bytes of an RGB image,
/// `width * height * 3`, in a C++ `int` (`Bitmap` in `src/colmap/sensor/bitmap.cc`).
const MAX_IMAGE_PIXELS: u64 = i32::MAX as u64 / 3;

/// How far the product of a rotation and its transpose may be from the identity.
const ORTHONORMAL: f64 = 1e-3;

/// A pinhole camera. Camera axes are x right, y down, z forward (COLMAP and Inria).
///
/// A world point `p` has camera coordinates `rotation * p + translation`; a camera point
/// `(x, y, z)` falls on pixel coordinates `(fx x/z + cx, fy y/z + cy)`, where pixel centres
/// are at integer + 1/2.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Image file name as given in the camera file.
    pub name: String,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point x, pixels.
    pub cx: f64,
    /// Principal point y, pixels.
    pub cy: f64,
    /// World-to-camera rotation.
    pub rotation: DMat3,
    /// World-to-camera translation.
    pub translation: DVec3,
    /// The lens, if the photo is distorted. Everything else describes the camera without it.
    pub lens: Option<Lens>,
    /// Gaussians whose means are not farther than this along z are not drawn, world units. [`NEAR`] for the cameras of
    /// files; generated cameras have one that follows the model.
    pub near: f64,
}

/// The near plane of Inria's rasterizer, with which models are trained, world units.
pub const NEAR: f64 = 0.2;

impl Camera {
    /// The camera's centre in world coordinates.
    #[must_use]
    pub fn position(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// The field of view along the shorter edge of the image, degrees.
    #[must_use]
    pub fn narrow_angle(&self) -> f64 {
        let wide = self.width > self.height;
        let (edge, focal) = if wide { (self.height, self.fy) } else { (self.width, self.fx) };
        2.0 * libm::atan(0.5 * f64::from(edge) / focal).to_degrees()
    }

    /// A camera at `eye` that looks at `target`, with square pixels of focal length `focal` (in
    /// pixels) and its principal point at the image's centre. `up` is the world direction that is
    /// up in the image; if it is parallel to the viewing direction, another direction replaces it.
    #[must_use]
    pub fn looking_at(
        name: String,
        eye: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
        size: [u32; 2],
        focal: f64,
    ) -> Self {
        let eye = DVec3::from_array(eye);
        let forward = (DVec3::from_array(target) - eye).try_normalize().unwrap_or(DVec3::Z);
        let right = forward
            .cross(DVec3::from_array(up))
            .try_normalize()
            .unwrap_or_else(|| forward.any_orthonormal_vector());
        // Camera axes are rows: x right, y down, z forward.
        let down = forward.cross(right);
        let rotation = DMat3::from_cols(right, down, forward).transpose();
        Self {
            name,
            width: size[0],
            height: size[1],
            fx: focal,
            fy: focal,
            cx: 0.5 * f64::from(size[0]),
            cy: 0.5 * f64::from(size[1]),
            rotation,
            translation: -(rotation * eye),
            lens: None,
            near: NEAR,
        }
    }

    /// The same view of a scene whose means are relative to `origin`, which the camera's position is not.
    #[must_use]
    pub fn relative_to(self, origin: [f64; 3]) -> Self {
        let translation = self.translation + self.rotation * DVec3::from_array(origin);
        Self { translation, ..self }
    }

    /// What this camera sees of a model that is turned by 180 degrees about x is what the result sees of the model as it
    /// is: y and z change their signs between tools.
    #[must_use]
    pub fn of_turned_model(&self) -> Self {
        let turn = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        Self { rotation: self.rotation * turn, ..self.clone() }
    }

    /// True if the image has at most 65,535 pixels along an edge and 715,827,882 in all. Every camera that
    /// this crate reads is.
    #[must_use]
    pub fn image_fits(&self) -> bool {
        size_fits(self.width, self.height)
    }

    /// This camera if it is possible: a size that is not zero, positive focal lengths, finite
    /// numbers, and a rotation that is orthonormal to 1e-3 with determinant +1.
    ///
    /// `file` is for the message.
    ///
    /// # Errors
    /// [`Error::BadCamera`].
    pub fn checked(self, file: &Path) -> Result<Self> {
        let intrinsics = [self.fx, self.fy, self.cx, self.cy];
        let deviation = self.rotation * self.rotation.transpose() - DMat3::IDENTITY;
        let reason = if self.width == 0 || self.height == 0 {
            "image size is zero"
        } else if !intrinsics.iter().all(|v| v.is_finite()) {
            "focal length or principal point is not finite"
        } else if self.fx <= 0.0 || self.fy <= 0.0 {
            "focal length is not positive"
        } else if !self.lens.iter().flat_map(|l| &l.coefficients).all(|v| v.is_finite()) {
            "a lens coefficient is not finite"
        } else if !(self.near.is_finite() && self.near >= 0.0) {
            "near plane is not a number of at least 0"
        } else if !(self.rotation.is_finite() && self.translation.is_finite()) {
            "pose is not finite"
        } else if deviation.to_cols_array().iter().any(|d| d.abs() > ORTHONORMAL)
            || self.rotation.determinant() < 0.0
        {
            "pose is not a rotation"
        } else {
            return Ok(self);
        };
        Err(bad(file, self.name, reason))
    }

    /// The same view for a photo of another size: focal lengths and principal point scaled per
    /// axis. `None` if the photo's aspect ratio is not the camera's to within a pixel (it was
    /// cropped, or belongs to another camera).
    ///
    /// Inria's trainer keeps the field of view and takes the size from the photo; the Tanks and
    /// Temples scenes rely on it (cameras at full size, photos at half).
    #[must_use]
    pub fn scaled_to(&self, width: u32, height: u32) -> Option<Self> {
        let sx = f64::from(width) / f64::from(self.width);
        let sy = f64::from(height) / f64::from(self.height);
        let fits = |scale: f64| {
            (f64::from(self.width) * scale - f64::from(width)).abs() <= 1.0
                && (f64::from(self.height) * scale - f64::from(height)).abs() <= 1.0
        };
        if !(fits(sx) || fits(sy)) {
            return None;
        }
        Some(Self {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: self.cx * sx,
            cy: self.cy * sy,
            ..self.clone()
        })
    }

    /// The same view in at most `pixels` pixels, of the same shape to within a pixel.
    #[must_use]
    pub fn within(&self, pixels: u32) -> Self {
        let own = f64::from(self.width) * f64::from(self.height);
        let factor = (f64::from(pixels) / own).sqrt().min(1.0);
        let edge = |edge: u32| ((f64::from(edge) * factor) as u32).max(1);
        self.scaled_to(edge(self.width), edge(self.height)).unwrap_or_else(|| self.clone())
    }
}

/// One posed photo.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Where the photo was taken from.
    pub camera: Camera,
    /// Where the photo is expected. It may be missing: see [`View::has_photo`].
    pub image_path: PathBuf,
}

impl View {
    /// True if the photo is there.
    #[must_use]
    pub fn has_photo(&self) -> bool {
        self.image_path.is_file()
    }
}

/// True if an image is within both limits.
fn size_fits(width: u32, height: u32) -> bool {
    width.max(height) <= MAX_IMAGE_EDGE && u64::from(width) * u64::from(height) <= MAX_IMAGE_PIXELS
}

/// The width and height that a file states, if images may have that size. `view` and `file` are for
/// the message.
pub(crate) fn checked_size(file: &Path, view: &str, width: u64, height: u64) -> Result<(u32, u32)> {
    match (u32::try_from(width), u32::try_from(height)) {
        (Ok(w), Ok(h)) if size_fits(w, h) => Ok((w, h)),
        _ => {
            let reason = format!(
                "an image of {width} x {height} pixels is too large: at most {MAX_IMAGE_EDGE} along an \
                 edge and {MAX_IMAGE_PIXELS} in all"
            );
            Err(bad(file, view, reason))
        }
    }
}

/// Rotations that files with few digits hold are off by less than this.
const ROUNDED: f64 = 0.02;

/// The rotation in a matrix that may scale too, and its scale. A matrix that is a rotation stays as it is.
///
/// # Errors
/// Why it is no pose.
fn rotation_in(matrix: DMat3) -> Result<(DMat3, f64), String> {
    let lengths = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(DVec3::length);
    let [least, most] = [f64::min, f64::max].map(|of| lengths.into_iter().fold(lengths[0], of));
    if !(matrix.is_finite() && least > 0.0 && most <= (1.0 + ROUNDED) * least) {
        let [x, y, z] = lengths;
        return Err(format!("pose is not a rotation: its axes are {x:.3}, {y:.3} and {z:.3} long"));
    }
    if matrix.determinant() < 0.0 {
        return Err("pose is not a rotation: it is mirrored".into());
    }
    let off = |m: DMat3| {
        let deviation = m * m.transpose() - DMat3::IDENTITY;
        deviation.to_cols_array().into_iter().fold(0.0, |most: f64, d| most.max(d.abs()))
    };
    if off(matrix) <= ORTHONORMAL {
        return Ok((matrix, 1.0));
    }
    let scale = lengths.iter().sum::<f64>() / 3.0;
    let scale = if (scale - 1.0).abs() <= ROUNDED { 1.0 } else { scale };
    let mut rotation = matrix * (1.0 / scale);
    let rounded = off(rotation);
    if rounded > 2.0 * ROUNDED {
        return Err("pose is not a rotation: its axes are not perpendicular".into());
    }
    if rounded > ORTHONORMAL {
        let x = rotation.x_axis.normalize();
        let y = (rotation.y_axis - x * x.dot(rotation.y_axis)).normalize();
        rotation = DMat3::from_cols(x, y, x.cross(y));
    }
    Ok((rotation, scale))
}

/// The width and height that `value` gives by their names, which may be floats.
pub(crate) fn whole_size(
    file: &Path,
    view: &str,
    names: [&str; 2],
    value: impl Fn(&str) -> Result<f64>,
) -> Result<(u32, u32)> {
    let [w, h] = [value(names[0])?, value(names[1])?];
    if [w, h].iter().any(|v| v.fract() != 0.0 || *v < 0.0) {
        let [w, h] = names;
        return Err(bad(file, view, format!("{w} or {h} is not a whole number of pixels")));
    }
    // The casts saturate.
    checked_size(file, view, w as u64, h as u64)
}

/// The pose, world to camera, of a camera with this centre and this matrix. A scale in the matrix is divided out, with a
/// note for the first camera that has one.
pub(crate) fn pose_of(
    file: &Path,
    view: &str,
    matrix: DMat3,
    centre: DVec3,
    notes: &mut Vec<String>,
) -> Result<(DMat3, DVec3)> {
    let (rotation, scale) = rotation_in(matrix).map_err(|reason| bad(file, view, reason))?;
    if scale != 1.0 && notes.is_empty() {
        notes.push(format!(
            "{}: the poses have a scale of {scale:.4}, which is divided out",
            file.display()
        ));
    }
    Ok((rotation, -(rotation * centre)))
}

/// The error about an impossible camera.
pub(crate) fn bad(file: &Path, view: impl Into<String>, reason: impl Into<String>) -> Error {
    Error::BadCamera { file: file.into(), view: view.into(), reason: reason.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(width: u32, height: u32) -> Camera {
        Camera {
            name: "a".into(),
            width,
            height,
            fx: 100.0,
            fy: 90.0,
            cx: f64::from(width) / 2.0,
            cy: f64::from(height) / 2.0,
            rotation: DMat3::IDENTITY,
            translation: DVec3::ZERO,
            lens: None,
            near: NEAR,
        }
    }

    #[test]
    fn image_sizes_beyond_the_limits_do_not_fit() {
        assert!(camera(65_535, 10_922).image_fits() && camera(10_922, 65_535).image_fits());
        assert!(!camera(65_536, 1).image_fits() && !camera(1, 65_536).image_fits());
        assert!(camera(26_754, 26_754).image_fits() && !camera(26_756, 26_756).image_fits());
        assert!(!camera(100_000, 100_000).image_fits() && !camera(u32::MAX, u32::MAX).image_fits());
    }

    #[test]
    fn half_size_photos_keep_the_field_of_view() {
        // The sizes of Truck.
        let half = camera(1957, 1091).scaled_to(979, 546).unwrap();
        assert_eq!((half.width, half.height, half.cx, half.cy), (979, 546, 489.5, 273.0));
        assert!((half.fx / 979.0 - 100.0 / 1957.0).abs() < 1e-12);
        assert!((half.fy / 546.0 - 90.0 / 1091.0).abs() < 1e-12);
        let same = camera(640, 480).scaled_to(640, 480).unwrap();
        assert_eq!(same, camera(640, 480));
    }

    #[test]
    fn a_camera_looks_where_it_is_told() {
        for (eye, up) in [([3.0, -1.0, 2.0], [0.0, -1.0, 0.0]), ([0.0, 5.0, 0.0], [0.0, 1.0, 0.0])]
        {
            let target = [0.0, 0.5, 0.0];
            let c = Camera::looking_at("a".into(), eye, target, up, [64, 48], 50.0)
                .checked(Path::new("-"))
                .unwrap();
            assert!((c.position() - DVec3::from_array(eye)).length() < 1e-12);
            let seen = c.rotation * DVec3::from_array(target) + c.translation;
            assert!(seen.truncate().length() < 1e-12 && seen.z > 0.0, "{seen}");
            // Up in the world is up in the image, where y points down.
            assert!((c.rotation * DVec3::from_array(up)).y <= 1e-12);
        }
    }

    #[test]
    fn another_aspect_ratio_is_refused() {
        assert_eq!(camera(640, 480).scaled_to(480, 640), None);
        assert_eq!(camera(640, 480).scaled_to(320, 200), None);
    }

    #[test]
    fn a_large_camera_fits_into_so_many_pixels_and_sees_the_same() {
        for (width, height) in [(1000, 750), (999, 751), (100_000, 11), (11, 100_000)] {
            let large = camera(width, height);
            let small = large.within(250_000);
            assert!(small.width * small.height <= 250_000, "{width}x{height}");
            let angle = |c: &Camera| [f64::from(c.width) / c.fx, f64::from(c.height) / c.fy];
            for (a, b) in angle(&large).into_iter().zip(angle(&small)) {
                assert!((a / b - 1.0).abs() < 1e-9, "{width}x{height}");
            }
        }
        assert_eq!(camera(500, 500).within(250_000), camera(500, 500));
    }
}
