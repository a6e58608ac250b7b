// Loading parameters of Gaussian `i` of the page. `geo` holds GEO floats per Gaussian: opacity logit, log-scales, quaternion,
// mean.

fn load_opacity(i: u32) -> f32 {
    return geo[GEO * i];
}

fn load_log_scale(i: u32) -> vec3<f32> {
    let at = GEO * i + 1u;
    return vec3<f32>(geo[at], geo[at + 1u], geo[at + 2u]);
}

fn load_rotation(i: u32) -> vec4<f32> {
    let at = GEO * i + 4u;
    return vec4<f32>(geo[at], geo[at + 1u], geo[at + 2u], geo[at + 3u]);
}

// The SH basis; entries beyond the degree stay zero.
fn sh_basis(d: V3) -> array<f32, 16> {
    var b = array<f32, 16>();
    b[0] = 0.28209479177387814;
    if (u.sh_len >= 4u) {
        let s = sh_band1(d);
        b[1] = s.x;
        b[2] = s.y;
        b[3] = s.z;
    }
    if (u.sh_len >= 9u) {
        let s = sh_band2(d);
        b[4] = s.b0;
        b[5] = s.b1;
        b[6] = s.b2;
        b[7] = s.b3;
        b[8] = s.b4;
    }
    if (u.sh_len >= 16u) {
        let s = sh_band3(d);
        b[9] = s.b0;
        b[10] = s.b1;
        b[11] = s.b2;
        b[12] = s.b3;
        b[13] = s.b4;
        b[14] = s.b5;
        b[15] = s.b6;
    }
    return b;
}

fn v3(a: vec4<f32>) -> V3 {
    return V3(a.x, a.y, a.z);
}

struct Frame {
    visible: bool,
    from_eye: V3,
    m: V3,
    inv_z: f32,
    // Clamped slopes.
    u: f32,
    v: f32,
    // Normalised quaternion, w first.
    unit: vec4<f32>,
    inv_norm: f32,
    rot: Rot,
    s: V3,
    ewa: Ewa,
    v0: V3,
    v1: V3,
    shape: Shape,
}

fn scale_of(l: f32) -> f32 {
    return exp_polynomial(clamp(l, -LOG_SCALE_MAX, LOG_SCALE_MAX));
}

fn frame_of(i: u32) -> Frame {
    var f: Frame;
    let at = GEO * i + 8u;
    let mean = V3(geo[at], geo[at + 1u], geo[at + 2u]);
    f.from_eye = sub3(mean, v3(u.eye));
    let w0 = v3(u.w0);
    let w1 = v3(u.w1);
    let w2 = v3(u.w2);
    f.m = V3(dot3(w0, f.from_eye), dot3(w1, f.from_eye), dot3(w2, f.from_eye));
    let q = load_rotation(i);
    let q0 = q.x * q.x;
    let q1 = q.y * q.y;
    let q2 = q.z * q.z;
    let q3 = q.w * q.w;
    let n01 = q0 + q1;
    let n23 = q2 + q3;
    let norm2 = n01 + n23;
    let turned = norm2 >= MIN_QUATERNION_NORM2 && norm2 <= MAX_QUATERNION_NORM2;
    f.visible = f.m.z > u.eye.w && turned && finite(norm2);
    if (!f.visible) {
        return f;
    }
    f.inv_norm = 1.0 / sqrt(norm2);
    f.unit = q * f.inv_norm;
    f.rot = rotation_of(f.unit.x, f.unit.y, f.unit.z, f.unit.w);
    let l = load_log_scale(i);
    f.s = V3(scale_of(l.x), scale_of(l.y), scale_of(l.z));
    f.inv_z = 1.0 / f.m.z;
    f.u = clamp(f.m.x * f.inv_z, u.limits.x, u.limits.y);
    f.v = clamp(f.m.y * f.inv_z, u.limits.z, u.limits.w);
    f.ewa = ewa_of(u.lens.x, u.lens.y, f.u, f.v, f.inv_z, w0, w1, w2);
    f.v0 = half_cov_row(f.ewa.t0, f.rot, f.s);
    f.v1 = half_cov_row(f.ewa.t1, f.rot, f.s);
    f.shape = shape_of(f.v0, f.v1, u.blur);
    return f;
}

// The opacity that the view shows.
fn opacity_of(f: Frame, logit: f32) -> f32 {
    let opacity = sigmoid(logit);
    if (u.antialiased == 1u) {
        return opacity * compensation_of(f.shape);
    }
    return opacity;
}

fn direction_of(from_eye: V3) -> V3 {
    let inv = 1.0 / sqrt(dot3(from_eye, from_eye));
    return scale3(from_eye, inv);
}
