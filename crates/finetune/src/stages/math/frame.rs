// The projection of a Gaussian from end to end. Rust only, but included once per F, as the shared
// text is.

/// Pinhole parameters in the precision of this instance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lens {
    /// Rows of the world-to-camera rotation.
    pub(crate) w0: V3,
    pub(crate) w1: V3,
    pub(crate) w2: V3,
    /// Camera position.
    pub(crate) eye: V3,
    pub(crate) fx: F,
    pub(crate) fy: F,
    pub(crate) cx: F,
    pub(crate) cy: F,
    /// Clamp of the slopes x/z and y/z: 15 % of the image beyond each edge.
    pub(crate) lo_x: F,
    pub(crate) hi_x: F,
    pub(crate) lo_y: F,
    pub(crate) hi_y: F,
    pub(crate) near: F,
    /// Variance of the low-pass filter, pixels squared.
    pub(crate) blur: F,
}

impl Lens {
    pub(crate) fn new(camera: &gs_model::Camera) -> Self {
        let rows = camera.rotation.transpose();
        let v = |r: glam::DVec3| V3(r.x as F, r.y as F, r.z as F);
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        Self {
            w0: v(rows.x_axis),
            w1: v(rows.y_axis),
            w2: v(rows.z_axis),
            eye: v(camera.position()),
            fx: camera.fx as F,
            fy: camera.fy as F,
            cx: camera.cx as F,
            cy: camera.cy as F,
            lo_x: ((-0.15 * w - camera.cx) / camera.fx) as F,
            hi_x: ((1.15 * w - camera.cx) / camera.fx) as F,
            lo_y: ((-0.15 * h - camera.cy) / camera.fy) as F,
            hi_y: ((1.15 * h - camera.cy) / camera.fy) as F,
            near: camera.near as F,
            blur: F(BLUR),
        }
    }
}

/// What projection and its adjoint share: everything up to the 2D shape.
pub(crate) struct Frame {
    /// Mean minus camera position, world axes.
    pub(crate) from_eye: V3,
    /// Mean in camera axes.
    pub(crate) m: V3,
    pub(crate) inv_z: F,
    /// Clamped slopes.
    pub(crate) u: F,
    pub(crate) v: F,
    /// Normalised quaternion and 1 / |q|.
    pub(crate) unit: [F; 4],
    pub(crate) inv_norm: F,
    pub(crate) rot: Rot,
    pub(crate) s: V3,
    pub(crate) ewa: Ewa,
    pub(crate) v0: V3,
    pub(crate) v1: V3,
    pub(crate) shape: Shape,
    /// False if the Gaussian is at or behind the near plane or has no rotation. The other fields have no meaning then.
    pub(crate) in_front: B,
}

impl Frame {
    /// Has no branches, so that loops over Gaussians are vectorised. Guards are phrased so that NaN fails them.
    #[inline(always)]
    pub(crate) fn new(lens: &Lens, mean: [F; 3], q: [F; 4], log_scale: [F; 3]) -> Self {
        let from_eye = sub3(V3(mean[0], mean[1], mean[2]), lens.eye);
        let m = V3(dot3(lens.w0, from_eye), dot3(lens.w1, from_eye), dot3(lens.w2, from_eye));
        let n01 = q[0] * q[0] + q[1] * q[1];
        let n23 = q[2] * q[2] + q[3] * q[3];
        let norm2 = n01 + n23;
        let turned = (norm2 >= F(MIN_QUATERNION_NORM2)) & (norm2 <= F(MAX_QUATERNION_NORM2));
        let in_front = (m.z > lens.near) & turned;
        let inv_norm = 1.0 / sqrt(norm2);
        let unit = q.map(|c| c * inv_norm);
        let rot = rotation_of(unit[0], unit[1], unit[2], unit[3]);
        let scale = |l: F| exp_polynomial(clamp(l, -F(LOG_SCALE_MAX), F(LOG_SCALE_MAX)));
        let s = V3(scale(log_scale[0]), scale(log_scale[1]), scale(log_scale[2]));
        let inv_z = 1.0 / m.z;
        let u = clamp(m.x * inv_z, lens.lo_x, lens.hi_x);
        let v = clamp(m.y * inv_z, lens.lo_y, lens.hi_y);
        let ewa = ewa_of(lens.fx, lens.fy, u, v, inv_z, lens.w0, lens.w1, lens.w2);
        let v0 = half_cov_row(ewa.t0, rot, s);
        let v1 = half_cov_row(ewa.t1, rot, s);
        let shape = shape_of(v0, v1, lens.blur);
        Self { from_eye, m, inv_z, u, v, unit, inv_norm, rot, s, ewa, v0, v1, shape, in_front }
    }
}

