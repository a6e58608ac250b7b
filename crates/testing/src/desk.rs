//! A desk with clutter, and cameras around it: a scene at the scale of a room's corner that no training made.
//!
//! Discs of a few millimetres cover the surfaces, as in trained models. What trained models have too, and smooth
//! surfaces lack: neighbours of very different colour and opacity, a few bright and very long Gaussians
//! (glints and edges), and faint large ones in the air. Units are metres; up is -y.

use std::f64::consts::TAU;

use gs_model::math::quaternion;
use gs_model::{Camera, Scene};

use crate::Rng;

type V3 = [f64; 3];

/// A piece of surface: points of it, and what it costs to cover.
enum Shape {
    /// Centre, and two edges, of half their length.
    Rectangle(V3, V3, V3),
    /// Centre and radius.
    Sphere(V3, f64),
    /// Centre of the base, axis (of its length) and radius, without lids.
    Tube(V3, V3, f64),
}

/// A surface and its looks.
struct Surface {
    shape: Shape,
    /// Two colours of a pattern, 0 to 1 and above for what shines.
    colours: [V3; 2],
    /// Width of the pattern's stripes.
    stripe: f64,
    /// Gaussians per square metre, relative to the desk's.
    detail: f64,
}

/// The desk, of about `n` Gaussians and SH degree 1.
#[must_use]
pub fn desk(n: usize, seed: u64) -> Scene {
    let mut rng = Rng::keyed(seed, &[1]);
    let surfaces = surfaces(&mut rng);
    let (glints, haze) = (n / 200, n / 100);
    let cost = |s: &Surface| s.detail * s.shape.area();
    let total: f64 = surfaces.iter().map(cost).sum();
    let mut scene = Scene { sh_degree: 1, ..Scene::default() };
    for surface in &surfaces {
        let count = ((n - glints - haze) as f64 * cost(surface) / total).round();
        let spacing = (surface.shape.area() / count.max(1.0)).sqrt();
        for _ in 0..count as usize {
            surface.cover(spacing, &mut rng, &mut scene);
        }
    }
    (0..glints).for_each(|_| glint(&mut rng, &mut scene));
    (0..haze).for_each(|_| faint(&mut rng, &mut scene));
    scene
}

/// Cameras around the desk, 0.6 to 1.4 m away.
#[must_use]
pub fn desk_cameras(n: usize) -> Vec<Camera> {
    let mut rng = Rng::keyed(7, &[2]);
    let camera = |i: usize| {
        // From one side to the other: the wall is behind the desk.
        let angle = 0.5 * TAU * ((i as f64 + 0.5) / n as f64 - 0.5) * 0.9;
        let distance = rng.range(0.6, 1.4);
        let eye =
            [distance * libm::sin(angle), -rng.range(0.15, 0.8), -distance * libm::cos(angle)];
        let target = [rng.range(-0.3, 0.3), -0.08, rng.range(-0.1, 0.15)];
        Camera::looking_at(format!("desk-{i:03}"), eye, target, [0.0, -1.0, 0.0], [480, 360], 420.0)
    };
    (0..n).map(camera).collect()
}

fn surfaces(rng: &mut Rng) -> Vec<Surface> {
    let rectangle = |c, u, v| Shape::Rectangle(c, u, v);
    let mut all = vec![
        Surface {
            shape: rectangle([0.0; 3], [0.8, 0.0, 0.0], [0.0, 0.0, 0.4]),
            colours: [[0.45, 0.28, 0.15], [0.38, 0.22, 0.11]],
            stripe: 0.03,
            detail: 1.0,
        },
        Surface {
            shape: rectangle([0.0, -0.45, 0.5], [1.3, 0.0, 0.0], [0.0, 0.65, 0.0]),
            colours: [[0.75, 0.74, 0.7], [0.72, 0.7, 0.66]],
            stripe: 0.4,
            detail: 0.1,
        },
        // The shade of a lamp, brighter than white.
        Surface {
            shape: Shape::Sphere([0.55, -0.4, 0.2], 0.07),
            colours: [[2.2, 2.0, 1.5], [2.5, 2.2, 1.6]],
            stripe: 0.05,
            detail: 1.0,
        },
        Surface {
            shape: Shape::Tube([0.55, 0.0, 0.2], [0.0, -0.35, 0.0], 0.008),
            colours: [[0.1; 3], [0.14; 3]],
            stripe: 0.1,
            detail: 2.0,
        },
    ];
    for _ in 0..7 {
        all.extend(book(rng));
    }
    for i in 0..14 {
        let base = place(rng);
        // Mugs stand; pens lie, a little raised.
        let (axis, radius, detail) = if i < 5 {
            ([0.0, -rng.range(0.07, 0.13), 0.0], rng.range(0.025, 0.045), 2.0)
        } else {
            let angle = rng.range(0.0, TAU);
            ([0.14 * libm::cos(angle), -0.004, 0.14 * libm::sin(angle)], 0.004, 4.0)
        };
        let shape = Shape::Tube(base, axis, radius);
        all.push(Surface { shape, colours: [colour(rng), colour(rng)], stripe: 0.02, detail });
    }
    for _ in 0..5 {
        let [x, _, z] = place(rng);
        let radius = rng.range(0.015, 0.05);
        let shape = Shape::Sphere([x, -radius, z], radius);
        all.push(Surface {
            shape,
            colours: [colour(rng), colour(rng)],
            stripe: 0.015,
            detail: 3.0,
        });
    }
    all
}

