//! Covariance as the matrix logarithm of its square root, in six orthonormal coordinates.
//!
//! The matrix is `L = R diag(l) R^T` with rotation `R` and log-scales `l`. The 48 pairs of quaternion and scales
//! that describe one Gaussian give the same `L`. It varies smoothly in space where shapes do. An error `e` in `L`
//! changes each axis by about the factor `exp(e)`, and turns a Gaussian less, the rounder it is, which is what a
//! renderer shows. On `fox`, at equal error of the projected footprints, it needs about a fifth fewer bits than
//! quaternion plus log-scales.
//!
//! A decoder's arithmetic is single precision, only `+ - * /` and square roots, so every machine decodes
//! the same.

use multiversion::multiversion;

/// Coordinates of a symmetric 3x3 matrix in an orthonormal basis (Frobenius norm).
pub(crate) type Coordinates = [f32; 6];

const INV_SQRT_2: f32 = std::f32::consts::FRAC_1_SQRT_2;
/// 1 / sqrt 3.
const INV_SQRT_3: f32 = 0.577_350_26;
/// 1 / sqrt 6.
const INV_SQRT_6: f32 = 0.408_248_3;
/// Coordinates are clamped to plus and minus this, beyond which squares overflow. No encoder goes there.
const LARGEST: f32 = 1e6;

/// Sweeps of the Jacobi iteration; convergence is quadratic, three or four are enough.
const MAX_SWEEPS: usize = 8;
/// Off-diagonal energy below which a matrix counts as diagonal, relative to its norm.
const CONVERGED: f32 = 1e-12;

/// Coordinates of `L` from a quaternion `[w, x, y, z]` (any non-zero norm) and log-scales.
#[must_use]
pub fn coordinates(quaternion: [f32; 4], log_scales: [f32; 3]) -> Coordinates {
    let r = rotation_matrix(quaternion);
    let l = log_scales.map(f64::from);
    let entry = |i: usize, j: usize| {
        r[i][0] * l[0] * r[j][0] + r[i][1] * l[1] * r[j][1] + r[i][2] * l[2] * r[j][2]
    };
    in_basis(entry)
}

/// The reference of [`decompose_into`]: one matrix.
#[cfg(test)]
fn decompose(c: Coordinates) -> ([f32; 4], [f32; 3]) {
    let c = within_limits(c);
    let mut a = matrix(&c);
    // Columns of v converge to the eigenvectors; rotations keep its determinant at +1.
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let norm: f32 = c.iter().map(|x| x * x).sum();
    for _ in 0..MAX_SWEEPS {
        let off = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2];
        if off <= CONVERGED * norm {
            break;
        }
        rotate(&mut a, &mut v, 0, 1, 2);
        rotate(&mut a, &mut v, 0, 2, 1);
        rotate(&mut a, &mut v, 1, 2, 0);
    }
    (quaternion_of(&v), [a[0][0], a[1][1], a[2][2]])
}

/// The derivative of a loss by the coordinates, from its derivatives by the quaternion (of unit norm) and the
/// log-scales that [`decompose_into`] made of them.
///
/// In the frame of the axes the derivative by the diagonal is that by the log-scales. A turn about one
/// axis moves the entry of the other two by their difference, so the derivative by that entry is the
/// torque over twice the difference. Both vanish where two axes are equal: there the quotient is noise,
/// and counts less the smaller the difference is.
#[cfg(feature = "encode")]
#[must_use]
pub(crate) fn gradient(
    quaternion: [f32; 4],
    log_scales: [f32; 3],
    by_quaternion: [f32; 4],
    by_log_scales: [f32; 3],
) -> Coordinates {
    let [w, x, y, z] = quaternion.map(f64::from);
    let d = by_quaternion.map(f64::from);
    let along = |q: [f64; 4]| 0.5 * (d[0] * q[0] + d[1] * q[1] + d[2] * q[2] + d[3] * q[3]);
    let torque = [along([-x, w, z, -y]), along([-y, -z, w, x]), along([-z, y, -x, w])];
    let l = log_scales.map(f64::from);
    let entry = |torque: f64, difference: f64| {
        0.5 * torque * difference / (difference * difference + EQUAL_AXES * EQUAL_AXES)
    };
    let (xy, xz, yz) = (
        entry(torque[2], l[0] - l[1]),
        entry(torque[1], l[2] - l[0]),
        entry(torque[0], l[1] - l[2]),
    );
    let g = by_log_scales.map(f64::from);
    let body = [[g[0], xy, xz], [xy, g[1], yz], [xz, yz, g[2]]];
    let r = rotation_matrix(quaternion);
    let world = |i: usize, j: usize| -> f64 {
        let row = |a: usize| (0..3).map(|b| body[a][b] * r[j][b]).sum::<f64>();
        (0..3).map(|a| r[i][a] * row(a)).sum()
    };
    in_basis(world)
}

