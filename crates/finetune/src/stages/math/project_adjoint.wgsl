// Adjoint of the projection. Valid WGSL and a valid Rust module body; see ../mod.rs.

// Symmetric 2x2 matrix.
struct Sym2 { xx: F, xy: F, yy: F }

// Gradient with respect to the three columns of V (2x3): (x, y) pairs.
struct Cols { a0: F, b0: F, a1: F, b1: F, a2: F, b2: F }

struct Q4 { w: F, x: F, y: F, z: F }

// Gradient with respect to the 2D covariance: -2 N E N^T, where N is the factor of Shape and
// E the sum of v_sigma e e^T over the pixels. (Q d = 2 N e takes the place of the conic, so
// nothing large cancels.)
fn covariance_adjoint(p: F, q: F, r: F, e: Sym2) -> Sym2 {
    let p00 = p * e.xx;
    let p01 = p * e.xy;
    let q00 = q * e.xx;
    let q01 = q * e.xy;
    let r01 = r * e.xy;
    let r11 = r * e.yy;
    let a = q00 + r01;
    let b = q01 + r11;
    let xx = p00 * p;
    let xyq = p00 * q;
    let xyr = p01 * r;
    let xy = xyq + xyr;
    let yyq = a * q;
    let yyr = b * r;
    let yy = yyq + yyr;
    return Sym2(-2.0 * xx, -2.0 * xy, -2.0 * yy);
}

// Gradient with respect to the 2D covariance through the compensation, `v` being that with respect to
// its logarithm: v / 2 times the inverse without the blur minus that with it. The difference is written
// without cancellation. A Gaussian that is seen is far from the least product of determinants.
fn compensation_adjoint(v0: V3, v1: V3, shape: Shape, blur: F, v: F) -> Sym2 {
    let inv_m = 1.0 / shape.m;
    let a = dot3(v0, v0) * inv_m;
    let b = dot3(v0, v1) * inv_m;
    let c = dot3(v1, v1) * inv_m;
    let h = blur * inv_m;
    let ah = a + h;
    let ch = c + h;
    let bb = b * b;
    let aah = a * ah;
    let cch = c * ch;
    let bt = b * (a + ch);
    let determinants = max(shape.gram * shape.det_over_m, F(1.0e-12));
    let half = v * 0.5;
    let k = half * blur / determinants;
    return Sym2((cch + bb) * k, -(bt * k), (aah + bb) * k);
}

fn add_sym2(a: Sym2, b: Sym2) -> Sym2 {
    return Sym2(a.xx + b.xx, a.xy + b.xy, a.yy + b.yy);
}

// v_S times the columns of V.
fn v_cols(s: Sym2, v0: V3, v1: V3) -> Cols {
    let ax = s.xx * v0.x;
    let bx = s.xy * v1.x;
    let cx = s.xy * v0.x;
    let dx = s.yy * v1.x;
    let ay = s.xx * v0.y;
    let by = s.xy * v1.y;
    let cy = s.xy * v0.y;
    let dy = s.yy * v1.y;
    let az = s.xx * v0.z;
    let bz = s.xy * v1.z;
    let cz = s.xy * v0.z;
    let dz = s.yy * v1.z;
    return Cols(ax + bx, cx + dx, ay + by, cy + dy, az + bz, cz + dz);
}

// Gradient with respect to the log-scales: 2 V_j . (v_S V_j).
fn log_scale_adjoint(h: Cols, v0: V3, v1: V3) -> V3 {
    let ax = v0.x * h.a0;
    let bx = v1.x * h.b0;
    let ay = v0.y * h.a1;
    let by = v1.y * h.b1;
    let az = v0.z * h.a2;
    let bz = v1.z * h.b2;
    return scale3(V3(ax + bx, ay + by, az + bz), F(2.0));
}

// Gradient with respect to one column of the rotation: 2 s_j (t0 h_x + t1 h_y).
fn rotation_col_adjoint(ewa: Ewa, a: F, b: F, s: F) -> V3 {
    let s2 = s * 2.0;
    return add3(scale3(ewa.t0, a * s2), scale3(ewa.t1, b * s2));
}

