//! Textures: fixed hashes of lattice coordinates, and noise interpolated between them.

use testing::Rng;

/// A fixed hash of lattice coordinates to `[0, 1)`, for textures.
pub(crate) fn lattice(x: i64, y: i64, z: i64) -> f64 {
    Rng::keyed(0x7e87, &[x as u64, y as u64, z as u64]).unit()
}

/// Value noise in two dimensions with quintic interpolation, `[0, 1)`, feature size 1.
pub(crate) fn noise(x: f64, y: f64, layer: i64) -> f64 {
    let (ix, iy) = (x.floor(), y.floor());
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(x - ix), fade(y - iy));
    let (i, j) = (ix as i64, iy as i64);
    let at = |di: i64, dj: i64| lattice(i + di, j + dj, layer);
    let a = at(0, 0) * (1.0 - u) + at(1, 0) * u;
    let b = at(0, 1) * (1.0 - u) + at(1, 1) * u;
    a * (1.0 - v) + b * v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_continuous_across_cells() {
        let (a, b) = (noise(2.0 - 1e-9, 0.3, 0), noise(2.0 + 1e-9, 0.3, 0));
        assert!((a - b).abs() < 1e-6);
    }
}
