//! The few formulae of one Gaussian that the criteria and the merging share.
//!
//! Exponentials and logarithms come from `libm`, so that a scene voxelizes to the same bits on
//! every machine.

/// Bound on |log-scale| inside the formulae: exp(+-115) = 1e+-50 keeps fourth powers of scales
/// finite and non-zero in `f64`. Trained scales lie within +-20; stored values are never changed.
const MAX_LOG_SCALE: f32 = 115.0;

/// Greatest opacity a rasterizer gives one Gaussian (Inria's alpha cap).
pub(crate) const MAX_ALPHA: f64 = 0.99;

/// Standard deviations, world units.
pub(crate) fn scales(log_scale: [f32; 3]) -> [f64; 3] {
    log_scale.map(|l| libm::exp(f64::from(l.clamp(-MAX_LOG_SCALE, MAX_LOG_SCALE))))
}

/// `ln` of the volume criterion: the product of the three scales (paper section 3.2.2).
///
/// Monotone in the volume and cheaper, and it cannot overflow.
pub(crate) fn log_volume(log_scale: [f32; 3]) -> f64 {
    log_scale.iter().map(|&l| f64::from(l)).sum()
}

/// Opacity in (0, 1) from its logit.
pub(crate) fn opacity(logit: f32) -> f64 {
    1.0 / (1.0 + libm::exp(-f64::from(logit)))
}

/// Logit of an opacity in (0, 1).
pub(crate) fn logit(opacity: f64) -> f64 {
    libm::log(opacity / (1.0 - opacity))
}

/// Root mean square of the three principal cross-sections, up to pi: a measure of the area
/// that an ellipsoid covers on a screen, averaged over directions. Within 10 % of Cauchy's
/// mean shadow for flat and for round Gaussians, and free of elliptic integrals.
pub(crate) fn area(s: [f64; 3]) -> f64 {
    let [a, b, c] = [s[1] * s[2], s[0] * s[2], s[0] * s[1]];
    ((a * a + b * b + c * c) / 3.0).sqrt()
}

/// Rotation matrix (columns are the principal axes) of a quaternion `[w, x, y, z]` of any
/// norm; the identity for a zero or non-finite one.
pub(crate) fn rotation(q: [f32; 4]) -> [[f64; 3]; 3] {
    let q = q.map(f64::from);
    let norm = q.iter().map(|x| x * x).sum::<f64>();
    if !(norm > 0.0 && norm.is_finite()) {
        return [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    }
    let [w, x, y, z] = q;
    let s = 2.0 / norm;
    [
        [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
        [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
        [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
    ]
}

/// A symmetric 3x3 matrix as `[xx, yy, zz, xy, xz, yz]`.
pub(crate) type Symmetric = [f64; 6];

/// `R diag(d) R^T`.
pub(crate) fn congruence(r: &[[f64; 3]; 3], d: [f64; 3]) -> Symmetric {
    let at = |i: usize, j: usize| (0..3).map(|k| r[i][k] * d[k] * r[j][k]).sum::<f64>();
    [at(0, 0), at(1, 1), at(2, 2), at(0, 1), at(0, 2), at(1, 2)]
}
