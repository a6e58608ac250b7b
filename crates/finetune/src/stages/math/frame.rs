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

    /// Where the mean is in the view.
    #[inline(always)]
    pub(crate) fn sight(&self, lens: &Lens) -> Sight {
        let (jx, jy) = (lens.fx * self.inv_z, lens.fy * self.inv_z);
        Sight(lens.w0, lens.w1, lens.w2, self.m, self.inv_z, self.u, self.v, jx, jy)
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
    /// Gradient with respect to the projected axes, for the mean's.
    pub(crate) axes: Cols,
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
    ShapeGradient { d_log_scale: [l.x, l.y, l.z], d_rotation: [q.w, q.x, q.y, q.z], axes: h }
}

/// Gradient with respect to the mean, through the view direction. `v_raw` is the gradient with respect to the colour
/// before its clamp.
pub(crate) fn direction_adjoint(f: &Frame, sh: &[[F; 3]], v_raw: [F; 3]) -> V3 {
    let (d, inv) = direction(f.from_eye);
    let mut v_d = V3(0.0, 0.0, 0.0);
    let g = sh_gradient(d);
    let gradients = [
        V3(0.0, 0.0, 0.0), g.g1, g.g2, g.g3, g.g4, g.g5, g.g6, g.g7, g.g8, g.g9, g.g10, g.g11, g.g12, g.g13, g.g14, g.g15,
    ];
    for (k, g) in sh.iter().zip(gradients) {
        let c = k[0] * v_raw[0] + k[1] * v_raw[1] + k[2] * v_raw[2];
        v_d = add3(v_d, scale3(g, c));
    }
    let along = dot3(d, v_d);
    scale3(sub3(v_d, scale3(d, along)), inv)
}
