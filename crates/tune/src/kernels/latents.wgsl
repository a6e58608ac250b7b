// Stage `move_latents`: the adjoint of `project` and of `rebuild`, the price of the bits, and Adam on
// the values that the codec transforms. Quantisation counts as the identity (straight-through).

@group(0) @binding(1) var<uniform> codec: Codec;
@group(0) @binding(2) var<storage, read> sums: array<f32>;
@group(0) @binding(3) var<storage, read> geo: array<f32>;
@group(0) @binding(4) var<storage, read_write> latents: array<f32>;
@group(0) @binding(5) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(6) var<storage, read_write> second_moments: array<f32>;
@group(0) @binding(7) var<storage, read> bit_prices: array<f32>;
@group(0) @binding(8) var<storage, read> leaf_weights: array<f32>;

fn move_value(at: u32, by_loss: f32, weight: f32, rate: f32) {
    let gradient = by_loss * u.view_weight + u.extra * weight * bit_prices[at];
    let g = select(0.0, gradient, finite(gradient));
    let first = first_moments[at] * ADAM_BETA1 + g * ADAM_BETA1_REST;
    let second = second_moments[at] * ADAM_BETA2 + g * g * ADAM_BETA2_REST;
    first_moments[at] = first;
    second_moments[at] = second;
    let root = sqrt(second) * u.inv_sqrt_bias2;
    latents[at] -= first / (root + ADAM_EPSILON) * rate;
}

// The torque about two axes over twice the difference of their log-scales; next to nothing where they are
// equal.
fn by_entry(torque: f32, difference: f32) -> f32 {
    return 0.5 * torque * difference / (difference * difference + EQUAL_AXES * EQUAL_AXES);
}

@compute @workgroup_size(64)
fn move_latents(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = group_index(group) * 64u + lane;
    if (i >= codec.leaves || sums[SUMS * page.count] != 0.0) {
        return;
    }
    let f = frame_of(i);
    let at = SUMS * i;
    var reached = false;
    for (var k = 0u; k < 7u; k++) {
        reached = reached || sums[at + k] != 0.0;
    }
    var basis = array<f32, 16>();
    var v_raw = vec3<f32>();
    var d_log_alpha = 0.0;
    var by = array<f32, 6>();
    if (f.visible && reached) {
        basis = sh_basis(direction_of(f.from_eye));
        v_raw = vec3<f32>(sums[at], sums[at + 1u], sums[at + 2u]);
        let logit = load_opacity(i);
        let o = sigmoid(logit);
        d_log_alpha = -(sums[at + 3u] * (1.0 - o)) * (1.0 + exp(clamp(logit, MIN_LOGIT, MAX_LOGIT)));
        let e = Sym2(sums[at + 4u], sums[at + 5u], sums[at + 6u]);
        let v_s = shape_gradient(f, e, -sums[at + 3u]);
        let h = v_cols(v_s, f.v0, f.v1);
        let d = log_scale_adjoint(h, f.v0, f.v1);
        let turn = Rot(
            rotation_col_adjoint(f.ewa, h.a0, h.b0, f.s.x),
            rotation_col_adjoint(f.ewa, h.a1, h.b1, f.s.y),
            rotation_col_adjoint(f.ewa, h.a2, h.b2, f.s.z),
        );
        let dq = quaternion_adjoint(f.unit.x, f.unit.y, f.unit.z, f.unit.w, f.inv_norm, turn);
        let q = f.unit;
        let torque = 0.5 * vec3<f32>(
            -dq.w * q.y + dq.x * q.x + dq.y * q.w - dq.z * q.z,
            -dq.w * q.z - dq.x * q.w + dq.y * q.x + dq.z * q.y,
            -dq.w * q.w + dq.x * q.z - dq.y * q.y + dq.z * q.x,
        );
        by = covariance_coordinates(i, q, d, torque);
    }
    let weight = leaf_weights[i];
    let row = i * codec.channels;
    let opacity = row + codec.groups[OPACITY].first;
    move_value(opacity, d_log_alpha, weight, u.rates.x);
    // An opacity is at most 1.
    latents[opacity] = min(latents[opacity], 0.0);
    for (var k = 0u; k < u.sh_len; k++) {
        let rate = select(u.rates.z, u.rates.y, k == 0u);
        let g = basis[k] * v_raw;
        let first = row + codec.groups[COLOUR].first + 3u * k;
        move_value(first, (g.x + g.y + g.z) * 0.57735026, weight, rate);
        move_value(first + 1u, (g.x - g.z) * 0.70710677, weight, rate);
        move_value(first + 2u, (g.y + g.y - g.x - g.z) * 0.4082483, weight, rate);
    }
    let shape = row + codec.groups[COVARIANCE].first;
    for (var k = 0u; k < 6u; k++) {
        move_value(shape + k, by[k], weight, u.rates.w);
    }
}

// The derivative by the six coordinates, from those by the log-scales and from the torque in the frame of
// the axes.
fn covariance_coordinates(i: u32, q: vec4<f32>, d: V3, torque: vec3<f32>) -> array<f32, 6> {
    let l = load_log_scale(i);
    let xy = by_entry(torque.z, l.x - l.y);
    let xz = by_entry(torque.y, l.z - l.x);
    let yz = by_entry(torque.x, l.y - l.z);
    let body = mat3x3<f32>(
        vec3<f32>(d.x, xy, xz),
        vec3<f32>(xy, d.y, yz),
        vec3<f32>(xz, yz, d.z),
    );
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    let turn = mat3x3<f32>(
        vec3<f32>(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        vec3<f32>(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        vec3<f32>(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    );
    let world = turn * body * transpose(turn);
    let xx = world[0][0];
    let yy = world[1][1];
    let zz = world[2][2];
    return array<f32, 6>(
        (xx + yy + zz) * 0.57735026,
        (xx - yy) * 0.70710677,
        (zz + zz - xx - yy) * 0.4082483,
        world[1][0] * 1.4142135,
        world[2][0] * 1.4142135,
        world[2][1] * 1.4142135,
    );
}