/// Unit vector from the camera to the mean, and the inverse distance.
#[inline(always)]
pub(crate) fn direction(from_eye: V3) -> (V3, F) {
    let inv = 1.0 / sqrt(dot3(from_eye, from_eye));
    (scale3(from_eye, inv), inv)
}

/// The SH basis of `degree` at unit direction `d`; entries beyond it stay zero.
#[inline(always)]
pub(crate) fn sh_basis(degree: u8, d: V3) -> [F; 16] {
    let mut b = [0.0; 16];
    b[0] = 0.28209479177387814;
    if degree >= 1 {
        let s = sh_band1(d);
        b[1..4].copy_from_slice(&[s.x, s.y, s.z]);
    }
    if degree >= 2 {
        let s = sh_band2(d);
        b[4..9].copy_from_slice(&[s.b0, s.b1, s.b2, s.b3, s.b4]);
    }
    if degree >= 3 {
        let s = sh_band3(d);
        b[9..16].copy_from_slice(&[s.b0, s.b1, s.b2, s.b3, s.b4, s.b5, s.b6]);
    }
    b
}

/// Colour before the clamp at zero.
#[inline(always)]
pub(crate) fn raw_colour(basis: &[F; 16], sh: &[[F; 3]]) -> [F; 3] {
    let mut c = [0.5; 3];
    for (b, k) in basis.iter().zip(sh) {
        for ch in 0..3 {
            c[ch] += b * k[ch];
        }
    }
    c
}

/// Gradients with respect to a Gaussian's shape.
pub(crate) struct ShapeGradient {
    pub(crate) d_log_scale: [F; 3],
    pub(crate) d_rotation: [F; 4],
    /// Gradient with respect to the 2D covariance, for the mean's.
    pub(crate) v_s: Sym2,
}

/// From E, the sum of v_sigma e e^T over the pixels (see `covariance_adjoint`), and the gradient with respect to the
/// logarithm of the compensation if there is one.
#[inline(always)]
pub(crate) fn shape_adjoint(f: &Frame, e: Sym2, v_compensation: Option<F>) -> ShapeGradient {
    let mut v_s = covariance_adjoint(f.shape.p, f.shape.q, f.shape.r, e);
    if let Some(v) = v_compensation {
        v_s = add_sym2(v_s, compensation_adjoint(f.v0, f.v1, f.shape, F(BLUR), v));
    }
    let h = v_cols(v_s, f.v0, f.v1);
    let l = log_scale_adjoint(h, f.v0, f.v1);
    let g = Rot(
        rotation_col_adjoint(f.ewa, h.a0, h.b0, f.s.x),
        rotation_col_adjoint(f.ewa, h.a1, h.b1, f.s.y),
        rotation_col_adjoint(f.ewa, h.a2, h.b2, f.s.z),
    );
    let [w, x, y, z] = f.unit;
    let q = quaternion_adjoint(w, x, y, z, f.inv_norm, g);
    ShapeGradient { d_log_scale: [l.x, l.y, l.z], d_rotation: [q.w, q.x, q.y, q.z], v_s }
}