/// The five visible sides of a box that lies on the desk.
fn book(rng: &mut Rng) -> Vec<Surface> {
    let [x, _, z] = place(rng);
    let angle = rng.range(0.0, TAU);
    let (sin, cos) = (libm::sin(angle), libm::cos(angle));
    let (a, b, h) = (rng.range(0.04, 0.12), rng.range(0.05, 0.15), rng.range(0.005, 0.05));
    let (u, v) = ([a * cos, 0.0, a * sin], [-b * sin, 0.0, b * cos]);
    let up = [0.0, -h, 0.0];
    let (cover, paper) = ([colour(rng), colour(rng)], [[0.9, 0.88, 0.8], [0.7, 0.68, 0.6]]);
    let side = |sign: f64, out: V3, along: V3| {
        let centre = [x + sign * out[0], -h, z + sign * out[2]];
        Surface {
            shape: Shape::Rectangle(centre, along, up),
            colours: paper,
            stripe: 0.002,
            detail: 2.0,
        }
    };
    let top = Surface {
        shape: Shape::Rectangle([x, -2.0 * h, z], u, v),
        colours: cover,
        stripe: 0.012,
        detail: 2.0,
    };
    vec![top, side(1.0, u, v), side(-1.0, u, v), side(1.0, v, u), side(-1.0, v, u)]
}

/// Somewhere on the desk.
fn place(rng: &mut Rng) -> V3 {
    [rng.range(-0.6, 0.6), 0.0, rng.range(-0.3, 0.3)]
}

fn colour(rng: &mut Rng) -> V3 {
    std::array::from_fn(|_| rng.range(0.03, 0.95))
}

impl Shape {
    fn area(&self) -> f64 {
        match self {
            Self::Rectangle(_, u, v) => 4.0 * length(*u) * length(*v),
            Self::Sphere(_, r) => 2.0 * TAU * r * r,
            Self::Tube(_, axis, r) => TAU * r * length(*axis),
        }
    }

