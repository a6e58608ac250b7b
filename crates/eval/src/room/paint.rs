//! Procedural albedo of the room's surfaces.

use glam::DVec3;

use super::noise::{lattice, noise};
use super::shape::HALF;

/// How a surface is coloured; colours are `0xRRGGBB` in sRGB.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Paint {
    /// One colour.
    Plain(u32),
    /// Floor boards, walls with a dado, white ceiling.
    Walls,
    /// A bordered rug.
    Rug,
    /// Table top.
    Wood,
    /// Checkerboard with the given field size in metres.
    Checker(u32, u32, f64),
    /// Vertical stripes of the given width in metres.
    Stripes(u32, u32, f64),
    /// Horizontal bands, six to the height of a vase.
    Bands(u32, u32),
    /// Veined stone.
    Marble(u32, u32),
    /// A picture of hills under an evening sky.
    Landscape,
    /// A picture of rings.
    Circles,
    /// A picture of waves.
    Waves,
}

/// `0xRRGGBB` in sRGB (gamma 2.2) as linear RGB.
fn linear(hex: u32) -> DVec3 {
    let channel = |shift: u32| libm::pow(f64::from((hex >> shift) & 0xff) / 255.0, 2.2);
    DVec3::new(channel(16), channel(8), channel(0))
}

