//! The room: what stands where, of which material.

use glam::DVec3;

use super::paint::Paint;
use super::shape::{HALF, Ray, Shape};

/// The lamp: a rectangle of the ceiling, half extents in x and y.
pub(crate) const LAMP_HALF: (f64, f64) = (0.9, 0.6);
/// Radiance of the lamp, linear RGB.
pub(crate) const LAMP_RADIANCE: DVec3 = DVec3::new(13.0, 12.2, 11.0);

/// Reflection at the surface coat: a Phong lobe under Schlick's Fresnel term.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gloss {
    /// Reflectance at normal incidence.
    pub(crate) f0: f64,
    /// Phong exponent; larger is sharper.
    pub(crate) exponent: f64,
}

/// One thing in the room.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Object {
    pub(crate) shape: Shape,
    pub(crate) paint: Paint,
    pub(crate) gloss: Option<Gloss>,
}

/// Where a ray meets the room.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    pub(crate) object: usize,
    pub(crate) distance: f64,
    pub(crate) point: DVec3,
    pub(crate) normal: DVec3,
}

/// The whole room.
#[derive(Clone, Debug)]
pub(crate) struct Room {
    pub(crate) objects: Vec<Object>,
    bounds: Vec<Option<(DVec3, f64)>>,
}

impl Room {
    /// The furnished room.
    pub(crate) fn furnished() -> Self {
        let mut objects = Vec::new();
        shell(&mut objects);
        table(&mut objects);
        shelf(&mut objects);
        corner(&mut objects);
        pictures(&mut objects);
        let bounds = objects.iter().map(|o| o.shape.bound()).collect();
        Self { objects, bounds }
    }

    /// The nearest hit of a ray. The room is closed, so `None` only for rays from outside.
    pub(crate) fn hit(&self, ray: &Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for (object, item) in self.objects.iter().enumerate() {
            if let Some(bound) = self.bounds[object]
                && !near(bound, ray, best.map_or(f64::INFINITY, |b| b.distance))
            {
                continue;
            }
            if let Some((distance, normal)) = item.shape.hit(ray)
                && best.is_none_or(|b| distance < b.distance)
            {
                best = Some(Hit { object, distance, point: DVec3::ZERO, normal });
            }
        }
        best.map(|b| Hit { point: ray.at(b.distance), ..b })
    }

    /// True if nothing but the room's shell stands between `from` and `to`.
    pub(crate) fn clear(&self, from: DVec3, to: DVec3) -> bool {
        let gap = to - from;
        let length = gap.length();
        let ray = Ray { origin: from, direction: gap / length };
        let limit = length - 1e-4;
        !self.objects.iter().zip(&self.bounds).any(|(item, bound)| {
            bound.is_some_and(|b| near(b, &ray, limit))
                && item.shape.hit(&ray).is_some_and(|(t, _)| t < limit)
        })
    }

    /// True if the point of the shell lies on the lamp.
    pub(crate) fn on_lamp(&self, hit: &Hit) -> bool {
        matches!(self.objects[hit.object].shape, Shape::Inside { .. })
            && hit.normal.z < -0.5
            && hit.point.x.abs() <= LAMP_HALF.0
            && hit.point.y.abs() <= LAMP_HALF.1
    }
}

/// Can the ray touch the ball before distance `limit`?
fn near((centre, radius): (DVec3, f64), ray: &Ray, limit: f64) -> bool {
    let o = centre - ray.origin;
    let along = o.dot(ray.direction);
    along + radius > 0.0
        && along - radius < limit
        && o.length_squared() - along * along <= radius * radius * 1.000_001
}

fn gloss(f0: f64, exponent: f64) -> Option<Gloss> {
    Some(Gloss { f0, exponent })
}

fn block(centre: [f64; 3], half: [f64; 3], degrees: f64) -> Shape {
    let angle = degrees.to_radians();
    Shape::Block {
        centre: DVec3::from(centre),
        half: DVec3::from(half),
        turn: (libm::cos(angle), libm::sin(angle)),
    }
}

fn ball(centre: [f64; 3], radius: f64) -> Shape {
    Shape::Ball { centre: DVec3::from(centre), radius }
}

fn drum(base: [f64; 3], radius: f64, height: f64) -> Shape {
    Shape::Drum { base: DVec3::from(base), radius, height }
}

