//! The SH basis functions, for tests of what turning a model does to its SH coefficients.

/// The polynomials of the real spherical harmonics of degrees 0 to 3, in the order of 3DGS, without their
/// constant factors.
const BASIS: [fn(f64, f64, f64) -> f64; 16] = [
    |_, _, _| 1.0,
    |_, y, _| y,
    |_, _, z| z,
    |x, _, _| x,
    |x, y, _| x * y,
    |_, y, z| y * z,
    |x, y, z| 2.0 * z * z - x * x - y * y,
    |x, _, z| x * z,
    |x, y, _| x * x - y * y,
    |x, y, _| y * (3.0 * x * x - y * y),
    |x, y, z| x * y * z,
    |x, y, z| y * (4.0 * z * z - x * x - y * y),
    |x, y, z| z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y),
    |x, y, z| x * (4.0 * z * z - x * x - y * y),
    |x, y, z| z * (x * x - y * y),
    |x, y, _| x * (x * x - 3.0 * y * y),
];

/// The sign that each basis function gets where the axes get these signs.
pub(crate) fn signs_under([x, y, z]: [f64; 3]) -> [f32; 16] {
    BASIS.map(|f| (f(0.3 * x, 0.6 * y, 0.5 * z) / f(0.3, 0.6, 0.5)) as f32)
}
