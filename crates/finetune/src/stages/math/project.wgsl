// Projection of one Gaussian. Valid WGSL and a valid Rust module body; see ../mod.rs.

struct V3 { x: F, y: F, z: F }

// Columns of a rotation matrix.
struct Rot { c0: V3, c1: V3, c2: V3 }

// Rows of J W, the derivative of the pixel position with respect to the mean (linearised at
// the clamped point), 2x3.
struct Ewa { t0: V3, t1: V3 }

// The projected shape, with sigma = e0^2 + e1^2, e0 = p dx + q dy, e1 = r dy: the Cholesky
// factor of half the conic. Against a dx^2 + 2 b dx dy + c dy^2 it costs less, cannot be
// negative, and does not cancel for needles.
struct Shape { p: F, q: F, r: F, cov_xx: F, cov_yy: F, gram: F, det_over_m: F, m: F }

fn dot3(a: V3, b: V3) -> F {
    let x = a.x * b.x;
    let y = a.y * b.y;
    let z = a.z * b.z;
    let xy = x + y;
    return xy + z;
}

fn scale3(a: V3, s: F) -> V3 {
    return V3(a.x * s, a.y * s, a.z * s);
}

fn sub3(a: V3, b: V3) -> V3 {
    return V3(a.x - b.x, a.y - b.y, a.z - b.z);
}

fn add3(a: V3, b: V3) -> V3 {
    return V3(a.x + b.x, a.y + b.y, a.z + b.z);
}

// Rotation matrix of the unit quaternion (w, x, y, z).
fn rotation_of(w: F, x: F, y: F, z: F) -> Rot {
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    let xy = x * y;
    let xz = x * z;
    let yz = y * z;
    let wx = w * x;
    let wy = w * y;
    let wz = w * z;
    let d0 = yy + zz;
    let d1 = xx + zz;
    let d2 = xx + yy;
    let c0 = V3(1.0 - 2.0 * d0, 2.0 * (xy + wz), 2.0 * (xz - wy));
    let c1 = V3(2.0 * (xy - wz), 1.0 - 2.0 * d1, 2.0 * (yz + wx));
    let c2 = V3(2.0 * (xz + wy), 2.0 * (yz - wx), 1.0 - 2.0 * d2);
    return Rot(c0, c1, c2);
}

// J W for a camera point at depth z with (clamped) slopes u, v and the rows w0, w1, w2 of the
// world-to-camera rotation.
fn ewa_of(fx: F, fy: F, u: F, v: F, inv_z: F, w0: V3, w1: V3, w2: V3) -> Ewa {
    let jx = fx * inv_z;
    let jy = fy * inv_z;
    let kx = jx * u;
    let ky = jy * v;
    let t0 = sub3(scale3(w0, jx), scale3(w2, kx));
    let t1 = sub3(scale3(w1, jy), scale3(w2, ky));
    return Ewa(t0, t1);
}

// A row of J W times R diag(s).
fn half_cov_row(t: V3, rot: Rot, s: V3) -> V3 {
    return V3(dot3(t, rot.c0) * s.x, dot3(t, rot.c1) * s.y, dot3(t, rot.c2) * s.z);
}

// Shape of the 2D covariance V V^T + blur I, from the rows of V. The determinant comes from
// Cauchy-Binet (|v0 x v1|^2 + blur trace + blur^2), so it cannot fall below blur^2; both it
// and the conic are scaled by the larger diagonal entry m, so that nothing overflows. `gram` is the
// determinant without the blur, scaled likewise.
fn shape_of(v0: V3, v1: V3, blur: F) -> Shape {
    let s00 = dot3(v0, v0);
    let s01 = dot3(v0, v1);
    let s11 = dot3(v1, v1);
    let a = s00 + blur;
    let c = s11 + blur;
    let m = max(a, c);
    let inv_m = 1.0 / m;
    let yz = v0.y * v1.z;
    let zy = v0.z * v1.y;
    let zx = v0.z * v1.x;
    let xz = v0.x * v1.z;
    let xy = v0.x * v1.y;
    let yx = v0.y * v1.x;
    let area = scale3(V3(yz - zy, zx - xz, xy - yx), inv_m);
    let area2 = dot3(area, area);
    let gram = area2 * m;
    let trace = a + s11;
    let ratio = trace * inv_m;
    let base = ratio * blur;
    let det = gram + base;
    let cn = c * inv_m;
    let bn = s01 * inv_m;
    let det2 = det * 2.0;
    let p = sqrt(cn / det2);
    let pdet = p * det2;
    let q = -(bn / pdet);
    let c2 = c * 2.0;
    let r = sqrt(1.0 / c2);
    return Shape(p, q, r, a, c, gram, det, m);
}

// What the opacity of an antialiased Gaussian is multiplied by, for the blur enlarges it: the square
// root of the determinant without the blur over that with it.
fn compensation_of(shape: Shape) -> F {
    return sqrt(shape.gram / shape.det_over_m);
}
