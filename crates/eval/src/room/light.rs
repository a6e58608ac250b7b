//! Light transport: a small path tracer with the lamp sampled at every bounce.

use glam::DVec3;
use testing::Rng;

use super::furniture::{Gloss, LAMP_HALF, LAMP_RADIANCE, Room};
use super::shape::{HALF, Ray};

/// Bounces after the first surface.
const BOUNCES: u32 = 3;
/// Light that paths of more bounces would bring, as a constant radiance.
const AMBIENT: DVec3 = DVec3::new(0.16, 0.15, 0.14);
/// Greatest radiance of one bounce: rare bright paths are noise at these sample counts.
const BOUNCE_CAP: f64 = 6.0;
/// Rays start this far off their surface, metres.
const LIFT: f64 = 1e-5;

/// Low-discrepancy samples in six dimensions, shifted at random per pixel.
///
/// Martin Roberts' R sequence: `frac(offset + i * phi^-k)` with `phi^7 = phi + 1`.
pub(crate) struct Samples {
    offset: [f64; 6],
    index: u32,
}

impl Samples {
    const PHI: f64 = 1.112_775_684_278_705_5;

    /// The sequence with a shift drawn from `rng`.
    pub(crate) fn shifted(rng: &mut Rng) -> Self {
        Self { offset: [0; 6].map(|_| rng.unit()), index: 0 }
    }

    /// The next point of the unit cube.
    pub(crate) fn next_point(&mut self) -> [f64; 6] {
        self.index += 1;
        let mut alpha = 1.0;
        self.offset.map(|offset| {
            alpha /= Self::PHI;
            let x = offset + alpha * f64::from(self.index);
            x - x.floor()
        })
    }
}

/// An orthonormal pair perpendicular to the unit vector `n` (Duff and others 2017).
pub(crate) fn tangents(n: DVec3) -> (DVec3, DVec3) {
    let sign = if n.z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (
        DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        DVec3::new(b, sign + n.y * n.y * a, -n.y),
    )
}

/// A direction about `axis` with density proportional to `cos^exponent`.
fn lobe(axis: DVec3, exponent: f64, u: f64, v: f64) -> DVec3 {
    let z = libm::pow(1.0 - u, 1.0 / (exponent + 1.0));
    let r = (1.0 - z * z).max(0.0).sqrt();
    let angle = std::f64::consts::TAU * v;
    let (t, b) = tangents(axis);
    (t * (r * libm::cos(angle)) + b * (r * libm::sin(angle)) + axis * z).normalize()
}

fn fresnel(f0: f64, cos: f64) -> f64 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    f0 + (1.0 - f0) * m * m * m * m * m
}

/// A surface point with what shading needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    pub(crate) point: DVec3,
    pub(crate) normal: DVec3,
    pub(crate) albedo: DVec3,
    pub(crate) gloss: Option<Gloss>,
}

/// Radiance along `ray` from the first thing it meets; `lead` are the stratified numbers of the
/// first surface (lamp u, v, bounce u, v).
pub(crate) fn seen(room: &Room, ray: &Ray, lead: [f64; 4], rng: &mut Rng) -> DVec3 {
    let Some(hit) = room.hit(ray) else { return DVec3::ZERO };
    if room.on_lamp(&hit) {
        return LAMP_RADIANCE;
    }
    let surface = surface_of(room, hit.object, hit.point, hit.normal);
    leaving(room, &surface, -ray.direction, lead, rng, BOUNCES)
}

/// Shading data of a point of object `object`.
pub(crate) fn surface_of(room: &Room, object: usize, point: DVec3, normal: DVec3) -> Surface {
    let item = &room.objects[object];
    let albedo = item.paint.albedo(item.shape.to_local(point), normal);
    Surface { point, normal, albedo, gloss: item.gloss }
}