/// Gradient with respect to the mean, through the pixel position and the shape.
///
/// `v_s` is the gradient with respect to the 2D covariance; `e` holds the sums of v_sigma e0 and v_sigma e1 over
/// the pixels.
pub(crate) fn mean_adjoint(lens: &Lens, f: &Frame, v_s: Sym2, e: [F; 2]) -> V3 {
    // Through the pixel position (unclamped slopes).
    let (p, q, r) = (f.shape.p, f.shape.q, f.shape.r);
    let v_px = 2.0 * p * e[0];
    let v_py = 2.0 * (q * e[0] + r * e[1]);
    let (jx, jy) = (lens.fx * f.inv_z, lens.fy * f.inv_z);
    let mut v_m = [jx * v_px, jy * v_py, 0.0];
    v_m[2] -= (jx * (f.m.x * f.inv_z)) * v_px + (jy * (f.m.y * f.inv_z)) * v_py;
    // Through J: v_J = 2 v_S V M^T W^T (2x3).
    let row = |a: F, b: F| {
        let mut out = [0.0; 3];
        let cols = [f.rot.c0, f.rot.c1, f.rot.c2];
        let s = [f.s.x, f.s.y, f.s.z];
        let v = [(f.v0.x, f.v1.x), (f.v0.y, f.v1.y), (f.v0.z, f.v1.z)];
        for j in 0..3 {
            let h = 2.0 * (a * v[j].0 + b * v[j].1) * s[j];
            out[0] += h * dot3(lens.w0, cols[j]);
            out[1] += h * dot3(lens.w1, cols[j]);
            out[2] += h * dot3(lens.w2, cols[j]);
        }
        out
    };
    let (j0, j1) = (row(v_s.xx, v_s.xy), row(v_s.xy, v_s.yy));
    v_m[2] -= (jx * j0[0] + jy * j1[1]) * f.inv_z;
    // The third column is -f u / z^2: where u is clamped it does not follow x, and 1/z^2
    // only counts once.
    let (slope_x, slope_y) = (f.m.x * f.inv_z, f.m.y * f.inv_z);
    let (kx, ky) = (jx * f.inv_z, jy * f.inv_z);
    if slope_x >= lens.lo_x && slope_x <= lens.hi_x {
        v_m[0] -= kx * j0[2];
        v_m[2] += 2.0 * kx * f.u * j0[2];
    } else {
        v_m[2] += kx * f.u * j0[2];
    }
    if slope_y >= lens.lo_y && slope_y <= lens.hi_y {
        v_m[1] -= ky * j1[2];
        v_m[2] += 2.0 * ky * f.v * j1[2];
    } else {
        v_m[2] += ky * f.v * j1[2];
    }
    add3(add3(scale3(lens.w0, v_m[0]), scale3(lens.w1, v_m[1])), scale3(lens.w2, v_m[2]))
}

/// Gradient with respect to the mean, through the view direction. `v_raw` is the gradient with respect to the colour
/// before its clamp.
pub(crate) fn direction_adjoint(f: &Frame, sh: &[[F; 3]], v_raw: [F; 3]) -> V3 {
    let (d, inv) = direction(f.from_eye);
    let mut v_d = V3(0.0, 0.0, 0.0);
    for (k, g) in sh.iter().zip(sh_gradient(d)) {
        let c = k[0] * v_raw[0] + k[1] * v_raw[1] + k[2] * v_raw[2];
        v_d = add3(v_d, scale3(g, c));
    }
    let along = dot3(d, v_d);
    scale3(sub3(v_d, scale3(d, along)), inv)
}

/// Gradients of the SH basis functions with respect to the direction, the polynomials being
/// those of `sh_band1` to `sh_band3`.
fn sh_gradient(d: V3) -> [V3; 16] {
    let (x, y, z) = (d.x, d.y, d.z);
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let c1 = 0.4886025119029199;
    let (c2, e2, h2) = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396);
    let (a, b, c) = (-0.5900435899266435, 2.890611442640554, -0.4570457994644658);
    let (e, h) = (0.3731763325901154, 1.445305721320277);
    [
        V3(0.0, 0.0, 0.0),
        V3(0.0, -c1, 0.0),
        V3(0.0, 0.0, c1),
        V3(-c1, 0.0, 0.0),
        V3(c2 * y, c2 * x, 0.0),
        V3(0.0, -c2 * z, -c2 * y),
        V3(-2.0 * e2 * x, -2.0 * e2 * y, 4.0 * e2 * z),
        V3(-c2 * z, 0.0, -c2 * x),
        V3(2.0 * h2 * x, -2.0 * h2 * y, 0.0),
        V3(a * 6.0 * x * y, a * 3.0 * (xx - yy), 0.0),
        V3(b * y * z, b * x * z, b * x * y),
        V3(-2.0 * c * x * y, c * (4.0 * zz - xx - 3.0 * yy), 8.0 * c * y * z),
        V3(-6.0 * e * x * z, -6.0 * e * y * z, e * (6.0 * zz - 3.0 * xx - 3.0 * yy)),
        V3(c * (4.0 * zz - 3.0 * xx - yy), -2.0 * c * x * y, 8.0 * c * x * z),
        V3(2.0 * h * x * z, -2.0 * h * y * z, h * (xx - yy)),
        V3(a * 3.0 * (xx - yy), -6.0 * a * x * y, 0.0),
    ]
}