/// Axes whose log-scales differ by less than this count as nearly equal.
#[cfg(feature = "encode")]
pub const EQUAL_AXES: f64 = 1e-2;

/// The coordinates of a symmetric matrix given by its entries.
fn in_basis(entry: impl Fn(usize, usize) -> f64) -> Coordinates {
    let (xx, yy, zz) = (entry(0, 0), entry(1, 1), entry(2, 2));
    let root = std::f64::consts::SQRT_2;
    [
        (xx + yy + zz) / 3f64.sqrt(),
        (xx - yy) / root,
        (zz + zz - xx - yy) / 6f64.sqrt(),
        entry(0, 1) * root,
        entry(0, 2) * root,
        entry(1, 2) * root,
    ]
    .map(|v| v as f32)
}

/// Clamps coordinates to [`LARGEST`]. NaN becomes the lower limit.
#[inline(always)]
#[allow(clippy::manual_clamp, reason = "clamp would keep NaN")]
fn within_limits(c: Coordinates) -> Coordinates {
    c.map(|v| v.max(-LARGEST).min(LARGEST))
}

/// The symmetric matrix with these coordinates.
#[inline(always)]
fn matrix(c: &Coordinates) -> [[f32; 3]; 3] {
    let t = c[0] * INV_SQRT_3;
    let d = c[1] * INV_SQRT_2;
    let e = c[2] * INV_SQRT_6;
    [
        [t + d - e, c[3] * INV_SQRT_2, c[4] * INV_SQRT_2],
        [c[3] * INV_SQRT_2, t - d - e, c[5] * INV_SQRT_2],
        [c[4] * INV_SQRT_2, c[5] * INV_SQRT_2, t + e + e],
    ]
}

/// One Jacobi rotation in the plane `(p, q)`; `r` is the remaining axis.
#[cfg(test)]
fn rotate(a: &mut [[f32; 3]; 3], v: &mut [[f32; 3]; 3], p: usize, q: usize, r: usize) {
    let apq = a[p][q];
    if apq == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * apq);
    // The smaller root of t^2 + 2 theta t - 1; theta may overflow to infinity, t is then 0.
    let root = theta.abs() + (theta * theta + 1.0).sqrt();
    let t = if theta >= 0.0 { 1.0 / root } else { -1.0 / root };
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    a[p][p] -= t * apq;
    a[q][q] += t * apq;
    a[p][q] = 0.0;
    a[q][p] = 0.0;
    let (arp, arq) = (a[r][p], a[r][q]);
    a[r][p] = c * arp - s * arq;
    a[p][r] = a[r][p];
    a[r][q] = s * arp + c * arq;
    a[q][r] = a[r][q];
    for row in v {
        let (x, y) = (row[p], row[q]);
        row[p] = c * x - s * y;
        row[q] = s * x + c * y;
    }
}

