// Stage `rebuild`: Gaussians from the reconstructed values, as a decoder makes them.

@group(0) @binding(1) var<uniform> codec: Codec;
@group(0) @binding(2) var<storage, read> latent_rows: array<f32>;
@group(0) @binding(3) var<storage, read_write> geo: array<f32>;
@group(0) @binding(4) var<storage, read_write> sh: array<f32>;

fn logit_of_log_alpha(log_alpha: f32) -> f32 {
    let a = clamp(log_alpha, -80.0, 0.0);
    // 1 - e^a; close to 0 by its series.
    let near = -a * (1.0 + a * (0.5 + a * (1.0 / 6.0 + a * (1.0 / 24.0))));
    let rest = select(1.0 - exp(a), near, a > -0.05);
    if (rest <= 0.0) {
        return MAX_LOGIT;
    }
    return clamp(a - log(rest), MIN_LOGIT, MAX_LOGIT);
}

// One Jacobi rotation in the plane (p, q); r is the remaining axis.
fn rotate(
    a: ptr<function, array<array<f32, 3>, 3>>,
    v: ptr<function, array<array<f32, 3>, 3>>,
    p: u32,
    q: u32,
    r: u32,
) {
    let apq = (*a)[p][q];
    if (apq == 0.0) {
        return;
    }
    let theta = ((*a)[q][q] - (*a)[p][p]) / (2.0 * apq);
    let magnitude = abs(theta);
    // A huge theta has an infinite square; t is then close to 1 / (2 theta).
    let root = select(magnitude + sqrt(theta * theta + 1.0), 2.0 * magnitude, magnitude > 1e15);
    let t = select(-1.0, 1.0, theta >= 0.0) / root;
    let c = 1.0 / sqrt(t * t + 1.0);
    let s = t * c;
    (*a)[p][p] -= t * apq;
    (*a)[q][q] += t * apq;
    (*a)[p][q] = 0.0;
    (*a)[q][p] = 0.0;
    let arp = (*a)[r][p];
    let arq = (*a)[r][q];
    (*a)[r][p] = c * arp - s * arq;
    (*a)[p][r] = (*a)[r][p];
    (*a)[r][q] = s * arp + c * arq;
    (*a)[q][r] = (*a)[r][q];
    for (var row = 0u; row < 3u; row++) {
        let x = (*v)[row][p];
        let y = (*v)[row][q];
        (*v)[row][p] = c * x - s * y;
        (*v)[row][q] = s * x + c * y;
    }
}

// Unit quaternion, w first, with w >= 0 (Shepperd's method).
fn quaternion_of(m: array<array<f32, 3>, 3>) -> vec4<f32> {
    let xx = m[0][0];
    let yy = m[1][1];
    let zz = m[2][2];
    let by = vec4<f32>(1.0 + xx + yy + zz, 1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz);
    let most = max(max(by.x, by.y), max(by.z, by.w));
    let a = m[2][1] - m[1][2];
    let b = m[0][2] - m[2][0];
    let c = m[1][0] - m[0][1];
    let d = m[1][0] + m[0][1];
    let e = m[0][2] + m[2][0];
    let f = m[2][1] + m[1][2];
    let s = max(most, 1.0);
    var q = vec4<f32>(c, e, f, s);
    if (by.x == most) {
        q = vec4<f32>(s, a, b, c);
    } else if (by.y == most) {
        q = vec4<f32>(a, s, d, e);
    } else if (by.z == most) {
        q = vec4<f32>(b, d, s, f);
    }
    return q / select(length(q), -length(q), q.x < 0.0);
}

@compute @workgroup_size(64)
fn rebuild(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let leaf = group_index(group) * 64u + lane;
    if (leaf >= codec.leaves) {
        return;
    }
    let row = leaf * codec.channels;
    geo[GEO * leaf] = logit_of_log_alpha(latent_rows[row + codec.groups[OPACITY].first]);
    for (var k = 0u; k < u.sh_len; k++) {
        let at = row + codec.groups[COLOUR].first + 3u * k;
        let y = latent_rows[at] * 0.57735026;
        let o = latent_rows[at + 1u] * 0.70710677;
        let g = latent_rows[at + 2u] * 0.4082483;
        let out = 3u * (leaf * u.sh_len + k);
        sh[out] = y + o - g;
        sh[out + 1u] = y + g + g;
        sh[out + 2u] = y - o - g;
    }
    let shape = row + codec.groups[COVARIANCE].first;
    var x = array<f32, 6>();
    var norm = 0.0;
    for (var k = 0u; k < 6u; k++) {
        x[k] = clamp(latent_rows[shape + k], -1e6, 1e6);
        norm += x[k] * x[k];
    }
    let t = x[0] * 0.57735026;
    let d = x[1] * 0.70710677;
    let e = x[2] * 0.4082483;
    let xy = x[3] * 0.70710677;
    let xz = x[4] * 0.70710677;
    let yz = x[5] * 0.70710677;
    var a = array<array<f32, 3>, 3>(
        array<f32, 3>(t + d - e, xy, xz),
        array<f32, 3>(xy, t - d - e, yz),
        array<f32, 3>(xz, yz, t + e + e),
    );
    var v = array<array<f32, 3>, 3>(
        array<f32, 3>(1.0, 0.0, 0.0),
        array<f32, 3>(0.0, 1.0, 0.0),
        array<f32, 3>(0.0, 0.0, 1.0),
    );
    for (var sweep = 0u; sweep < 8u; sweep++) {
        let off = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2];
        if (off <= 1e-12 * norm) {
            break;
        }
        rotate(&a, &v, 0u, 1u, 2u);
        rotate(&a, &v, 0u, 2u, 1u);
        rotate(&a, &v, 1u, 2u, 0u);
    }
    let q = quaternion_of(v);
    let at = GEO * leaf;
    geo[at + 1u] = a[0][0];
    geo[at + 2u] = a[1][1];
    geo[at + 3u] = a[2][2];
    geo[at + 4u] = q.x;
    geo[at + 5u] = q.y;
    geo[at + 6u] = q.z;
    geo[at + 7u] = q.w;
}