    /// A point, the surface's normal there, and where the point is along the pattern.
    fn point(&self, rng: &mut Rng) -> (V3, V3, f64) {
        match *self {
            Self::Rectangle(c, u, v) => {
                let (a, b) = (rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
                let p = [0, 1, 2].map(|k| c[k] + a * u[k] + b * v[k]);
                (p, unit(cross(u, v)), b * length(v) + 0.3 * a * length(u))
            }
            Self::Sphere(c, r) => {
                let (height, angle) = (rng.range(-1.0, 1.0), rng.range(0.0, TAU));
                let out = (1.0 - height * height).sqrt();
                let normal = [out * libm::cos(angle), height, out * libm::sin(angle)];
                ([0, 1, 2].map(|k| c[k] + r * normal[k]), normal, r * height)
            }
            Self::Tube(base, axis, r) => {
                let [u, v] = across(unit(axis));
                let (t, angle) = (rng.unit(), rng.range(0.0, TAU));
                let (sin, cos) = (libm::sin(angle), libm::cos(angle));
                let normal = [0, 1, 2].map(|k| cos * u[k] + sin * v[k]);
                let p = [0, 1, 2].map(|k| base[k] + t * axis[k] + r * normal[k]);
                (p, normal, t * length(axis))
            }
        }
    }
}

impl Surface {
    /// Adds a disc somewhere on the surface.
    fn cover(&self, spacing: f64, rng: &mut Rng, scene: &mut Scene) {
        let (mut p, normal, along) = self.shape.point(rng);
        let off = 0.15 * spacing * bell(rng);
        (0..3).for_each(|k| p[k] += off * normal[k]);
        let tilted = unit([0, 1, 2].map(|k| normal[k] + 0.15 * bell(rng)));
        let size = libm::log(0.7 * spacing) + 0.5 * bell(rng);
        let log_scale =
            [size + 0.5 * bell(rng), size + 0.5 * bell(rng), size - 2.0 + 0.7 * bell(rng)];
        let stripe = usize::from((along / self.stripe).rem_euclid(2.0) < 1.0);
        let light = 1.0 + 0.12 * bell(rng);
        let rgb = self.colours[stripe].map(|c| c * light + 0.02 * bell(rng));
        // One in seven is faint: what training left over.
        let logit = if rng.unit() < 0.15 { -3.0 + bell(rng) } else { 2.0 + 1.5 * bell(rng) };
        let rotation = turned(tilted, rng);
        push(scene, One { mean: p, rotation, log_scale, logit, rgb }, rng);
    }
}

/// Adds a bright Gaussian, up to 8 cm long and a hundred times as long as wide.
fn glint(rng: &mut Rng, scene: &mut Scene) {
    let [x, _, z] = place(rng);
    let p = [x, -rng.range(0.001, 0.12), z];
    let axis = unit([bell(rng), 0.3 * bell(rng), bell(rng)]);
    let long = libm::log(rng.range(0.005, 0.04));
    let thin = long - rng.range(2.5, 4.5);
    let light = rng.range(1.0, 4.0);
    let rgb = [light, light * rng.range(0.8, 1.0), light * rng.range(0.6, 1.0)];
    // The third column of the rotation is the axis.
    let (rotation, logit) = (turned(axis, rng), rng.range(-2.0, 4.0));
    let log_scale = [thin, thin - 0.3, long];
    push(scene, One { mean: p, rotation, log_scale, logit, rgb }, rng);
}

/// Adds a large Gaussian in the air that hardly shows.
fn faint(rng: &mut Rng, scene: &mut Scene) {
    let [x, _, z] = place(rng);
    let p = [x, -rng.range(0.02, 0.5), z];
    let size = libm::log(rng.range(0.01, 0.08));
    let log_scale = [0; 3].map(|_| size + 0.6 * bell(rng));
    let normal = unit([bell(rng), bell(rng), bell(rng)]);
    let (rotation, logit) = (turned(normal, rng), rng.range(-5.0, -2.5));
    push(scene, One { mean: p, rotation, log_scale, logit, rgb: colour(rng) }, rng);
}

/// A Gaussian without shine.
struct One {
    mean: V3,
    rotation: [f32; 4],
    log_scale: V3,
    logit: f64,
    rgb: V3,
}

fn push(scene: &mut Scene, one: One, rng: &mut Rng) {
    let One { mean, rotation, log_scale, logit, rgb } = one;
    /// Value of the SH function of degree 0.
    const Y0: f64 = 0.282_094_791_773_878_14;
    scene.means.push(mean.map(|x| x as f32));
    scene.rotations.push(rotation);
    scene.log_scales.push(log_scale.map(|x| x as f32));
    scene.opacity_logits.push(logit as f32);
    scene.sh.push(rgb.map(|c| ((c - 0.5) / Y0) as f32));
    for _ in 0..3 {
        let shine = 0.1 * bell(rng);
        scene.sh.push([0; 3].map(|_| (shine + 0.03 * bell(rng)) as f32));
    }
}

/// A rotation whose third axis is `normal`, turned about it by chance.
fn turned(normal: V3, rng: &mut Rng) -> [f32; 4] {
    let [u, v] = across(normal);
    let angle = rng.range(0.0, TAU);
    let (sin, cos) = (libm::sin(angle), libm::cos(angle));
    let a = [0, 1, 2].map(|k| cos * u[k] + sin * v[k]);
    let b = cross(normal, a);
    quaternion(&[0, 1, 2].map(|k| [a[k], b[k], normal[k]])).map(|x| x as f32)
}

/// Nearly normal, with standard deviation 1 and at most 3.5 from 0: nothing lies far out by chance.
fn bell(rng: &mut Rng) -> f64 {
    (0..4).map(|_| rng.range(-1.0, 1.0)).sum::<f64>() * 0.866
}

fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn length(a: V3) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn unit(a: V3) -> V3 {
    let length = length(a).max(f64::MIN_POSITIVE);
    a.map(|x| x / length)
}

/// Two directions at right angles to a direction and to each other.
fn across(axis: V3) -> [V3; 2] {
    let least = (0..3).min_by(|&a, &b| axis[a].abs().total_cmp(&axis[b].abs())).unwrap_or(0);
    let mut other = [0.0; 3];
    other[least] = 1.0;
    let u = unit(cross(axis, other));
    [u, cross(axis, u)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sha256;

    #[test]
    fn the_desk_is_what_it_was() {
        let scene = desk(2000, 21);
        scene.validate().unwrap();
        assert!((1900..2100).contains(&scene.len()), "{}", scene.len());
        assert_eq!(&sha256(&scene)[..16], "1ded2cf71b68c9af");
        let cameras = desk_cameras(16);
        // None is behind the wall or under the desk.
        assert!(cameras.iter().all(|c| c.position().z < 0.5 && c.position().y < 0.0));
    }
}