/// Unit quaternions and log-scales of the matrices with these coordinates. Log-scales come in the order in which
/// the iteration leaves them; the pair is one of the equivalent descriptions of the same Gaussian.
///
/// Several matrices are decomposed at a time, so that their chains of divisions and roots overlap. The bits are
/// the same as one by one. The shortest of the three slices says how many there are.
#[multiversion(targets("x86_64+avx2"))]
pub fn decompose_into(
    coordinates: &[Coordinates],
    rotations: &mut [[f32; 4]],
    log_scales: &mut [[f32; 3]],
) {
    let out = rotations.chunks_mut(LANES).zip(log_scales.chunks_mut(LANES));
    for (rows, (rotations, log_scales)) in coordinates.chunks(LANES).zip(out) {
        decompose_lanes(rows, rotations, log_scales);
    }
}

/// Matrices taken apart at a time.
const LANES: usize = 8;
type Wide = [f32; LANES];

/// At most [`LANES`] of them.
#[inline(always)]
fn decompose_lanes(rows: &[[f32; 6]], rotations: &mut [[f32; 4]], log_scales: &mut [[f32; 3]]) {
    let mut a = [[[0.0; LANES]; 3]; 3];
    let mut v = [[[0.0; LANES]; 3]; 3];
    let mut least = [0.0; LANES];
    for (i, row) in rows.iter().enumerate() {
        let c = within_limits(*row);
        let m = matrix(&c);
        for p in 0..3 {
            for q in 0..3 {
                a[p][q][i] = m[p][q];
            }
            v[p][p][i] = 1.0;
        }
        least[i] = CONVERGED * c.iter().map(|x| x * x).sum::<f32>();
    }
    for _ in 0..MAX_SWEEPS {
        let mut go: Mask = [0; LANES];
        for i in 0..LANES {
            let off = a[0][1][i] * a[0][1][i] + a[0][2][i] * a[0][2][i] + a[1][2][i] * a[1][2][i];
            go[i] = mask(off > least[i]);
        }
        if go == [0; LANES] {
            break;
        }
        rotate_lanes(&mut a, &mut v, &go, 0, 1);
        rotate_lanes(&mut a, &mut v, &go, 0, 2);
        rotate_lanes(&mut a, &mut v, &go, 1, 2);
    }
    for (i, (rotation, scales)) in rotations.iter_mut().zip(log_scales).enumerate() {
        *rotation = quaternion_of(&v.map(|row| row.map(|x| x[i])));
        *scales = [a[0][0][i], a[1][1][i], a[2][2][i]];
    }
}

/// All bits set where something holds: what chooses between floats without a branch.
type Mask = [u32; LANES];

#[inline(always)]
fn mask(holds: bool) -> u32 {
    u32::from(holds).wrapping_neg()
}

/// `new` where the mask is set, else `old`.
#[inline(always)]
fn choose(go: &Mask, old: &mut Wide, new: Wide) {
    for i in 0..LANES {
        old[i] = f32::from_bits(new[i].to_bits() & go[i] | old[i].to_bits() & !go[i]);
    }
}

#[inline(always)]
fn each(f: impl Fn(usize) -> f32) -> Wide {
    std::array::from_fn(f)
}

/// [`rotate`] of axes `p` and `q` where `go` is set.
#[inline(always)]
fn rotate_lanes(a: &mut [[Wide; 3]; 3], v: &mut [[Wide; 3]; 3], go: &Mask, p: usize, q: usize) {
    let r = 3 - p - q;
    let (apq, app, aqq) = (a[p][q], a[p][p], a[q][q]);
    let go = std::array::from_fn(|i| go[i] & mask(apq[i] != 0.0));
    let theta = each(|i| (aqq[i] - app[i]) / (2.0 * apq[i]));
    let root = each(|i| theta[i].abs() + (theta[i] * theta[i] + 1.0).sqrt());
    let t = each(|i| {
        let negative = mask(theta[i] >= 0.0) ^ u32::MAX;
        f32::from_bits((1.0 / root[i]).to_bits() ^ (negative & SIGN))
    });
    let c = each(|i| 1.0 / (t[i] * t[i] + 1.0).sqrt());
    let s = each(|i| t[i] * c[i]);
    choose(&go, &mut a[p][p], each(|i| app[i] - t[i] * apq[i]));
    choose(&go, &mut a[q][q], each(|i| aqq[i] + t[i] * apq[i]));
    choose(&go, &mut a[p][q], [0.0; LANES]);
    a[q][p] = a[p][q];
    let (arp, arq) = (a[r][p], a[r][q]);
    choose(&go, &mut a[r][p], each(|i| c[i] * arp[i] - s[i] * arq[i]));
    choose(&go, &mut a[r][q], each(|i| s[i] * arp[i] + c[i] * arq[i]));
    a[p][r] = a[r][p];
    a[q][r] = a[r][q];
    for row in v {
        let (x, y) = (row[p], row[q]);
        choose(&go, &mut row[p], each(|i| c[i] * x[i] - s[i] * y[i]));
        choose(&go, &mut row[q], each(|i| s[i] * x[i] + c[i] * y[i]));
    }
}

