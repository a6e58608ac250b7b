//! [`Ring`] and [`Placement`]: cameras on a circle.

use glam::DVec3;
use gs_model::Camera;

use super::{Constraints, SIZE};

/// A circle of cameras that look at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring {
    /// The point.
    pub centre: DVec3,
    /// A direction of length 1.
    pub up: DVec3,
    /// From the centre to the cameras.
    pub radius: f64,
    /// Above the horizon, degrees.
    pub elevation: f64,
}

/// The near plane of a camera over its distance to the centre: nothing depends on the unit of the model.
const NEAR: f64 = 0.05;

impl Ring {
    /// A camera at `turn` (in turns) around the circle.
    #[must_use]
    pub fn camera(&self, name: String, turn: f64, size: [u32; 2], focal: f64) -> Camera {
        let angle = std::f64::consts::TAU * turn;
        let (right, ahead) = horizon(self.up);
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        let raised = self.elevation.to_radians();
        let (out, up) = (self.radius * libm::cos(raised), self.radius * libm::sin(raised));
        let eye = self.centre + out * (cos * right + sin * ahead) + up * self.up;
        let [eye, centre, up] = [eye, self.centre, self.up].map(|v| v.to_array());
        let camera = Camera::looking_at(name, eye, centre, up, size, focal);
        Camera { near: NEAR * self.radius, ..camera }
    }
}

/// Two directions at right angles to `up` and to each other.
fn horizon(up: DVec3) -> (DVec3, DVec3) {
    // The axis after the one that is most nearly up.
    let most = (0..3).max_by(|&a, &b| up[a].abs().total_cmp(&up[b].abs())).unwrap_or(1);
    let axis = DVec3::AXES[(most + 1) % 3];
    let right = (axis - up * axis.dot(up)).normalize();
    (right, up.cross(right))
}

/// A circle, and the part of it from which the model is seen well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The circle.
    pub ring: Ring,
    /// Where the best camera is, in turns.
    pub best: f64,
    /// First and last place, in turns; `None` if the whole circle will do.
    pub arc: Option<[f64; 2]>,
}

impl Placement {
    /// Where `n` cameras stand, in turns: the best one first, then around the circle, or to the ends of the
    /// arc and back.
    #[must_use]
    pub fn places(&self, n: u32) -> Vec<f64> {
        let step = |i: u32| f64::from(i) / f64::from(n);
        let Some([first, last]) = self.arc else {
            return (0..n).map(|i| self.best + step(i)).collect();
        };
        let (ahead, back) = (last - self.best, self.best - first);
        let way = 2.0 * (ahead + back);
        let along = |s: f64| match s {
            s if s <= ahead => self.best + s,
            s if s <= 2.0 * ahead + back => last - (s - ahead),
            s => first + (s - 2.0 * ahead - back),
        };
        (0..n).map(|i| along(way * step(i))).collect()
    }

    /// The first camera of [`Placement::cameras`], of the size and the field of view that callers have by default.
    #[must_use]
    pub fn first(&self) -> Camera {
        let focal = 0.5 * f64::from(SIZE[0]) / Constraints::default().tangents[0];
        self.ring.camera("first".into(), self.best, SIZE, focal)
    }

    /// `n` cameras, at [`Placement::places`]. Their names are `name` and a number. `focal` is in pixels.
    #[must_use]
    pub fn cameras(&self, n: u32, name: &str, size: [u32; 2], focal: f64) -> Vec<Camera> {
        let places = self.places(n).into_iter().enumerate();
        places
            .map(|(i, turn)| self.ring.camera(format!("{name}-{i:04}"), turn, size, focal))
            .collect()
    }
}
