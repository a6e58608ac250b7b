//! Surfaces as unit squares: the charts that the sampler subdivides.

use glam::DVec3;

use super::furniture::{Object, Room};
use super::shape::Shape;

/// One chart of one object: a map from the unit square to a part of its surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    /// Index of the object in the room.
    pub(crate) object: usize,
    chart: Chart,
}

#[derive(Clone, Copy, Debug)]
enum Chart {
    /// A face of a box: `centre + (2u-1) a + (2v-1) b`, facing `normal`; local axes.
    Face { centre: DVec3, a: DVec3, b: DVec3, normal: DVec3 },
    /// A sixth of a ball: the face of the enclosing cube along `axis`, blown up.
    Sixth { radius: f64, axis: DVec3, a: DVec3, b: DVec3 },
    /// A quarter of a drum's side, starting at the given quarter turn.
    Side { radius: f64, height: f64, quarter: f64 },
    /// A drum's top.
    Top { radius: f64, height: f64 },
}

/// The six axis directions, each with two tangents.
const AXES: [(DVec3, DVec3, DVec3); 6] = [
    (DVec3::X, DVec3::Y, DVec3::Z),
    (DVec3::NEG_X, DVec3::Y, DVec3::Z),
    (DVec3::Y, DVec3::X, DVec3::Z),
    (DVec3::NEG_Y, DVec3::X, DVec3::Z),
    (DVec3::Z, DVec3::X, DVec3::Y),
    (DVec3::NEG_Z, DVec3::X, DVec3::Y),
];

/// All charts of the room.
pub(crate) fn patches(room: &Room) -> Vec<Patch> {
    let of = |(object, item): (usize, &Object)| {
        charts(item.shape).into_iter().map(move |chart| Patch { object, chart })
    };
    room.objects.iter().enumerate().flat_map(of).collect()
}

fn charts(shape: Shape) -> Vec<Chart> {
    let faces = |half: DVec3, facing: f64| {
        AXES.map(|(n, a, b)| Chart::Face {
            centre: n * half,
            a: a * half,
            b: b * half,
            normal: n * facing,
        })
        .to_vec()
    };
    match shape {
        Shape::Block { half, .. } => faces(half, 1.0),
        Shape::Inside { half, .. } => faces(half, -1.0),
        Shape::Ball { radius, .. } => {
            AXES.map(|(axis, a, b)| Chart::Sixth { radius, axis, a, b }).to_vec()
        }
        Shape::Drum { radius, height, .. } => {
            let side = |quarter| Chart::Side { radius, height, quarter };
            vec![side(0.0), side(1.0), side(2.0), side(3.0), Chart::Top { radius, height }]
        }
    }
}

impl Patch {
    /// World point and outward normal at chart coordinates in `[0, 1]^2`.
    pub(crate) fn at(&self, room: &Room, u: f64, v: f64) -> (DVec3, DVec3) {
        let (p, n) = self.chart.local(u, v);
        let shape = room.objects[self.object].shape;
        (shape.point_to_world(p), shape.direction_to_world(n))
    }

    /// Derivatives of the world point by `u` and `v`.
    pub(crate) fn derivatives(&self, room: &Room, u: f64, v: f64) -> (DVec3, DVec3) {
        let h = 1e-4;
        let at = |u, v| self.at(room, u, v).0;
        ((at(u + h, v) - at(u - h, v)) / (2.0 * h), (at(u, v + h) - at(u, v - h)) / (2.0 * h))
    }

    /// How many cells across and up the chart starts with, for cells of about `size` metres.
    pub(crate) fn grid(&self, room: &Room, size: f64) -> (u32, u32) {
        let (du, dv) = self.derivatives(room, 0.5, 0.5);
        let curved = !matches!(self.chart, Chart::Face { .. });
        let least = if curved { 3.0 } else { 1.0 };
        let count = |length: f64| (length / size).ceil().max(least) as u32;
        (count(du.length()), count(dv.length()))
    }
}

impl Chart {
    fn local(&self, u: f64, v: f64) -> (DVec3, DVec3) {
        let (s, t) = (2.0 * u - 1.0, 2.0 * v - 1.0);
        match *self {
            Self::Face { centre, a, b, normal } => (centre + a * s + b * t, normal),
            Self::Sixth { radius, axis, a, b } => {
                // The tangent warp makes cells of nearly equal size.
                let warp = |x: f64| libm::tan(x * std::f64::consts::FRAC_PI_4);
                let n = (axis + a * warp(s) + b * warp(t)).normalize();
                (n * radius, n)
            }
            Self::Side { radius, height, quarter } => {
                let angle = (quarter + u) * std::f64::consts::FRAC_PI_2;
                let n = DVec3::new(libm::cos(angle), libm::sin(angle), 0.0);
                (DVec3::new(n.x * radius, n.y * radius, v * height), n)
            }
            Self::Top { radius, height } => {
                let (x, y) = disc(s, t);
                (DVec3::new(x * radius, y * radius, height), DVec3::Z)
            }
        }
    }
}

/// The elliptical map of the square to the disc: smooth inside, unlike the concentric one.
fn disc(s: f64, t: f64) -> (f64, f64) {
    (s * (1.0 - t * t / 2.0).sqrt(), t * (1.0 - s * s / 2.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::room::shape::Ray;

    /// A ray fired at a chart's point from just outside must hit its own object there.
    #[test]
    fn chart_points_lie_on_their_objects() {
        let room = Room::furnished();
        for patch in patches(&room) {
            for (u, v) in [(0.5, 0.5), (0.21, 0.83), (0.9, 0.1)] {
                let (p, n) = patch.at(&room, u, v);
                let ray = Ray { origin: p + n * 0.001, direction: -n };
                let (t, normal) = room.objects[patch.object].shape.hit(&ray).unwrap();
                assert!((t - 0.001).abs() < 1e-6, "{patch:?} {t}");
                assert!((normal - n).length() < 1e-6, "{patch:?} {normal} {n}");
            }
        }
    }
}