// Gradient with respect to the quaternion before normalisation, from that with respect to
// the rotation's columns g0, g1, g2; (w, x, y, z) is normalised, `inv_norm` is 1/|q|.
fn quaternion_adjoint(w: F, x: F, y: F, z: F, inv_norm: F, g: Rot) -> Q4 {
    // Names as in "row i, column j".
    let d21 = g.c1.z - g.c2.y;
    let d02 = g.c2.x - g.c0.z;
    let d10 = g.c0.y - g.c1.x;
    let s10 = g.c0.y + g.c1.x;
    let s20 = g.c0.z + g.c2.x;
    let s21 = g.c1.z + g.c2.y;
    let t12 = g.c1.y + g.c2.z;
    let t02 = g.c0.x + g.c2.z;
    let t01 = g.c0.x + g.c1.y;
    let nw = dot3(V3(x, y, z), V3(d21, d02, d10));
    let nx0 = dot3(V3(y, z, w), V3(s10, s20, d21));
    let xt = x * t12;
    let nx = nx0 - 2.0 * xt;
    let ny0 = dot3(V3(x, z, w), V3(s10, s21, d02));
    let yt = y * t02;
    let ny = ny0 - 2.0 * yt;
    let nz0 = dot3(V3(x, y, w), V3(s20, s21, d10));
    let zt = z * t01;
    let nz = nz0 - 2.0 * zt;
    let along3 = dot3(V3(x, y, z), V3(nx, ny, nz));
    let along_w = w * nw;
    let along = along3 + along_w;
    let k = inv_norm * 2.0;
    let aw = w * along;
    let ax = x * along;
    let ay = y * along;
    let az = z * along;
    return Q4((nw - aw) * k, (nx - ax) * k, (ny - ay) * k, (nz - az) * k);
}

// Where a mean is in a view: the rows of the world-to-camera rotation, the mean in camera axes, its inverse depth, the
// clamped slopes, and the focal lengths over the depth.
struct Sight { w0: V3, w1: V3, w2: V3, m: V3, inv_z: F, u: F, v: F, jx: F, jy: F }

// Gradient with respect to a row of J, from that with respect to the same row of V: v_J = 2 v_S V M^T W^T.
fn jacobian_row_adjoint(k: Sight, rot: Rot, s: V3, a: V3) -> V3 {
    let h = V3(2.0 * a.x * s.x, 2.0 * a.y * s.y, 2.0 * a.z * s.z);
    let x = V3(dot3(k.w0, rot.c0), dot3(k.w0, rot.c1), dot3(k.w0, rot.c2));
    let y = V3(dot3(k.w1, rot.c0), dot3(k.w1, rot.c1), dot3(k.w1, rot.c2));
    let z = V3(dot3(k.w2, rot.c0), dot3(k.w2, rot.c1), dot3(k.w2, rot.c2));
    return V3(dot3(h, x), dot3(h, y), dot3(h, z));
}

// Gradient with respect to the mean, through the pixel position and the shape. `h` is v_S V; `e0` and `e1` are the sums
// of v_sigma e0 and v_sigma e1 over the pixels.
fn mean_adjoint(k: Sight, rot: Rot, s: V3, shape: Shape, h: Cols, e0: F, e1: F) -> V3 {
    // Through the pixel position (unclamped slopes).
    let v_px = 2.0 * shape.p * e0;
    let qe = shape.q * e0;
    let re = shape.r * e1;
    let v_py = 2.0 * (qe + re);
    let slope_x = k.m.x * k.inv_z;
    let slope_y = k.m.y * k.inv_z;
    let zx = k.jx * slope_x * v_px;
    let zy = k.jy * slope_y * v_py;
    // Through J.
    let j0 = jacobian_row_adjoint(k, rot, s, V3(h.a0, h.a1, h.a2));
    let j1 = jacobian_row_adjoint(k, rot, s, V3(h.b0, h.b1, h.b2));
    let j00 = k.jx * j0.x;
    let j11 = k.jy * j1.y;
    let diagonal = (j00 + j11) * k.inv_z;
    let z0 = -(zx + zy);
    let z1 = z0 - diagonal;
    // The third column is -f u / z^2: where u is clamped it does not follow x, and 1/z^2
    // only counts once.
    let kx = k.jx * k.inv_z;
    let ky = k.jy * k.inv_z;
    let follows_x = slope_x == k.u;
    let follows_y = slope_y == k.v;
    let once_x = kx * k.u * j0.z;
    let once_y = ky * k.v * j1.z;
    let z2 = z1 + select(once_x, 2.0 * once_x, follows_x);
    let z = z2 + select(once_y, 2.0 * once_y, follows_y);
    let px = k.jx * v_px;
    let py = k.jy * v_py;
    let x = px - select(F(0.0), kx * j0.z, follows_x);
    let y = py - select(F(0.0), ky * j1.z, follows_y);
    return add3(add3(scale3(k.w0, x), scale3(k.w1, y)), scale3(k.w2, z));
}
