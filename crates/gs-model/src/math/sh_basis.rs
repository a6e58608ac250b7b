//! The SH basis functions, for turning the SH coefficients of a model.

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

/// The constant factors.
const FACTORS: [f64; 16] = [
    0.282_094_791_773_878_14,
    -0.488_602_511_902_919_9,
    0.488_602_511_902_919_9,
    -0.488_602_511_902_919_9,
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_8,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];

/// The basis functions in a direction of unit length.
pub(crate) fn values([x, y, z]: [f64; 3]) -> [f64; 16] {
    std::array::from_fn(|k| FACTORS[k] * BASIS[k](x, y, z))
}