/// The sign of an f32.
const SIGN: u32 = 1 << 31;

/// Row-major rotation matrix of a quaternion of any non-zero norm; identity for zero.
fn rotation_matrix(q: [f32; 4]) -> [[f64; 3]; 3] {
    rotation_matrix_f64(q.map(f64::from))
}

fn rotation_matrix_f64([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    let n = w * w + x * x + y * y + z * z;
    if n <= 0.0 {
        return [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    }
    let s = 2.0 / n;
    [
        [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
        [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
        [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
    ]
}

/// Unit quaternion with `w >= 0` of a rotation matrix (Shepperd's method).
#[inline(always)]
fn quaternion_of(m: &[[f32; 3]; 3]) -> [f32; 4] {
    let (xx, yy, zz) = (m[0][0], m[1][1], m[2][2]);
    let candidates =
        [1.0 + xx + yy + zz, 1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz];
    let mut best = 0;
    for k in 1..4 {
        if candidates[k] > candidates[best] {
            best = k;
        }
    }
    let (a, b, c) = (m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]);
    let (d, e, f) = (m[1][0] + m[0][1], m[0][2] + m[2][0], m[2][1] + m[1][2]);
    let s = candidates[best].max(1.0);
    let q = match best {
        0 => [s, a, b, c],
        1 => [a, s, d, e],
        2 => [b, d, s, f],
        _ => [c, e, f, s],
    };
    let n = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    let sign = if q[0] < 0.0 { -n } else { n };
    q.map(|v| v / sign)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn close(a: Coordinates, b: Coordinates, tolerance: f32) -> bool {
        a.iter().zip(&b).all(|(x, y)| (x - y).abs() <= tolerance)
    }

    #[test]
    fn the_identity_has_only_a_trace() {
        let c = coordinates([1.0, 0.0, 0.0, 0.0], [-2.0; 3]);
        assert!((c[0] + 2.0 * 3f32.sqrt()).abs() < 1e-6);
        assert!(c[1..].iter().all(|v| v.abs() < 1e-6));
    }

    #[test]
    fn hostile_coordinates_stay_finite() {
        for v in [0.0, 1e-30, 1e12, -1e12, f32::MAX, f32::NAN] {
            for k in 0..6 {
                let mut c = [0.0; 6];
                c[k] = v;
                let (q, l) = decompose(c);
                assert!(q.iter().chain(&l).all(|x| x.is_finite()), "{c:?} -> {q:?} {l:?}");
            }
        }
    }

    proptest! {
        // The same covariance comes back: coordinates determine it, so compare those.
        #[test]
        fn decompose_undoes_coordinates(
            q in prop::array::uniform4(-1f32..1.0),
            l in prop::array::uniform3(-14f32..4.0),
        ) {
            prop_assume!(q.iter().map(|x| x * x).sum::<f32>() > 1e-4);
            let c = coordinates(q, l);
            let (q2, l2) = decompose(c);
            prop_assert!(close(c, coordinates(q2, l2), 3e-5), "{c:?} {:?}", coordinates(q2, l2));
            let n: f32 = q2.iter().map(|x| x * x).sum();
            prop_assert!((n - 1.0).abs() < 1e-5 && q2[0] >= 0.0);
        }

        #[test]
        fn several_at_a_time_have_the_same_bits(
            rows in prop::collection::vec(prop::array::uniform6(-3f32..3.0), 0..11),
            zeros: u8,
        ) {
            let mut rows = rows;
            for row in &mut rows {
                (0..6).filter(|k| zeros >> k & 1 == 1).for_each(|k| row[k] = 0.0);
            }
            let (mut rotations, mut log_scales) = (vec![[0.0; 4]; 11], vec![[0.0; 3]; 11]);
            decompose_into(&rows, &mut rotations, &mut log_scales);
            for (i, row) in rows.iter().enumerate() {
                let (q, l) = decompose(*row);
                prop_assert_eq!(q.map(f32::to_bits), rotations[i].map(f32::to_bits));
                prop_assert_eq!(l.map(f32::to_bits), log_scales[i].map(f32::to_bits));
            }
        }

        // A small change of the coordinates changes a function of the matrix by the gradient.
        #[test]
        fn the_gradient_is_that_of_finite_differences(
            c in prop::array::uniform6(-2f32..2.0),
            weights in prop::array::uniform6(-1f64..1.0),
        ) {
            let (q, l) = decompose(c);
            let gap = |a: usize, b: usize| (l[a] - l[b]).abs();
            prop_assume!(gap(0, 1).min(gap(1, 2)).min(gap(0, 2)) > 0.3);
            // The function: a weighted sum of the entries of R diag(e^l) R^T.
            let value = |q: [f64; 4], l: [f64; 3]| -> f64 {
                let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
                let r = rotation_matrix_f64(q.map(|v| v / norm));
                let pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
                let of = |(i, j): (usize, usize)| -> f64 {
                    (0..3).map(|k| r[i][k] * libm::exp(l[k]) * r[j][k]).sum()
                };
                pairs.into_iter().zip(weights).map(|(p, w)| w * of(p)).sum()
            };
            let (q64, l64) = (q.map(f64::from), l.map(f64::from));
            let h = 1e-5;
            let by = |k: usize, n: usize| {
                let (mut q, mut l) = ([q64; 2], [l64; 2]);
                for (s, sign) in [h, -h].into_iter().enumerate() {
                    if n == 4 { q[s][k] += sign } else { l[s][k] += sign }
                }
                (value(q[0], l[0]) - value(q[1], l[1])) / (2.0 * h)
            };
            let by_quaternion = [0, 1, 2, 3].map(|k| by(k, 4) as f32);
            let by_log_scales = [0, 1, 2].map(|k| by(k, 3) as f32);
            let found = gradient(q, l, by_quaternion, by_log_scales);
            for k in 0..6 {
                let at = |d: f32| {
                    let mut c = c;
                    c[k] += d;
                    let (q, l) = decompose(c);
                    value(q.map(f64::from), l.map(f64::from))
                };
                let want = (at(0.01) - at(-0.01)) / 0.02;
                let close = (f64::from(found[k]) - want).abs() < 0.01 + 0.01 * want.abs();
                prop_assert!(close, "{k}: {} {want}", found[k]);
            }
        }

        // q and -q, and permuted axes, are the same Gaussian and give the same coordinates.
        #[test]
        fn symmetric_descriptions_agree(
            q in prop::array::uniform4(-1f32..1.0),
            l in prop::array::uniform3(-9f32..1.0),
        ) {
            prop_assume!(q.iter().map(|x| x * x).sum::<f32>() > 1e-2);
            let c = coordinates(q, l);
            prop_assert!(close(c, coordinates(q.map(|x| -x), l), 1e-6));
            // A quarter turn about the body's z axis swaps the x and y scales.
            let [w, x, y, z] = q;
            let turned = [w - z, x + y, y - x, z + w];
            prop_assert!(close(c, coordinates(turned, [l[1], l[0], l[2]]), 1e-4));
        }
    }
}