/// Radiance leaving a surface point towards `view` (unit, pointing away from the surface).
pub(crate) fn leaving(
    room: &Room,
    at: &Surface,
    view: DVec3,
    lead: [f64; 4],
    rng: &mut Rng,
    bounces: u32,
) -> DVec3 {
    let cos_view = at.normal.dot(view);
    if cos_view <= 0.0 {
        return DVec3::ZERO;
    }
    let mirror = at.normal * (2.0 * cos_view) - view;
    let coat = at.gloss.map_or(0.0, |g| fresnel(g.f0, cos_view));
    let from = at.point + at.normal * LIFT;
    let mut out = lamp_light(room, at, from, mirror, coat, lead);
    if bounces == 0 {
        return out + at.albedo * AMBIENT;
    }
    // One bounce: off the coat with the probability of its reflectance, else off the paint.
    let take_coat = at.gloss.filter(|_| rng.unit() < coat);
    let (direction, weight) = match take_coat {
        Some(g) => (lobe(mirror, g.exponent, lead[2], lead[3]), DVec3::ONE),
        None => (lobe(at.normal, 1.0, lead[2], lead[3]), at.albedo),
    };
    if at.normal.dot(direction) <= 0.0 {
        return out;
    }
    let ray = Ray { origin: from, direction };
    if let Some(hit) = room.hit(&ray)
        && !room.on_lamp(&hit)
    {
        let next = surface_of(room, hit.object, hit.point, hit.normal);
        let numbers = [rng.unit(), rng.unit(), rng.unit(), rng.unit()];
        let light = leaving(room, &next, -direction, numbers, rng, bounces - 1);
        out += weight * light.min(DVec3::splat(BOUNCE_CAP));
    }
    out
}

/// Light of the lamp at one of its points, off paint and coat. The lamp is never counted when a
/// bounce meets it, so that it counts once.
fn lamp_light(
    room: &Room,
    at: &Surface,
    from: DVec3,
    mirror: DVec3,
    coat: f64,
    lead: [f64; 4],
) -> DVec3 {
    let spot = DVec3::new(
        (2.0 * lead[0] - 1.0) * LAMP_HALF.0,
        (2.0 * lead[1] - 1.0) * LAMP_HALF.1,
        2.0 * HALF.z,
    );
    let gap = spot - from;
    let toward = gap.normalize();
    let (cos_here, cos_lamp) = (at.normal.dot(toward), toward.z);
    if cos_here <= 0.0 || cos_lamp <= 0.0 || !room.clear(from, spot) {
        return DVec3::ZERO;
    }
    let area = 4.0 * LAMP_HALF.0 * LAMP_HALF.1;
    let solid = area * cos_lamp / gap.length_squared();
    let paint = at.albedo * ((1.0 - coat) * cos_here * std::f64::consts::FRAC_1_PI);
    let shine = at.gloss.map_or(0.0, |g| {
        let cos = mirror.dot(toward).max(0.0);
        coat * (g.exponent + 1.0) / std::f64::consts::TAU * libm::pow(cos, g.exponent)
    });
    LAMP_RADIANCE * solid * (paint + DVec3::splat(shine))
}

/// Radiance to display value 0..1: exponential shoulder, gamma 2.2.
pub(crate) fn display(radiance: DVec3) -> DVec3 {
    let channel = |x: f64| libm::pow(1.0 - libm::exp(-1.35 * x.max(0.0)), 1.0 / 2.2);
    DVec3::new(channel(radiance.x), channel(radiance.y), channel(radiance.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tangents_are_orthonormal() {
        let mut rng = Rng::keyed(1, &[]);
        for _ in 0..200 {
            let n = DVec3::new(rng.unit() - 0.5, rng.unit() - 0.5, rng.unit() - 0.5).normalize();
            let (t, b) = tangents(n);
            for (x, y) in [(t.dot(b), 0.0), (t.dot(n), 0.0), (b.dot(n), 0.0), (t.length(), 1.0)] {
                assert!((x - y).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn the_cosine_lobe_has_mean_cosine_two_thirds() {
        let mut rng = Rng::keyed(2, &[]);
        let n = 20_000;
        let mean =
            (0..n).map(|_| lobe(DVec3::Y, 1.0, rng.unit(), rng.unit()).dot(DVec3::Y)).sum::<f64>()
                / f64::from(n);
        assert!((mean - 2.0 / 3.0).abs() < 0.01, "{mean}");
    }

    #[test]
    fn display_is_monotone_and_bounded() {
        let levels: Vec<f64> =
            (0..50).map(|i| display(DVec3::splat(f64::from(i) * 0.2)).x).collect();
        assert!(levels.windows(2).all(|w| w[0] < w[1]) && levels[0] == 0.0 && levels[49] < 1.0);
    }

    #[test]
    fn samples_fill_the_cube_evenly() {
        let mut samples = Samples::shifted(&mut Rng::keyed(3, &[]));
        let mut cells = [0u32; 64];
        for _ in 0..6400 {
            let p = samples.next_point();
            cells[(p[0] * 8.0) as usize * 8 + (p[1] * 8.0) as usize] += 1;
        }
        assert!(cells.iter().all(|&c| (80..=120).contains(&c)), "{cells:?}");
    }
}
