// Stages `project_adjoint` and `adam`. A lane computes the gradient of a Gaussian of a page. Then the lanes of a
// workgroup move consecutive values, so that a GPU reads and writes whole lines of memory.

@group(0) @binding(1) var<storage, read> sums: array<f32>;
@group(0) @binding(2) var<storage, read_write> geo: array<f32>;
@group(0) @binding(3) var<storage, read_write> geo_m: array<f32>;
@group(0) @binding(4) var<storage, read_write> geo_v: array<f32>;
@group(0) @binding(5) var<storage, read_write> sh: array<f32>;
@group(0) @binding(6) var<storage, read_write> sh_m: array<f32>;
@group(0) @binding(7) var<storage, read_write> sh_v: array<f32>;

// New first and second moment, and the amount to subtract from the parameter.
fn moments(m: f32, v: f32, gradient: f32, rate: f32) -> vec3<f32> {
    let g = select(0.0, gradient, finite(gradient));
    let m0 = m * ADAM_BETA1;
    let m1 = g * ADAM_BETA1_REST;
    let first = m0 + m1;
    let gg = g * g;
    let v0 = v * ADAM_BETA2;
    let v1 = gg * ADAM_BETA2_REST;
    let second = v0 + v1;
    let root = sqrt(second) * u.inv_sqrt_bias2;
    let ratio = first / (root + ADAM_EPSILON);
    return vec3<f32>(first, second, ratio * rate);
}

fn update_geo(at: u32, gradient: f32, rate: f32) {
    let r = moments(geo_m[at], geo_v[at], gradient, rate);
    geo_m[at] = r.x;
    geo_v[at] = r.y;
    geo[at] -= r.z;
}

fn update_sh(at: u32, gradient: f32, rate: f32) {
    let r = moments(sh_m[at], sh_v[at], gradient, rate);
    sh_m[at] = r.x;
    sh_v[at] = r.y;
    sh[at] -= r.z;
}

const LANES: u32 = 64u;

// Per Gaussian of the workgroup: the SH basis, the gradient of the colour, and those of `geo`.
var<workgroup> basis_of: array<f32, 1024>;
var<workgroup> colour_gradient: array<f32, 192>;
var<workgroup> geo_gradient: array<f32, 64 * GEO>;

// Gradient with respect to the mean, through the view direction.
fn direction_adjoint(i: u32, f: Frame, v_raw: vec3<f32>) -> V3 {
    let d = direction_of(f.from_eye);
    let inv = 1.0 / sqrt(dot3(f.from_eye, f.from_eye));
    let g = sh_gradient(d);
    var v_d = V3(0.0, 0.0, 0.0);
    //@each k 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15
    if ($ku < u.sh_len) {
        let at = 3u * (i * u.sh_len + $ku);
        let c = dot3(V3(sh[at], sh[at + 1u], sh[at + 2u]), V3(v_raw.x, v_raw.y, v_raw.z));
        v_d = add3(v_d, scale3(g.g$k, c));
    }
    //@end
    return scale3(sub3(v_d, scale3(d, dot3(d, v_d))), inv);
}

fn store_gradient(i: u32, lane: u32) {
    var basis = array<f32, 16>();
    var v_raw = vec3<f32>();
    var d_opacity = 0.0;
    var d_log_scale = V3(0.0, 0.0, 0.0);
    var d_rotation = Q4(0.0, 0.0, 0.0, 0.0);
    var d_mean = V3(0.0, 0.0, 0.0);
    let f = frame_of(i);
    if (f.visible) {
        let at = SUMS * i;
        basis = sh_basis(direction_of(f.from_eye));
        v_raw = vec3<f32>(sums[at], sums[at + 1u], sums[at + 2u]);
        let o = sigmoid(load_opacity(i));
        d_opacity = -(sums[at + 3u] * (1.0 - o));
        let e = Sym2(sums[at + 4u], sums[at + 5u], sums[at + 6u]);
        let v_s = shape_gradient(f, e, -sums[at + 3u]);
        let h = v_cols(v_s, f.v0, f.v1);
        d_log_scale = log_scale_adjoint(h, f.v0, f.v1);
        let g = Rot(
            rotation_col_adjoint(f.ewa, h.a0, h.b0, f.s.x),
            rotation_col_adjoint(f.ewa, h.a1, h.b1, f.s.y),
            rotation_col_adjoint(f.ewa, h.a2, h.b2, f.s.z),
        );
        d_rotation = quaternion_adjoint(f.unit.x, f.unit.y, f.unit.z, f.unit.w, f.inv_norm, g);
        if (u.mean_rate != 0.0) {
            let jx = u.lens.x * f.inv_z;
            let jy = u.lens.y * f.inv_z;
            let sight = Sight(v3(u.w0), v3(u.w1), v3(u.w2), f.m, f.inv_z, f.u, f.v, jx, jy);
            let e0 = sums[at + 7u];
            let e1 = sums[at + 8u];
            d_mean = mean_adjoint(sight, f.rot, f.s, f.shape, h, e0, e1);
            d_mean = add3(d_mean, direction_adjoint(i, f, v_raw));
        }
    }
    for (var k = 0u; k < 16u; k++) {
        basis_of[16u * lane + k] = basis[k];
    }
    //@each k 0 1 2
    colour_gradient[3u * lane + $ku] = v_raw[$ku] * u.view_weight;
    //@end
    let by_geo = array<f32, GEO>(
        d_opacity,
        d_log_scale.x, d_log_scale.y, d_log_scale.z,
        d_rotation.w, d_rotation.x, d_rotation.y, d_rotation.z,
        d_mean.x, d_mean.y, d_mean.z,
    );
    //@each k 0 1 2 3 4 5 6 7 8 9 10
    geo_gradient[GEO * lane + $ku] = by_geo[$k] * u.view_weight;
    //@end
}

@compute @workgroup_size(64)
fn adam(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let first = group_index(group) * LANES;
    if (first + lane < page.count) {
        store_gradient(first + lane, lane);
    }
    workgroupBarrier();
    if (first >= page.count || sums[SUMS * page.count] != 0.0) {
        return;
    }
    let gaussians = min(LANES, page.count - first);
    let row = 3u * u.sh_len;
    for (var v = lane; v < row * gaussians; v += LANES) {
        let gaussian = v / row;
        let k = v % row / 3u;
        let g = basis_of[16u * gaussian + k] * colour_gradient[3u * gaussian + v % 3u];
        update_sh(row * first + v, g, select(u.rates.y, u.rates.x, k == 0u));
    }
    let rates = array<f32, GEO>(
        u.rates.z,
        u.rates.w, u.rates.w, u.rates.w,
        u.rotation_rate, u.rotation_rate, u.rotation_rate, u.rotation_rate,
        u.mean_rate, u.mean_rate, u.mean_rate,
    );
    for (var v = lane; v < GEO * gaussians; v += LANES) {
        update_geo(GEO * first + v, geo_gradient[v], rates[v % GEO]);
    }
}