/// 0 below `-w`, 1 above `w`, smooth between.
fn step(x: f64, w: f64) -> f64 {
    let t = ((x + w) / (2.0 * w)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A square wave of period 2 with soft flanks, 0 to 1.
fn wave(x: f64, w: f64) -> f64 {
    let t = x - 2.0 * (x / 2.0).floor();
    step(t - 1.0, w) - step(t - 2.0, w) + (1.0 - step(t, w))
}

fn mix(a: DVec3, b: DVec3, t: f64) -> DVec3 {
    a * (1.0 - t) + b * t
}

impl Paint {
    /// Albedo at `p` in the shape's own frame, where the surface faces `n` (world axes).
    pub(crate) fn albedo(self, p: DVec3, n: DVec3) -> DVec3 {
        match self {
            Self::Plain(c) => linear(c),
            Self::Walls => walls(p, n),
            Self::Rug => rug(p),
            Self::Wood => wood(p.x, p.y, linear(0xa8743f), linear(0x7f5129)),
            Self::Checker(a, b, size) => {
                // Half a field of offset: the edges of the block fall inside a field.
                let q = p / size + 0.5;
                let sum = [q.x, q.y, q.z].map(|x| 2.0 * wave(x, 0.04) - 1.0);
                let sign = if n.z.abs() > 0.5 { sum[0] * sum[1] } else { side(p, sum) };
                mix(linear(a), linear(b), 0.5 + 0.5 * sign)
            }
            Self::Stripes(a, b, width) => {
                let along = if n.z.abs() > 0.5 { p.x } else { p.x + p.y };
                mix(linear(a), linear(b), wave(along / width, 0.08))
            }
            Self::Bands(a, b) => mix(linear(a), linear(b), wave(p.z / 0.06, 0.08)),
            Self::Marble(a, b) => {
                let bend = noise(p.x * 5.0 + 9.0, p.y * 5.0 + p.z * 3.0, 11);
                let vein = wave(p.z * 5.0 + 2.2 * bend + p.x, 0.45);
                mix(linear(a), linear(b), vein)
            }
            Self::Landscape => landscape(p.x / 0.68, p.z / 0.43),
            Self::Circles => circles(p.x / 0.44, p.z / 0.44),
            Self::Waves => waves(p.y / 0.79, p.z / 0.39),
        }
    }
}

fn side(p: DVec3, sum: [f64; 3]) -> f64 {
    if p.x.abs() > p.y.abs() { sum[1] * sum[2] } else { sum[0] * sum[2] }
}

fn wood(along: f64, across: f64, light: DVec3, dark: DVec3) -> DVec3 {
    let grain =
        noise(along * 2.0, across * 22.0, 1) * 0.7 + noise(along * 5.0, across * 60.0, 2) * 0.3;
    mix(dark, light, grain)
}

fn walls(p: DVec3, n: DVec3) -> DVec3 {
    if n.z > 0.5 {
        let board = (p.y / 0.22).floor();
        let shift = lattice(board as i64, 1, 0) * 2.0;
        let piece = ((p.x + shift) / 1.4).floor();
        let tone = lattice(board as i64, piece as i64, 5);
        let within = p.y / 0.22 - board;
        let gap = step((within - 0.5).abs() - 0.47, 0.02);
        let colour = wood(p.x + 7.0 * tone, p.y, linear(0xc69c6d), linear(0x9a7044));
        return mix(colour * (0.75 + 0.35 * tone), linear(0x4f3722), gap * 0.8);
    }
    if n.z < -0.5 {
        return linear(0xf2efe8);
    }
    let z = p.z + HALF.z;
    let (along, colour) = if n.x > 0.5 {
        (p.y, linear(0x9fb8ad))
    } else if n.x < -0.5 {
        (p.y, linear(0xd8cfc0))
    } else if n.y > 0.5 {
        (p.x, linear(0xcf9f86))
    } else {
        (p.x, mix(linear(0x8fa9c4), linear(0xa4bbd2), wave(p.x / 0.25, 0.06)))
    };
    let plaster = 0.92 + 0.16 * noise(along * 1.7, z * 1.7, 21);
    // Skirting, dado and rail.
    let upper = colour * plaster;
    let dado = mix(linear(0xe9e2d3), linear(0xd6ccb8), wave(along / 0.3 + 0.5, 0.05) * 0.6);
    let below = mix(dado, upper, step(z - 0.86, 0.01));
    let rail = step(z - 0.80, 0.01) - step(z - 0.88, 0.01);
    let skirting = 1.0 - step(z - 0.12, 0.01);
    mix(mix(below, linear(0xf6f1e7), rail), linear(0x6f4e37), skirting)
}

fn rug(p: DVec3) -> DVec3 {
    let (x, y) = (p.x / 1.45, p.y / 1.15);
    let edge = x.abs().max(y.abs());
    let (red, cream, blue) = (linear(0x9b2335), linear(0xead9b5), linear(0x27476e));
    let diamonds = wave((p.x + p.y) / 0.32, 0.06) * wave((p.x - p.y) / 0.32, 0.06);
    let middle = mix(red, linear(0xc1553f), diamonds);
    let star = step(0.34 - (x.abs() + y.abs()), 0.01) - step(0.2 - (x.abs() + y.abs()), 0.01);
    let inner = mix(middle, cream, star);
    let border = mix(cream, blue, step(edge - 0.86, 0.01));
    mix(inner, border, step(edge - 0.78, 0.01))
}

fn landscape(x: f64, z: f64) -> DVec3 {
    let sky = mix(linear(0xf7b267), linear(0x4f6d9e), step(z - 0.35, 0.9));
    let sun = step(0.2 - libm::hypot((x - 0.35) * 1.5, z - 0.28), 0.02);
    let sky = mix(sky, linear(0xfff1c1), sun);
    let far = 0.15 + 0.35 * (noise(x * 2.2 + 4.0, 0.5, 31) - 0.5) * 2.0;
    let near = -0.25 + 0.3 * (noise(x * 1.4 + 8.0, 0.5, 32) - 0.5) * 2.0;
    let hills = mix(sky, linear(0x6d597a), step(far - z, 0.02));
    mix(hills, linear(0x355e3b), step(near - z, 0.02))
}

fn circles(x: f64, z: f64) -> DVec3 {
    let mut colour = linear(0xf5efe0);
    for (cx, cz, r, hex) in [
        (-0.3, 0.25, 0.5, 0xe63946),
        (0.35, 0.1, 0.42, 0x1d3557),
        (-0.05, -0.4, 0.45, 0xf4a261),
        (0.5, -0.55, 0.22, 0x2a9d8f),
    ] {
        let d = libm::hypot(x - cx, z - cz);
        colour = mix(colour, linear(hex), step(r - d, 0.015) - step(r * 0.55 - d, 0.015));
    }
    colour
}

fn waves(y: f64, z: f64) -> DVec3 {
    let mut colour = linear(0xf3d9b1);
    for (i, hex) in [0x90e0ef, 0x48b2cf, 0x0a7da8, 0x03507d].into_iter().enumerate() {
        let base = 0.45 - 0.42 * i as f64;
        let crest = base + 0.16 * libm::sin(y * (4.0 + i as f64) + 1.7 * i as f64);
        colour = mix(colour, linear(hex), step(crest - z, 0.02));
    }
    colour
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn albedo_stays_physical() {
        let paints = [
            Paint::Walls,
            Paint::Rug,
            Paint::Wood,
            Paint::Checker(0xffffff, 0x000000, 0.1),
            Paint::Stripes(0xffffff, 0x000000, 0.1),
            Paint::Bands(0xffffff, 0x000000),
            Paint::Marble(0xffffff, 0x000000),
            Paint::Landscape,
            Paint::Circles,
            Paint::Waves,
        ];
        let mut rng = testing::Rng::keyed(5, &[]);
        for paint in paints {
            for n in [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z] {
                for _ in 0..300 {
                    let p = (DVec3::new(rng.unit(), rng.unit(), rng.unit()) * 2.0 - 1.0) * HALF;
                    let a = paint.albedo(p, n);
                    assert!(a.min_element() >= 0.0 && a.max_element() <= 1.1, "{paint:?} {a}");
                }
            }
        }
    }

    #[test]
    fn the_square_wave_has_two_levels() {
        assert!(wave(0.5, 0.05) < 1e-9 && (wave(1.5, 0.05) - 1.0).abs() < 1e-9);
        assert!((wave(0.0, 0.05) - 0.5).abs() < 1e-9 && (wave(1.0, 0.05) - 0.5).abs() < 1e-9);
    }
}