fn shell(out: &mut Vec<Object>) {
    out.push(Object {
        shape: Shape::Inside { centre: DVec3::new(0.0, 0.0, HALF.z), half: HALF },
        paint: Paint::Walls,
        gloss: gloss(0.03, 25.0),
    });
    // The rug.
    out.push(Object {
        shape: block([0.0, 0.0, 0.011], [1.45, 1.15, 0.01], 8.0),
        paint: Paint::Rug,
        gloss: None,
    });
}

fn table(out: &mut Vec<Object>) {
    let wood = Paint::Plain(0x9c6b3f);
    let turn = 8.0;
    let (c, s) = (libm::cos(8f64.to_radians()), libm::sin(8f64.to_radians()));
    out.push(Object {
        shape: block([0.0, 0.0, 0.66], [0.72, 0.46, 0.03], turn),
        paint: Paint::Wood,
        gloss: gloss(0.05, 40.0),
    });
    for (x, y) in [(-0.64, -0.38), (0.64, -0.38), (-0.64, 0.38), (0.64, 0.38)] {
        out.push(Object {
            shape: block([c * x - s * y, s * x + c * y, 0.325], [0.04, 0.04, 0.304], turn),
            paint: wood,
            gloss: gloss(0.04, 30.0),
        });
    }
    out.extend([
        Object {
            shape: ball([-0.38, 0.06, 0.87], 0.18),
            paint: Paint::Plain(0xc8322a),
            gloss: gloss(0.06, 60.0),
        },
        Object {
            shape: ball([0.02, -0.22, 0.79], 0.10),
            paint: Paint::Plain(0xe9c46a),
            gloss: gloss(0.35, 45.0),
        },
        Object {
            shape: drum([0.33, 0.12, 0.69], 0.12, 0.34),
            paint: Paint::Bands(0x2a6f97, 0xe8eef2),
            gloss: gloss(0.06, 50.0),
        },
        Object {
            shape: block([0.02, 0.22, 0.77], [0.09, 0.09, 0.08], 30.0),
            paint: Paint::Checker(0xf1faee, 0x457b9d, 0.06),
            gloss: gloss(0.04, 30.0),
        },
        Object {
            shape: ball([0.02, 0.22, 0.915], 0.065),
            paint: Paint::Plain(0x6a994e),
            gloss: gloss(0.08, 80.0),
        },
    ]);
}

fn shelf(out: &mut Vec<Object>) {
    let board = Paint::Plain(0xd9cbb2);
    let x = 2.72;
    for z in [0.03, 0.60, 1.17] {
        out.push(Object {
            shape: block([x, 0.3, z], [0.27, 0.95, 0.03], 0.0),
            paint: board,
            gloss: gloss(0.04, 30.0),
        });
    }
    for y in [-0.68, 1.28] {
        out.push(Object {
            shape: block([x, y, 0.6], [0.27, 0.03, 0.6], 0.0),
            paint: board,
            gloss: gloss(0.04, 30.0),
        });
    }
    let books = [0x8d2f3c, 0x2f5d62, 0xd4a02f, 0x394a7a, 0xb5533c, 0x5e7d3a, 0x7b4b94, 0xcfc7b5];
    let mut y = -0.58;
    for (i, &colour) in books.iter().cycle().take(13).enumerate() {
        let half_width = 0.035 + 0.02 * ((i * 5) % 4) as f64 / 3.0;
        let half_height = 0.17 + 0.06 * ((i * 3) % 5) as f64 / 4.0;
        y += half_width;
        let level = if i < 7 { 0.631 } else { 0.061 };
        if i == 7 {
            y = -0.1;
        }
        out.push(Object {
            shape: block(
                [x - 0.04, y, level + half_height],
                [0.19, half_width - 0.004, half_height],
                0.0,
            ),
            paint: Paint::Plain(colour),
            gloss: gloss(0.04, 20.0),
        });
        y += half_width;
    }
    out.extend([
        Object {
            shape: ball([x - 0.05, 0.95, 0.631 + 0.17], 0.17),
            paint: Paint::Marble(0x264653, 0xe9d8a6),
            gloss: gloss(0.06, 60.0),
        },
        Object {
            shape: drum([x, -0.35, 1.201], 0.16, 0.30),
            paint: Paint::Bands(0xbc6c25, 0xf2e8cf),
            gloss: gloss(0.05, 30.0),
        },
        Object {
            shape: block([x, 0.75, 1.34], [0.14, 0.14, 0.14], 20.0),
            paint: Paint::Checker(0xe76f51, 0xfdf0d5, 0.14),
            gloss: None,
        },
    ]);
}

