//! [`Camera`]: a pinhole view.

use glam::{DMat3, DVec3};

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
}
