//! [`Camera`]: a pinhole view.

use std::path::Path;

use glam::{DMat3, DVec3};

use crate::error::{Error, Result};

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
}

impl Camera {
    /// The camera's centre in world coordinates.
    #[must_use]
    pub fn position(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// This camera if it can be one: a size, positive focal lengths, finite numbers, and a
    /// rotation that is orthonormal to 1e-3 with determinant +1.
    ///
    /// `file` is for the message.
    pub(crate) fn checked(self, file: &Path) -> Result<Self> {
        let intrinsics = [self.fx, self.fy, self.cx, self.cy];
        let deviation = self.rotation * self.rotation.transpose() - DMat3::IDENTITY;
        let reason = if self.width == 0 || self.height == 0 {
            "image size is zero"
        } else if !intrinsics.iter().all(|v| v.is_finite()) {
            "focal length or principal point is not finite"
        } else if self.fx <= 0.0 || self.fy <= 0.0 {
            "focal length is not positive"
        } else if !(self.rotation.is_finite() && self.translation.is_finite()) {
            "pose is not finite"
        } else if deviation.to_cols_array().iter().any(|d| d.abs() > 1e-3)
            || self.rotation.determinant() < 0.0
        {
            "pose is not a rotation"
        } else {
            return Ok(self);
        };
        Err(Error::BadCamera { file: file.into(), view: self.name, reason })
    }
}