fn corner(out: &mut Vec<Object>) {
    out.extend([
        // A stack of boxes in one corner.
        Object {
            shape: block([-2.35, 1.75, 0.35], [0.42, 0.42, 0.35], 12.0),
            paint: Paint::Checker(0xefe6d8, 0xc9ada7, 0.21),
            gloss: None,
        },
        Object {
            shape: block([-2.35, 1.78, 0.95], [0.30, 0.26, 0.25], -18.0),
            paint: Paint::Stripes(0x4a7c59, 0xf3efe0, 0.1),
            gloss: gloss(0.04, 30.0),
        },
        // A big ball and a stool.
        Object {
            shape: ball([-2.1, -1.65, 0.42], 0.42),
            paint: Paint::Marble(0x1d6fa5, 0xf4f1de),
            gloss: gloss(0.06, 35.0),
        },
        Object {
            shape: drum([1.55, -1.75, 0.0], 0.24, 0.45),
            paint: Paint::Bands(0xe07a5f, 0xf4d8c6),
            gloss: gloss(0.05, 40.0),
        },
        Object {
            shape: ball([1.55, -1.75, 0.67], 0.22),
            paint: Paint::Plain(0xb8bec6),
            gloss: gloss(0.55, 120.0),
        },
        Object {
            shape: drum([-0.5, 2.1, 0.0], 0.2, 0.9),
            paint: Paint::Stripes(0xf2e9e4, 0x9a8c98, 0.12),
            gloss: gloss(0.05, 40.0),
        },
        Object {
            shape: ball([-0.5, 2.1, 1.08], 0.18),
            paint: Paint::Plain(0x3a7d44),
            gloss: gloss(0.04, 20.0),
        },
    ]);
}

fn pictures(out: &mut Vec<Object>) {
    let frame = Paint::Plain(0x3b2f2a);
    for (centre, half, inner, paint) in [
        ([0.6, 2.48, 1.65], [0.75, 0.02, 0.5], [0.68, 0.02, 0.43], Paint::Landscape),
        ([-0.9, -2.48, 1.6], [0.5, 0.02, 0.5], [0.44, 0.02, 0.44], Paint::Circles),
        ([-2.98, 0.0, 1.6], [0.02, 0.85, 0.45], [0.02, 0.79, 0.39], Paint::Waves),
    ] {
        out.push(Object {
            shape: block(centre, half, 0.0),
            paint: frame,
            gloss: gloss(0.05, 40.0),
        });
        // The canvas stands 4 mm proud of its frame, towards the middle of the room.
        let out_of_wall =
            centre.map(|c: f64| if c.abs() > 2.4 { c - 0.004 * c.signum() } else { c });
        out.push(Object { shape: block(out_of_wall, inner, 0.0), paint, gloss: None });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_room_is_closed() {
        let room = Room::furnished();
        let mut rng = testing::Rng::keyed(3, &[]);
        for _ in 0..2000 {
            let d = DVec3::new(rng.unit() - 0.5, rng.unit() - 0.5, rng.unit() - 0.5);
            let ray = Ray { origin: DVec3::new(1.2, 1.1, 1.5), direction: d.normalize() };
            let hit = room.hit(&ray).unwrap();
            assert!(hit.point.abs().cmple(DVec3::new(3.0, 2.5, 2.7) + 1e-9).all());
        }
    }

    #[test]
    fn bounds_change_no_hit() {
        let room = Room::furnished();
        let bare = Room { bounds: vec![None; room.objects.len()], objects: room.objects.clone() };
        let mut rng = testing::Rng::keyed(4, &[]);
        for _ in 0..5000 {
            let d = DVec3::new(rng.unit() - 0.5, rng.unit() - 0.5, rng.unit() - 0.7);
            let ray = Ray { origin: DVec3::new(-1.8, -0.4, 1.4), direction: d.normalize() };
            let (a, b) = (room.hit(&ray).unwrap(), bare.hit(&ray).unwrap());
            assert_eq!((a.object, a.distance), (b.object, b.distance));
        }
    }

    #[test]
    fn the_lamp_lights_the_table_and_not_the_floor_below_it() {
        let room = Room::furnished();
        let lamp = DVec3::new(0.0, 0.0, 2.0 * HALF.z - 1e-3);
        assert!(room.clear(DVec3::new(0.2, -0.2, 0.70), lamp));
        assert!(!room.clear(DVec3::new(0.2, -0.2, 0.03), lamp));
    }
}
